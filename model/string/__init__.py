"""A string of modes under the hammer: contact time and force, rebound, what every partial gets.

In: a string, a hammer's mass, speed and felt. Out: one blow, from first touch to the last parting. ``parameters`` holds
the string and its source, ``blow`` one blow, ``instead_of_the_bar`` what an action's blow does to a string. It stands
beside the moving action: the action's own runs keep the bar.
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
