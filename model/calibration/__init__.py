"""Calibration of an action's laws from bench measurements: felt, friction, string, inertia."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
