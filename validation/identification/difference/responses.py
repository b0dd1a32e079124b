"""What the model does in each trial where some candidates are changed: runs side by side, under a force of few points.

Conventions: differences are measured less predicted, channel after channel, (3 m,) rad, at phases that the trials
share. Derivatives are differences of runs of one trial, which stands for the others: strokes of one kind.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

import model
from model.errors import ModelError
from validation.conventions import ENCODER_BODIES, Array
from validation.identification.blocks import rows
from validation.identification.force_runs import SEGMENTS, noise_knots, slow_noise_n
from validation.identification.observations import ObservedTrial
from validation.identification.unknowns import (
    FORCE_DELAY,
    FORCE_GAIN,
    FORCE_LEVEL,
    LAW_U,
    NORMAL,
    THRESHOLDS,
    lead_of,
    single_names,
)
from validation.prediction.joint_draws import drawn_tolerance
from validation.prediction.many_runs import Run, coarse_force, run_many
from validation.prediction.model_under_test import ModelUnderTest
from validation.prediction.posterior import posterior_of, principal_axes

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
    """Everything that may be wrong: the force of a trial first, then the action's values.

    Conventions: amounts are in units of `Candidate.wrong`: a factor exp(wrong z), or wrong z added in SI. What is known
    of a value (its stated u, or the joint uncertainty of an identified action) is taken out of every comparison;
    ``wrong`` is how far off a value may be that is not what it is said to be: 30 % of a law, as in `unknowns.priors`,
    10 % of a mass, a millimetre of a length, and of the force 5 %, 0.1 N and 1 ms.
    """
    found = [
        Candidate(FORCE_GAIN, "1", (), GAIN_WRONG, math.log1p(trial.u_gain) / GAIN_WRONG),
        Candidate(FORCE_LEVEL, "N", (), LEVEL_WRONG_N, trial.u_preload_n / LEVEL_WRONG_N),
        Candidate(FORCE_DELAY, "s", (), DELAY_WRONG_S, trial.u_delay_s / DELAY_WRONG_S, step=LENGTH_STEP),
    ]
    quantities = model.quantities_of(action)
    for name, paths in sorted(single_names(action).items()):
        lead = lead_of(quantities, paths)
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


OFFSET_N = 0.1
BUMP_N = 0.2


@dataclass(frozen=True)
class Point:
    """Where the model is run: amounts of some candidates, index -> amount; an offset, or one knot, of the force."""

    amounts: tuple[tuple[int, float], ...] = ()
    offset_n: float = 0.0
    knot: int = -1


class Responses:
    """The model under test in some trials.

    Parameters
    ----------
    tested : ModelUnderTest
    trials : sequence of ObservedTrial
        Of one kind of stroke; the first stands for all where derivatives are found.
    listed : sequence of Candidate
    """

    def __init__(self, tested: ModelUnderTest, trials: Sequence[ObservedTrial], listed: Sequence[Candidate]) -> None:
        self.tested, self.trials, self.listed = tested, tuple(trials), tuple(listed)
        self.runs = 0

    def differences(self, points: Sequence[Point]) -> list[Array | None]:
        """Differences (trials, 3 m) at each point; None where one of the trials cannot be run there."""
        found = self._turns([(point, trial) for point in points for trial in self.trials])
        measured = [rows(t.change_rad) for t in self.trials]
        out: list[Array | None] = []
        for i in range(len(points)):
            mine = found[i * len(self.trials) : (i + 1) * len(self.trials)]
            known = [m - turn for m, turn in zip(measured, mine, strict=True) if turn is not None]
            out.append(np.array(known) if len(known) == len(self.trials) else None)
        return out

    def columns(self, asked: Sequence[tuple[Point, int]], here: Sequence[Array]) -> list[Array]:
        """Derivative (3 m,) of the first trial at each point with respect to one candidate; zeros where none is found.

        ``here`` holds the differences (trials, 3 m) at each of the points.
        """
        steps = [self.listed[j].step for _, j in asked]
        points = [_moved(point, j, step) for (point, j), step in zip(asked, steps, strict=True)]
        found = self._turns([(point, self.trials[0]) for point in points])
        measured = rows(self.trials[0].change_rad)
        return [
            np.zeros(measured.size) if turn is None else (turn - (measured - at[0])) / step
            for turn, at, step in zip(found, here, steps, strict=True)
        ]

    def force_columns(self, at: Point, here: Array) -> Array:
        """Changes (m, 3, 1 + n) of the first trial under one u of its own force's offset, and parts of its noise."""
        first = self.trials[0]
        points = [replace(at, offset_n=OFFSET_N), *(replace(at, knot=k) for k in range(1, SEGMENTS + 1))]
        steps = np.array([OFFSET_N, *SEGMENTS * [BUMP_N]])
        base = rows(first.change_rad) - here[0]
        found = self._turns([(point, first) for point in points])
        moved = np.column_stack([np.zeros(base.size) if turn is None else turn - base for turn in found]) / steps
        scaled = moved * np.concatenate([[first.u_offset_n], slow_noise_n(first)])
        return np.moveaxis(scaled.reshape(3, -1, scaled.shape[1]), 0, 1)

    def _turns(self, asked: Sequence[tuple[Point, ObservedTrial]]) -> list[Array | None]:
        """Turns since rest (3 m,) of each run."""
        rests: dict[tuple[Point, float], tuple[model.Action, model.RestState] | None] = {}
        runs = [self._run(point, trial, rests) for point, trial in asked]
        self.runs += len(runs)

        def turn(i: int, solution: model.Solution) -> Array:
            run = runs[i]
            assert run is not None
            change = np.asarray(solution.angle_rad, dtype=float) - np.asarray(run.rest.angle_rad)
            return rows(change[:, ENCODER_BODIES])

        return run_many(self.tested, runs, turn)

    def _run(
        self,
        point: Point,
        trial: ObservedTrial,
        rests: dict[tuple[Point, float], tuple[model.Action, model.RestState] | None],
    ) -> Run | None:
        changed: dict[str, float] = {}
        force = {FORCE_GAIN: 1.0, FORCE_LEVEL: 0.0, FORCE_DELAY: 0.0}
        for j, z in point.amounts:
            candidate = self.listed[j]
            changed |= candidate.values(self.tested.action, z)
            if not candidate.paths:
                force[candidate.name] = candidate.at(force[candidate.name], z)
        gain, level = force[FORCE_GAIN], force[FORCE_LEVEL] + point.offset_n
        key = point, trial.preload_n
        if key not in rests:
            rests[key] = self._at_rest(changed, gain * trial.preload_n + level)
        found = rests[key]
        if found is None:
            return None
        action, rest = found
        driven = gain * np.interp(trial.force_time_s - force[FORCE_DELAY], trial.force_time_s, trial.force_n) + level
        if point.knot >= 0:
            knots = noise_knots(trial)
            driven = driven + np.interp(trial.force_time_s, knots, BUMP_N * (np.arange(knots.size) == point.knot))
        table = coarse_force(trial.force_time_s, driven)
        return Run(action, rest, *table, trial.time_s, drawn_tolerance(self.tested))

    def _at_rest(self, changed: dict[str, float], preload_n: float) -> tuple[model.Action, model.RestState] | None:
        try:
            action = self.tested.action.with_values(changed) if changed else self.tested.action
            return action, self.tested.rest_of(action, preload_n)
        except ModelError:
            return None


def _moved(point: Point, j: int, step: float) -> Point:
    """The point with one candidate moved further."""
    amounts = dict(point.amounts)
    amounts[j] = amounts.get(j, 0.0) + step
    return Point(tuple(sorted(amounts.items())))
