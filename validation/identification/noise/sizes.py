"""Sizes of the parts of a difference, and what is believed of them before the strokes.

Laws of a family (friction of contacts, of joints, damping of felts, their stiffness, springs) scatter alike from trial
to trial: five trials say next to nothing of the scatter of one felt, and a good deal of that of thirteen.
What the model lacks has three kinds of parts: smooth ones by channel, at three correlation times; one by channel in
proportion to the force (what gives under load); and one that acts as if every law were another one in this session.
The last is believed to be as large as the first are: what the model lacks knows nothing of what laws can do, so that
as much of it must be expected where laws could have done it as where they could not.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from validation.conventions import Array
from validation.identification.unknowns.priors import Parameter

OWN_S = 0.01
"""Correlation time of a trial's own wandering."""
SCALES_S = (3e-3, 3e-2, 0.3)
"""Correlation times of the discrepancy: an impact, a stroke, a trial."""
FAMILIES = ("friction of contacts", "friction of joints", "damping", "stiffness", "springs")
SCATTER, OWN, COMMON = 0.07, 0.03, 0.2  # where learning starts
LEAST = 1e-6
FLOOR = 2e-3  # of the response: no model is taken to be closer, and no linear model of it is
# what is believed of a size beforehand: median, standard deviation of its natural logarithm
SCATTER_BELIEF = (0.05, 1.1)  # 1.5 % of a law whose prior is 30 %, to a factor of three
OWN_BELIEF = (0.01, 2.0)
COMMON_BELIEF = (0.05, 2.5)
LIKE_LAWS = 0.5  # standard deviation of the logarithm: the part that is like laws, beside the smooth ones


def family_of(parameter: Parameter) -> int:
    """Place in `FAMILIES` of a law; -1 for what is none."""
    if not parameter.factor:
        return -1
    path = parameter.paths[0]
    if "joint_friction" in path:
        return 1
    if "friction" in path:
        return 0
    if path.endswith(".D") or "damping" in path:
        return 2
    return 4 if "spring" in path else 3


@dataclass(frozen=True)
class Sizes:
    """Sizes of the parts of a difference.

    Attributes
    ----------
    families : (p + h,) place in `FAMILIES` of what moves and of fixed laws, -1 where it is no law
    by_family : (5,) standard deviation from trial to trial, in prior standard uncertainties
    own : (sessions, c) of a trial's own wandering, of the size of the response, by channel
    common : (sessions, 4 c + 1) of the discrepancy, of the size of the response: of each channel at each of
        `SCALES_S`, then of each channel in proportion to the force, then of the part that is like laws
    """

    families: NDArray[np.intp]
    by_family: Array
    own: Array
    common: Array

    @staticmethod
    def start(families: NDArray[np.intp], seen: Array) -> Sizes:
        """Sizes to start learning from; ``seen`` (sessions, c) is 1 where a session has a channel, else 0."""
        return Sizes._all(families, seen, SCATTER, OWN, COMMON)

    @staticmethod
    def tight(families: NDArray[np.intp], seen: Array) -> Sizes:
        """Sizes with next to no discrepancy, which pull values to the data wherever they stand."""
        return Sizes._all(families, seen, SCATTER, 5e-3, 5e-3)

    @staticmethod
    def _all(families: NDArray[np.intp], seen: Array, scatter: float, own: float, common: float) -> Sizes:
        sessions = len(seen)
        parts = np.hstack([np.repeat(seen, len(SCALES_S), axis=1), seen, np.ones((sessions, 1))])
        return Sizes(
            np.asarray(families, dtype=np.intp),
            np.full(len(FAMILIES), scatter),
            np.maximum(own * seen, LEAST),
            np.maximum(common / np.sqrt(len(SCALES_S)) * parts, LEAST),
        )

    @property
    def scatter(self) -> Array:
        """Standard deviation from trial to trial of everything that moves and of fixed laws, (p + h,)."""
        return np.where(self.families >= 0, self.by_family[self.families], 0.0)

    @property
    def channels(self) -> int:
        """How many channels there may be."""
        return int(self.own.shape[1])

    @property
    def discrepancy(self) -> Array:
        """Size of the smooth discrepancy by session and channel, all correlation times together, (sessions, c)."""
        smooth = self.common[:, : len(SCALES_S) * self.channels]
        return np.sqrt((smooth.reshape(len(smooth), self.channels, -1) ** 2).sum(axis=2))

    def log(self) -> Array:
        """Natural logarithm of all sizes: of families, own, common."""
        return np.log(np.concatenate([self.by_family, self.own.ravel(), self.common.ravel()]))

    def at(self, log: Array) -> Sizes:
        """Sizes with these logarithms."""
        f, n = len(self.by_family), self.own.size
        size = np.exp(log)
        own, common = size[f : f + n].reshape(self.own.shape), size[f + n :].reshape(self.common.shape)
        return Sizes(self.families, size[:f], own, common)

    def at_least(self, floor: float) -> Sizes:
        """None smaller than `LEAST`, none of the smooth discrepancy smaller than the floor."""
        common = np.maximum(self.common, LEAST)
        smooth = slice(0, len(SCALES_S) * self.channels)
        there = self.common[:, smooth] > LEAST
        common[:, smooth] = np.where(there, np.maximum(common[:, smooth], floor / np.sqrt(len(SCALES_S))), LEAST)
        return Sizes(self.families, np.maximum(self.by_family, LEAST), np.maximum(self.own, LEAST), common)

    def grown(self, factor: float) -> Sizes:
        """The whole discrepancy this much larger."""
        there = self.common > LEAST
        return Sizes(self.families, self.by_family, self.own, np.where(there, factor * self.common, LEAST))

    def belief(self) -> tuple[Array, Array]:
        """Median and standard deviation of the logarithms, as believed before the strokes."""
        total = self.discrepancy
        there = total > 10.0 * LEAST
        mean = (np.log(np.maximum(total, LEAST)) * there).sum(axis=1) / np.maximum(there.sum(axis=1), 1)
        middle, spread = np.full(self.common.shape, np.log(COMMON_BELIEF[0])), np.full_like(self.common, 2.5)
        middle[:, -1], spread[:, -1] = mean, LIKE_LAWS
        f, n = len(self.by_family), self.own.size
        return (
            np.concatenate([np.full(f, np.log(SCATTER_BELIEF[0])), np.full(n, np.log(OWN_BELIEF[0])), middle.ravel()]),
            np.concatenate([np.full(f, SCATTER_BELIEF[1]), np.full(n, OWN_BELIEF[1]), spread.ravel()]),
        )
