"""What a trial has of its own, beside what all trials share, and where its curves are computed because of it.

A soft stroke near a fork of its motion does not answer a scatter of 2 % linearly. So each trial is computed where its
own laws and its own force most probably were, and is linear around that. Source: Lindstrom and Bates (1990).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from validation.conventions import Array
from validation.identification.blocks import Block


@dataclass(frozen=True)
class Own:
    """What one trial has of its own.

    Attributes
    ----------
    laws : (p + h,) by how much what moves and what is fixed differs in this trial, in prior standard uncertainties
    drive : (k,) of what drives the trial, in standard deviations: weights of `Response.force_columns`
    """

    laws: Array
    drive: Array

    def towards(self, other: Own, share: float) -> Own:
        """A share of the way to another."""
        return Own(self.laws + share * (other.laws - self.laws), self.drive + share * (other.drive - self.drive))

    def apart(self, other: Own, scatter: Array) -> float:
        """Root mean square distance in standard deviations; ``scatter`` (p + h,) is that of the laws."""
        there = scatter > 0.0
        laws = (self.laws - other.laws)[there] / scatter[there]
        return float(np.sqrt(np.mean(np.concatenate([laws, self.drive - other.drive]) ** 2)))


def nothing_own(blocks: Sequence[Block]) -> list[Own]:
    """Of each trial: it is as all are."""
    return [Own(np.zeros(b.moved.shape[1] + b.held.shape[1]), np.zeros(b.driven)) for b in blocks]


def without_own(blocks: Sequence[Block], residuals: Sequence[Array], own: Sequence[Own]) -> list[Array]:
    """Residuals that the linear model would have if no trial had anything of its own."""
    return [
        r + np.hstack([b.moved, b.held]) @ o.laws + b.own[:, : b.driven] @ o.drive
        for r, b, o in zip(residuals, blocks, own, strict=True)
    ]
