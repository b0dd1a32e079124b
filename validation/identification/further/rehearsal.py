"""A stroke that was not recorded, played by the model as the bench would play it, and all that is learnt learnt again.

The Fisher information takes a stroke to answer a scatter of its laws linearly. Near a fork of its motion it does not:
what is not linear is taken for something the model lacks, and widens every interval. So the stroke is played with laws
that scatter as learnt, read with the sensors' errors and noise, put beside the strokes at hand, and the sizes of noise
are learnt again from all of them, on the linear model.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from validation.conventions import Array
from validation.identification.blocks import Block, rows
from validation.identification.fit import LAST_ROUNDS, Fitted
from validation.identification.noise import Marginal, likeliest
from validation.identification.noise.parts import law_columns, own_parts
from validation.identification.noise.sizes import FAMILIES, FLOOR, SCALES_S

Play = Callable[[Sequence[Array]], Sequence[Array | None]]
"""Curves (m, c) of the stroke at points (p + h,): everything that moves, then fixed laws; None where it cannot run."""
SEED = 163


def rehearsed(fitted: Fitted, planned: Marginal, block: Block, play: Play, trials: int) -> Marginal | None:
    """The model of the fit with rehearsed trials of one stroke beside those at hand, sizes of noise learnt from all.

    Parameters
    ----------
    fitted : the identification
    planned : the same with the new trials, sizes as learnt so far; their session is its last
    block : linear model of one such trial
    play : what the model does with other laws
    trials : how many

    Returns
    -------
    Marginal or None
        None where the model cannot run the stroke with its laws scattered.
    """
    rng, sizes = np.random.default_rng(SEED), planned.sizes
    new = replace(block, session=len(sizes.common) - 1)
    here = np.concatenate([fitted.z, np.zeros(len(sizes.families) - fitted.z.size)])
    away = sizes.scatter * _as_large_as_said(rng.standard_normal((trials, here.size)))
    curves = [None if c is None else rows(np.asarray(c)) for c in play([here, *(here + step for step in away)])]
    still, moved = curves[0], [c for c in curves[1:] if c is not None]
    if still is None or len(moved) < trials:
        return None
    lacking, own = _lacking(planned, new), own_parts(new, sizes)
    wander = (own.columns * np.exp(sizes.log())[own.place])[:, own.place >= len(FAMILIES)]
    steady = np.hstack([new.moved, new.instrument]) @ fitted.marginal.mean(fitted.linear)[: planned.shared]
    steady = steady - still + lacking @ rng.standard_normal(lacking.shape[1])
    columns = np.hstack([wander, new.own, np.diag(np.sqrt(new.white))])
    linear = [c + steady + columns @ rng.standard_normal(columns.shape[1]) for c in moved]
    blocks = [*fitted.marginal.blocks, *trials * [new]]
    return likeliest(blocks, [*fitted.linear, *linear], sizes, LAST_ROUNDS, anew=False)


def _lacking(planned: Marginal, new: Block) -> Array:
    """Columns of the discrepancy, as large as learnt: without its floor, which no stroke has shown."""
    sizes, part = planned.sizes, planned.parts[0][new.session]
    common = sizes.common[new.session].copy()
    smooth = slice(0, len(SCALES_S) * sizes.channels)
    common[smooth] = np.sqrt(np.maximum(common[smooth] ** 2 - FLOOR**2 / len(SCALES_S), 0.0))
    size = np.exp(sizes.log())
    first = size.size - sizes.common[new.session :].size
    size[first : first + common.size] = common
    columns, laws = part.columns * size[part.place], law_columns(new, sizes)
    return np.asarray(columns[laws.shape[1] :] + laws @ columns[: laws.shape[1]])


def _as_large_as_said(drawn: Array) -> Array:
    """Draws (trials, laws) of root mean square 1 for each law: a rehearsal is no die."""
    return np.asarray(drawn / np.sqrt(np.mean(drawn**2, axis=0)))
