"""Energy audit of a motion: does the work of the force equal what is stored plus what is lost?

States at chosen times in, balance out. The residual of a panel between two times is the work of the force there minus
losses minus change of stored energy: 0 for an exact solution. Powers are sharp peaks where felt is hit or
sliding turns round, so panels are split where Simpson's rule or the balance itself is not yet good enough.
A balance that stays open when panels are split is the solution's fault, and is reported in ``residual``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model import Action
from model.inside.observe_motion import integrate_panels, panel_edges
from tests.model.verification.energy import energy_terms

Array = NDArray[np.float64]
States = Callable[[Array], tuple[Array, Array]]

FLOWS = ("input", "joint_friction", "contact_friction", "felt_damping", "rail", "shank")


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
    span: tuple[float, float],
    force: tuple[ArrayLike, ArrayLike],
    *,
    effects: Sequence[str] = (),
    panel_s: float = 5e-4,
    goal: float = 1e-6,
    rounds: int = 12,
) -> Audit:
    """Energy balance over ``span``, from its first to its second time (s).

    Parameters
    ----------
    states : gives angles and speeds, (m, 5) each, at increasing times (m,) s; called once per round
    force : times (k,) s and force on the key (k,) N, linear between its points
    effects : of the scene that moved, in the order of its coordinates (`model.parameters.effects`)
    panel_s : longest panel, s
    goal : share of the turnover up to which errors of the integration over time are pursued
    rounds : how often panels are split at most; bodies jammed into each other part within nanoseconds
    """
    start, end = span
    knots, forces = (np.asarray(column, float) for column in force)
    seen: dict[str, float] = {}

    def sample(times: Array) -> tuple[Array, Array]:
        q, v = states(times)
        stored, powers = energy_terms(action, q, v, np.interp(times, knots, forces), effects)
        total = np.sum(list(stored.values()), axis=0)
        if not seen:  # the first round covers all of the motion
            seen["start"] = float(total[0])
            swing = max(float(np.ptp(part)) for part in stored.values())
            given = float(np.trapezoid(np.abs(powers["input"]), times))
            seen["turnover"] = given + swing + float(np.max(stored["felt"] + stored["rail"]))
        return np.stack([powers[name] for name in FLOWS], axis=1), total

    panels = integrate_panels(
        sample,
        panel_edges(start, end, panel_s, knots),
        np.array([1.0] + [-1.0] * (len(FLOWS) - 1)),
        lambda: goal * seen["turnover"] / 100.0,
        rounds,
    )
    turnover = seen["turnover"]
    sums = np.vstack([np.zeros(len(FLOWS)), np.cumsum(panels.integral, axis=0)])
    residual = np.concatenate([[0.0], np.cumsum(panels.rest)])
    scale = turnover if turnover > 0.0 else 1.0
    return Audit(
        time_s=np.concatenate([[start], panels.end_s]),
        flow_j={name: sums[:, i] for i, name in enumerate(FLOWS)},
        stored_j=np.concatenate([[seen["start"]], panels.level]),
        residual_j=residual,
        turnover_j=turnover,
        residual=float(np.max(np.abs(residual))) / scale,
        quadrature=float(panels.error_bound.sum()) / scale,
    )
