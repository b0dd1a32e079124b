"""What a difference between model and trial may be made of, and how large each part is, learnt from all trials.

In: the linear model of every trial (`blocks.Block`), residuals. Out: `marginal.Marginal`, with everything linear taken
out in closed form. `sizes` says what parts there are, `parts` what each looks like, `learning` how large it is,
`held_out` how well strokes kept aside are predicted, `own_modes` what each trial has of its own, `steps` where to go.
"""

from validation.identification.noise.learning import learn, likeliest
from validation.identification.noise.marginal import Marginal
from validation.identification.noise.own_modes import OwnModes
from validation.identification.noise.sizes import FLOOR, LEAST, NOT_SEEN, Sizes, family_of
from validation.identification.noise.steps import LEAST_DAMPING, box_step, dampings, largest_step

__all__ = [
    "FLOOR",
    "LEAST",
    "LEAST_DAMPING",
    "NOT_SEEN",
    "Marginal",
    "OwnModes",
    "Sizes",
    "box_step",
    "dampings",
    "family_of",
    "largest_step",
    "learn",
    "likeliest",
]
