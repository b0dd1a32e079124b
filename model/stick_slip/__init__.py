"""Friction without a threshold speed: the limit that the smoothed law of eq. 2.10 stands for.

In: an action and a force table; out: the blow with set-valued Coulomb friction (``march``), beside the smoothed law at
falling threshold speeds (``limit``), as numbers and as a figure.
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
