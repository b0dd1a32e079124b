"""What each part of a difference looks like: columns whose weights are as large as `Sizes` say.

Rows of a trial are channel after channel. Smooth parts are Gaussian processes over time with exponential correlation,
as large where the action responds as `Block.size` says. Source: Kennedy and O'Hagan (2001).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag, cholesky

from validation.conventions import Array
from validation.identification.blocks import Block
from validation.identification.noise.sizes import FAMILIES, OWN_S, SCALES_S, Sizes

TINY = 1e-9  # of a variance, so that a covariance has a root


@dataclass(frozen=True)
class Columns:
    """Columns (n, k), and of each the place of its size in `Sizes.log`."""

    columns: Array
    place: NDArray[np.intp]

    @cached_property
    def groups(self) -> list[tuple[int, slice, Array]]:
        """Of each size its place, the rows it reaches, and its columns there."""
        out = []
        for place in np.unique(self.place):
            mine = self.columns[:, self.place == place]
            there = np.flatnonzero(mine.any(axis=1))
            rows = slice(int(there[0]), int(there[-1]) + 1) if there.size else slice(0, 1)
            out.append((int(place), rows, np.ascontiguousarray(mine[rows])))
        return out

    def covariance(self, size: Array) -> Array:
        """Covariance (n, n), given all sizes."""
        scaled = self.columns * size[self.place]
        return np.asarray(scaled @ scaled.T)


def channels_of(block: Block) -> tuple[int, ...]:
    """Places of a trial's channels among all channels."""
    return tuple(range(len(block.size)))


def smooth(block: Block, channel: int, correlated_s: float) -> Array:
    """Root (n, m) of a process over the phases of one channel of a trial."""
    t, m = block.time_s, block.time_s.size
    k = np.exp(-np.abs(t[:, None] - t[None, :]) / correlated_s) + TINY * np.eye(m)
    out = np.zeros((block.white.size, m))
    out[channel * m : (channel + 1) * m] = block.size[channel][:, None] * cholesky(k, lower=True)
    return out


def own_parts(block: Block, sizes: Sizes) -> Columns:
    """Of one trial: its laws, which scatter, and its own wandering."""
    m, first = block.time_s.size, len(FAMILIES) + block.session * sizes.channels
    wander = [smooth(block, c, OWN_S) for c in range(len(block.size))]
    place = [sizes.families[sizes.families >= 0], *(np.full(m, first + c) for c in channels_of(block))]
    columns = np.hstack([law_columns(block, sizes), *wander])
    return Columns(columns, np.concatenate(place).astype(np.intp))


def law_columns(block: Block, sizes: Sizes) -> Array:
    """Columns (n, l) of all laws of a trial, free or fixed."""
    return np.asarray(np.hstack([block.moved, block.held])[:, sizes.families >= 0])


def reached(block: Block, sizes: Sizes, root: Array) -> Array:
    """How the common parts of a session, as a root (l + n, l + n), reach a trial: laws by its columns, the rest as is.

    Trials of one kind differ by some per cent in their force, and after an impact their columns of a law by half.
    """
    laws = law_columns(block, sizes)
    out = root[laws.shape[1] :].copy()
    out[:, : laws.shape[1]] += laws @ root[: laws.shape[1], : laws.shape[1]]
    return np.asarray(out)


def common_parts(blocks: Sequence[Block], sizes: Sizes) -> Columns:
    """What the model lacks in all trials of one session, which have the same phases; rows as in `reached`."""
    lead, c = blocks[0], sizes.channels
    m, first = lead.time_s.size, len(FAMILIES) + sizes.own.size + lead.session * sizes.common.shape[1]
    columns, place = [], []
    for k, channel in enumerate(channels_of(lead)):
        for i, scale in enumerate(SCALES_S):
            columns.append(smooth(lead, k, scale))
            place.append(np.full(m, first + channel * len(SCALES_S) + i))
        under_load = np.zeros((lead.white.size, 1))
        under_load[k * m : (k + 1) * m, 0] = lead.load * lead.size[k].max()
        columns.append(under_load)
        place.append(np.full(1, first + c * len(SCALES_S) + channel))
    laws = int(np.sum(sizes.families >= 0))
    place.append(np.full(laws, first + c * (len(SCALES_S) + 1)))
    return Columns(np.roll(block_diag(np.hstack(columns), np.eye(laws)), laws, axis=0), np.concatenate(place))
