"""Energy audit of a motion: does the work of the force equal what is stored plus what is lost?

States at chosen times in, balance out. The residual of a panel between two times is the work of the force there minus
losses minus change of stored energy: 0 for an exact solution. Powers are sharp peaks where felt is hit or
sliding turns round, so panels are split where Simpson's rule or the balance itself is not yet good enough.
A balance that stays open when panels are split is the solution's fault, and is reported in ``residual``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .energy import energy_terms
from .parameters import Action

Array = NDArray[np.float64]
States = Callable[[Array], tuple[Array, Array]]

SPLIT = 4  # parts a panel is split into
MOST_POINTS = 60_000
FLOWS = ("input", "joint_friction", "contact_friction", "felt_damping")


@dataclass(frozen=True)
class Audit:
    """Energy balance of a motion.

    Attributes
    ----------
    time_s : (m,) ends of the panels
    flow_j : time integral of each of `FLOWS` from the start, (m,) each
    stored_j : energy stored at each time, all kinds together, (m,)
    residual_j : (m,) input - losses - change of stored energy
    turnover_j : what the force gave and took + widest swing of any kind of stored energy + most that felt ever stored
        (where bodies are jammed, an angle within its tolerance is worth energy in proportion); scale of ``residual``
    residual : largest |residual_j| / turnover_j
    quadrature : bound on the share of ``residual`` that the integration over time may have caused
    """

    time_s: Array
    flow_j: Mapping[str, Array]
    stored_j: Array
    residual_j: Array
    turnover_j: float
    residual: float
    quadrature: float


def audit(
    action: Action,
    states: States,
    start: float,
    end: float,
    force_time_s: ArrayLike,
    force_n: ArrayLike,
    *,
    panel_s: float = 5e-4,
    goal: float = 1e-6,
    rounds: int = 6,
) -> Audit:
    """Energy balance from ``start`` to ``end`` (s).

    Parameters
    ----------
    states : gives angles and speeds, (m, 5) each, at increasing times (m,) s; called once per round
    force_time_s, force_n : (k,) force on the key, linear between its points
    panel_s : longest panel, s
    goal : share of the turnover up to which errors of the integration over time are pursued
    rounds : how often panels are split at most
    """
    knots, forces = np.asarray(force_time_s, float), np.asarray(force_n, float)
    inside = knots[(knots > start) & (knots < end)]
    edges = np.unique(np.concatenate([np.linspace(start, end, 1 + max(1, round((end - start) / panel_s))), inside]))
    left, right = edges[:-1], edges[1:]
    kept: list[tuple[Array, ...]] = []
    points = 0
    turnover = at_start = 0.0
    for level in range(rounds + 1):
        offsets = np.linspace(0.0, 1.0, 5)
        times = left[:, None] + (right - left)[:, None] * offsets
        times[:, 4] = right  # exactly, so that neighbours share it
        distinct, back = np.unique(times, return_inverse=True)
        points += len(distinct)
        q, v = states(distinct)
        stored, powers = energy_terms(action, q, v, np.interp(distinct, knots, forces))
        total = np.sum(list(stored.values()), axis=0)[back.reshape(times.shape)]
        width = (right - left)[:, None]
        flows = np.stack([powers[name][back.reshape(times.shape)] for name in FLOWS], axis=1)  # (panels, 4, 5)
        coarse = width / 6.0 * (flows[..., 0] + 4.0 * flows[..., 2] + flows[..., 4])
        fine = width / 12.0 * (flows @ np.array([1.0, 4.0, 2.0, 4.0, 1.0]))
        rest = fine[:, 0] - fine[:, 1:].sum(axis=1) - (total[:, 4] - total[:, 0])
        doubt = np.abs(fine - coarse).sum(axis=1) / 15.0
        if level == 0:
            given = width[:, 0] / 12.0 * (np.abs(flows[:, 0]) @ np.array([1.0, 4.0, 2.0, 4.0, 1.0]))
            at_start = float(total[0, 0])
            swing = max(float(np.ptp(part)) for part in stored.values())
            turnover = float(given.sum()) + swing + float(np.max(stored["felt"]))
        worst = np.maximum(np.abs(rest), doubt)
        open_ = ~(worst <= goal * turnover / 100.0)
        room = (MOST_POINTS - points) // (4 * SPLIT) if level < rounds else 0
        if open_.sum() > room:  # the worst first
            open_ &= np.isin(np.arange(len(worst)), np.argsort(-worst)[: max(room, 0)])
        done = ~open_
        kept.append((right[done], fine[done], rest[done], doubt[done], total[done, 4]))
        if not open_.any():
            break
        parts = left[open_, None] + (right - left)[open_, None] * np.linspace(0.0, 1.0, SPLIT + 1)
        parts[:, -1] = right[open_]
        left, right = parts[:, :-1].ravel(), parts[:, 1:].ravel()
    ends, flow, rests, doubts, level_j = (np.concatenate(part) for part in zip(*kept, strict=True))
    order = np.argsort(ends)
    sums = np.vstack([np.zeros(len(FLOWS)), np.cumsum(flow[order], axis=0)])
    residual = np.concatenate([[0.0], np.cumsum(rests[order])])
    scale = turnover if turnover > 0.0 else 1.0
    return Audit(
        time_s=np.concatenate([[start], ends[order]]),
        flow_j={name: sums[:, i] for i, name in enumerate(FLOWS)},
        stored_j=np.concatenate([[at_start], level_j[order]]),
        residual_j=residual,
        turnover_j=turnover,
        residual=float(np.max(np.abs(residual))) / scale,
        quadrature=float(doubts.sum()) / scale,
    )
