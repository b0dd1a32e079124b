"""Inside view of a motion: what acts, slides, loses energy and accelerates at each contact, joint and body.

`observe` computes it (NumPy and the model's kernels only); ``figure`` and ``animation`` draw it and are imported by
name when something is drawn.
"""

from model.inside.look import Observer
from model.inside.observe import Inside, observe
from model.inside.rail import Lift, Tension, lifts, tensions

__all__ = ["Inside", "Lift", "Observer", "Tension", "lifts", "observe", "tensions"]
