"""Calibration of an action's laws from bench measurements: felt, friction, string, inertia.

One module per measurement of the thesis (Section 2.2.3, Appendix A): ``curve`` reads a loading experiment, ``felt``
fits eq. 2.5 to it, ``speeds`` gives the mean normal speeds of a motion and ``damping`` eq. 2.7 with them, ``rebound``
the damping of the string, ``friction`` eq. 2.10, ``pendulum`` eqs. A.1 and A.2. Numbers in, values with standard
uncertainties out; ``figure`` draws Figs 2.5 and 2.6.
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
