"""Calibration of an action's laws from bench measurements: felt, friction, string, inertia.

``curve`` reads a loading experiment, ``felt`` fits eqs 2.5 and 2.7 to it, ``speeds`` gives the mean normal speeds of a
motion, ``parts`` friction (eq. 2.10), damping of the string and inertia (eqs. A.1, A.2): thesis Section 2.2.3, Appendix
A. Numbers in, values with standard uncertainties out; ``figure`` draws Figs 2.5 and 2.6.
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
