"""Angles from high-speed film: readers, rigid-body tracker, uncertainty, synthetic films.

In: a film and body outlines. Out: angles counter-clockwise in rad, with a standard uncertainty per frame. A leaf of the
project: it imports none of the other packages. Names are loaded on first use, so that outlines and errors cost neither
OpenCV nor numba.
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
