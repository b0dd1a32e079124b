"""Profiles that reproduce a recorded force: from a pianist's blow to a motor command, by iterative learning.

Place in the data flow: recorded force → :mod:`rig.learning.target` → blows on the normal record path, corrected by
:mod:`rig.learning.correction` → a profile for ``record --profile``. After thesis Section 3.2.1, where the points were
modified by hand.
"""

from rig.learning.learner import Blow, Learned, learn
from rig.learning.target import Target, make_target

__all__ = ["Blow", "Learned", "Target", "learn", "make_target"]
