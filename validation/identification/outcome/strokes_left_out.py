"""How far the result hangs on single kinds of stroke: jackknife over the sessions, which are of one kind each.

In the linear model of the fit, with its sizes of noise. It stands beside the interval and does not widen it: a kind of
stroke that alone tells of a parameter moves it to its prior when it is left out, which is no error.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from validation.conventions import Array
from validation.identification.fit import Fitted
from validation.identification.noise import Marginal
from validation.identification.outcome.result import Estimate


def jackknife_over_strokes(fitted: Fitted) -> Array:
    """Standard uncertainty (p,) of z from leaving out one session after the other; NaN with one session."""
    blocks = fitted.marginal.blocks
    sessions = sorted({b.session for b in blocks})
    if len(sessions) < 2:
        return np.full(fitted.z.size, np.nan)
    found = []
    for out in sessions:
        kept = [i for i, b in enumerate(blocks) if b.session != out]
        part = Marginal([blocks[i] for i in kept], fitted.marginal.sizes)
        found.append(part.mean([fitted.linear[i] for i in kept])[: part.p])
    n = len(found)
    return np.asarray(np.sqrt((n - 1) / n * ((np.array(found) - np.mean(found, axis=0)) ** 2).sum(axis=0)))


def beside(estimates: Sequence[Estimate], fitted: Fitted) -> list[Estimate]:
    """The estimates with what leaving out a kind of stroke says of them."""
    u = jackknife_over_strokes(fitted)
    return [replace(e, u_strokes=float(u[j])) for j, e in enumerate(estimates)]
