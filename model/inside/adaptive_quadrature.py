"""Integrals of rates along a motion, panel by panel, split where Simpson's rule is not yet good enough.

Powers in the action are sharp peaks where felt is hit or sliding turns round; equal steps would miss them or
waste work. NumPy only.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SPLIT = 4  # parts a panel is split into
MOST_POINTS = 60_000


@dataclass(frozen=True)
class Panels:
    """Integrals over (k,) consecutive panels.

    Attributes
    ----------
    end_s : (k,) where each panel ends, s
    integral : (k, f) integral of each rate
    rest : (k,) what the integrals leave unexplained of the change of the level
    error_bound : (k,) bound on the error of the integrals, all together
    level : (k,) level at the end of the panel
    points : times sampled
    """

    end_s: Array
    integral: Array
    rest: Array
    error_bound: Array
    level: Array
    points: int


def panel_edges(start: float, end: float, longest: float, *inside: Array) -> Array:
    """Edges from ``start`` to ``end`` (s), no panel longer than ``longest``, with all given times between them."""
    count = 1 + max(1, round((end - start) / longest))
    given = [times[(times > start) & (times < end)] for times in inside]
    return np.unique(np.concatenate([np.linspace(start, end, count), *given]))


def integrate_panels(
    sample: Callable[[Array], tuple[Array, Array]],
    edges: Array,
    sign: Array,
    allowed: Callable[[], float],
    rounds: int,
) -> Panels:
    """Integrate rates over the panels between ``edges`` (k + 1,), s.

    Parameters
    ----------
    sample : gives rates (m, f) and a level (m,) at increasing times (m,); called once per round
    sign : (f,) the level should change by the sum of sign times integral
    allowed : error of one panel that is small enough; asked after the first round
    rounds : how often panels are split at most
    """
    left, right = edges[:-1], edges[1:]
    accepted: list[tuple[Array, ...]] = []
    points = 0
    for level in range(rounds + 1):
        times = left[:, None] + (right - left)[:, None] * np.linspace(0.0, 1.0, 5)
        times[:, 4] = right  # exactly, so that neighbours share it
        distinct, back = np.unique(times, return_inverse=True)
        back = back.reshape(times.shape)
        points += len(distinct)
        rates, at = sample(distinct)
        flows, total = np.moveaxis(rates[back], 1, 2), at[back]  # (panels, f, 5), (panels, 5)
        width = (right - left)[:, None]
        coarse = width / 6.0 * (flows[..., 0] + 4.0 * flows[..., 2] + flows[..., 4])
        fine = width / 12.0 * (flows @ np.array([1.0, 4.0, 2.0, 4.0, 1.0]))
        rest = fine @ sign - (total[:, 4] - total[:, 0])
        error_bound = np.abs(fine - coarse).sum(axis=1) / 15.0
        worst = np.maximum(np.abs(rest), error_bound)
        coarse_still = open_ = ~(worst <= allowed())
        room = (MOST_POINTS - points) // (4 * SPLIT) if level < rounds else 0
        if open_.sum() > room:  # the worst first
            open_ = open_ & np.isin(np.arange(len(worst)), np.argsort(-worst)[: max(room, 0)])
        # a panel given up before Simpson's rule settles is not yet in the range where fine - coarse shrinks by 15
        error_bound = np.where(coarse_still, 15.0 * error_bound, error_bound)
        done = ~open_
        accepted.append((right[done], fine[done], rest[done], error_bound[done], total[done, 4]))
        if not open_.any():
            break
        parts = left[open_, None] + (right - left)[open_, None] * np.linspace(0.0, 1.0, SPLIT + 1)
        parts[:, -1] = right[open_]
        left, right = parts[:, :-1].ravel(), parts[:, 1:].ravel()
    columns = [np.concatenate(part) for part in zip(*accepted, strict=True)]
    order = np.argsort(columns[0])
    ends, integral, rests, doubts, levels = (column[order] for column in columns)
    return Panels(ends, integral, rests, doubts, levels, points)
