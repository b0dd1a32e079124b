"""Profiles that reproduce a recorded force: from a pianist's blow to a motor command, by iterative learning control.

In: a recorded force; blows on the normal record path. After thesis Section 3.2.1, where the points were set by hand.
Out: a profile for ``record --profile``.
"""

from rig.learning.learner import Blow, Learned, learn
from rig.learning.target import TargetForce, make_target

__all__ = ["Blow", "Learned", "TargetForce", "learn", "make_target"]
