"""What the model does in each trial where some candidates are changed: runs side by side, under a force of few points.

Conventions: differences are measured less predicted, channel after channel, (3 m,) rad, at phases that the trials
share. Derivatives are differences of runs of one trial, which stands for the others: strokes of one kind.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

import model
from model.errors import ModelError
from validation.conventions import ENCODER_BODIES, Array
from validation.identification.blocks import rows
from validation.identification.difference.candidates import Candidate
from validation.identification.observations import ObservedTrial
from validation.identification.runs.force_noise import SEGMENTS, noise_knots, slow_noise_n
from validation.identification.unknowns.priors import FORCE_DELAY, FORCE_GAIN, FORCE_LEVEL
from validation.prediction.coarse_force import coarse_force
from validation.prediction.joint_draws import drawn_tolerance
from validation.prediction.many_runs import Run, run_many
from validation.prediction.model_under_test import ModelUnderTest

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
