"""What may be wrong with the model, by how much, and how well it is said to be known.

Conventions: amounts are in units of `Candidate.wrong`: a factor exp(wrong z), or wrong z added in SI. What is known of
a value (its stated u, or the joint uncertainty of an identified action) is taken out of every comparison; ``wrong`` is
how far off a value may be that is not what it is said to be: 30 % of a law, as in `unknowns.priors`, 10 % of a mass,
a millimetre of a length, and of the force 5 %, 0.1 N and 1 ms.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

import model
from validation.conventions import Array
from validation.identification.observations import ObservedTrial
from validation.identification.unknowns.naming import NORMAL, single_names
from validation.identification.unknowns.priors import FORCE_DELAY, FORCE_GAIN, FORCE_LEVEL, LAW_U, THRESHOLDS
from validation.prediction.posterior import posterior_of
from validation.prediction.principal_axes import principal_axes

MASS_WRONG, LENGTH_WRONG_M = 0.1, 1e-3
GAIN_WRONG, LEVEL_WRONG_N, DELAY_WRONG_S = 0.05, 0.1, 1e-3
LAWS = (".friction.A", ".joint_friction.A", ".normal.D", ".torque", ".stiffness")
MASSES = (".mass", ".inertia")
STEP, LENGTH_STEP = 0.33, 0.1  # of ``wrong``, for differences


@dataclass(frozen=True)
class Candidate:
    """One thing that may be wrong.

    Attributes
    ----------
    name : of a parameter, felt, or error of the force
    unit : SI unit of what is added; 1 means a factor
    paths : parameters of the action that move together; none for the force
    wrong : how far off it may be, as a logarithm where ``unit`` is 1
    known : its stated standard uncertainty, in units of ``wrong``
    law : whether it scatters from trial to trial
    named : whether it may be named; else it is only taken out
    step : for differences, in units of ``wrong``
    """

    name: str
    unit: str
    paths: tuple[str, ...]
    wrong: float
    known: float
    law: bool = False
    named: bool = True
    step: float = STEP

    def values(self, action: model.Action, z: float) -> dict[str, float]:
        """Values of its paths at ``z``."""
        return {path: self.at(action[path], z) for path in self.paths}

    def at(self, value: float, z: float) -> float:
        """A value changed by ``z``."""
        return value * math.exp(self.wrong * z) if self.unit == "1" else value + self.wrong * z


def candidates(action: model.Action, trial: ObservedTrial) -> tuple[Candidate, ...]:
    """Everything that may be wrong: the force of a trial first, then the action's values."""
    found = [
        Candidate(FORCE_GAIN, "1", (), GAIN_WRONG, math.log1p(trial.u_gain) / GAIN_WRONG),
        Candidate(FORCE_LEVEL, "N", (), LEVEL_WRONG_N, trial.u_preload_n / LEVEL_WRONG_N),
        Candidate(FORCE_DELAY, "s", (), DELAY_WRONG_S, trial.u_delay_s / DELAY_WRONG_S, step=LENGTH_STEP),
    ]
    for name, paths in sorted(single_names(action).items()):
        lead = action.quantities[paths[0]]
        relative = lead.u / abs(lead.value)
        law = len(paths) > 1 or name.endswith(LAWS)
        if law or name.endswith(MASSES):
            wrong = LAW_U if law else MASS_WRONG
            found.append(Candidate(name, "1", paths, wrong, relative / wrong, law))
        elif name in THRESHOLDS:
            found.append(Candidate(name, "1", paths, LAW_U, relative / LAW_U, named=False))
        elif lead.unit == "m":
            wrong = LENGTH_WRONG_M
            found.append(Candidate(name, "m", paths, wrong, lead.u / wrong, step=LENGTH_STEP))
        elif lead.u > 0.0 and not name.endswith(NORMAL):
            found.append(Candidate(name, lead.unit, paths, lead.u, 1.0, named=False))
    return tuple(found)


def known_root(action: model.Action, listed: Sequence[Candidate]) -> Array:
    """Root (p, k) of the covariance of what is known of the candidates; correlated where the action was identified."""
    root = np.diag([c.known for c in listed])
    before = posterior_of(action)
    if before is None:
        return root
    place = {c.name: i for i, c in enumerate(listed)}
    both = [(place[name], j) for j, name in enumerate(before.names) if name in place]
    mine, theirs = [i for i, _ in both], [j for _, j in both]
    unit = np.array([before.u[j] / listed[i].wrong for i, j in both])
    together = before.covariance[np.ix_(theirs, theirs)] * np.outer(unit, unit)
    values, vectors = principal_axes(together)
    root[mine] = 0.0
    root[np.ix_(mine, mine)] = vectors * np.sqrt(np.maximum(values, 0.0))
    return root
