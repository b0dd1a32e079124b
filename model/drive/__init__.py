"""The drive of a bench's motor: what it does in a run, and its numbers from a log of the bench.

In: solutions of scenes with the effect ``motor_drive``; logs of command, force and motion of the arm, with the current
where it is recorded. Out: current, voltages, torque and powers; numbers of the drive with standard uncertainties, and
the names of those that the log does not determine.
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
