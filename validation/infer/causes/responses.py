"""What the model does where something is wrong in some trials: runs side by side.

Conventions: differences are measured less predicted, channel after channel, (3 m,) rad, at phases that the trials
share. Derivatives are differences of runs of one trial, which stands for the others of its condition.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

import model
from model.errors import ModelError
from model.parameters.effects import KEY_LIFT, RAIL
from validation.conventions import ENCODER_BODIES, Array
from validation.events.key_lift import SCALE_RADIUS_M
from validation.infer.blocks import rows
from validation.infer.channels import CLOCK, DELAY, FORCE_DELAY, FORCE_GAIN, FORCE_LEVEL
from validation.infer.hypotheses import LEAST_ADDED, Source, candidates
from validation.infer.observations import ENCODERS, ObservedTrial
from validation.infer.response import SEGMENTS, noise_knots, slow_noise_n
from validation.prediction.joint_draws import drawn_tolerance
from validation.prediction.many_runs import Run, coarse_force, run_many
from validation.prediction.model_under_test import ModelUnderTest

FINE_SPACING_S = 2e-4  # of the force's points: at 0.6 ms the memory of a felt came out 3 standard uncertainties off
BUMP_N = 0.1  # for differences, of the whole force or at one knot


@dataclass(frozen=True)
class Point:
    """Where the model is run: amounts of some candidates, index -> amount."""

    amounts: tuple[tuple[int, float], ...] = ()


@dataclass(frozen=True)
class _Place:
    """Where one trial is run: amounts of sources, index -> amount; an offset of the force; the knot of its noise that
    is raised, -1 for none."""

    amounts: tuple[tuple[int, float], ...] = ()
    offset_n: float = 0.0
    knot: int = -1


MOST_RUN = 2  # trials, where all have the same amounts; others are moved as these are


class Responses:
    """The model under test in some trials.

    Parameters
    ----------
    tested : ModelUnderTest
    trials : sequence of ObservedTrial
        Of one kind of stroke.
    listed : sequence of Source

    Attributes
    ----------
    candidates : `candidates` of the sources in these trials
    """

    def __init__(self, tested: ModelUnderTest, trials: Sequence[ObservedTrial], listed: Sequence[Source]) -> None:
        self.tested, self.trials, self.listed = tested, tuple(trials), tuple(listed)
        self.candidates = candidates(listed, [t.number for t in trials])
        self._read = {j: s for j, s in enumerate(listed) if s.error and s.error.kind not in ("", DELAY)}
        self.measured = np.array([rows(t.change_rad) for t in self.trials])
        self._known: list[Array] = []
        self._turned: dict[tuple[_Place, int], Array | None] = {}
        self._forces: dict[tuple[int, float, int], tuple[Array, Array]] = {}
        self._rests: dict[Any, tuple[model.Action, model.RestState] | None] = {}

    @cached_property
    def base(self) -> Array | None:
        """Measured less predicted by the unchanged model (trials, 3 m), rad; None where a trial cannot be run."""
        return self.exact_differences([Point()])[0]

    def exact_differences(self, points: Sequence[Point]) -> list[Array | None]:
        """Measured less predicted angles (trials, 3 m), rad, of key, whippen, hammer one after the other, at each point
        (amounts of candidates), every trial run; None where one cannot be run there.

        Those of points near by are found from there (`differences`).
        """
        trials = range(len(self.trials))
        places = [[self._place(point, t) for t in trials] for point in points]
        found = iter(self._read_all([(place, t) for of in places for t, place in enumerate(of)]))
        out: list[Array | None] = []
        for of in places:
            turns = [next(found) for _ in trials]
            known = [turn for turn in turns if turn is not None]
            out.append(self.measured - np.array(known) if len(known) == len(turns) else None)
            if out[-1] is not None and len(set(of)) == 1:
                self._known.append(out[-1])
        return out

    def differences(self, points: Sequence[Point]) -> list[Array | None]:
        """Measured less predicted angles (trials, 3 m), rad, of key, whippen, hammer one after the other, at each
        point, approximate where all trials have the same amounts: two are run, and the others move as these do on the
        average from the nearest point of `exact_differences`. None where a run fails.
        """
        base = self.base
        if base is None:
            return [None] * len(points)
        alike = [self._group_trials(point) for point in points]
        asked = [
            (place, t) for groups in alike for place, group in groups.items() for t in self._choose_run(groups, group)
        ]
        found = iter(self._read_all([(place, t) for place, t in asked if place.amounts]))
        out: list[Array | None] = []
        for groups in alike:
            each: Array | None = base.copy()
            for place, group in groups.items():
                run = self._choose_run(groups, group)
                turns = [next(found) for _ in run] if place.amounts else []
                if any(turn is None for turn in turns):
                    each = None
                elif turns and each is not None:
                    each[run] = self.measured[run] - np.array(turns)
                    others = group[len(run) :]
                    near = min(self._known, key=lambda known: float(np.sum((each[run] - known[run]) ** 2)))
                    each[others] = near[others] + (each[run] - near[run]).mean(axis=0)
            out.append(each)
        return out

    @staticmethod
    def _choose_run(groups: Mapping[_Place, list[int]], group: list[int]) -> list[int]:
        """Trials of a group that are run: what trials differ by is a matter of each."""
        return group[:MOST_RUN] if len(groups) == 1 else group

    def columns(
        self,
        asked: Sequence[tuple[Point, int, int]],
        here: Sequence[Array],
        longest: Sequence[float] | Array = (),
        central: bool = False,
    ) -> list[Array]:
        """Derivative (3 m,) of a predicted curve, rad per unit amount, for each (point, trial index, source index) in
        ``asked``, by differences of runs; zeros where the step cannot run. ``here``: for each the measured less
        predicted angles (trials, 3 m).

        Parameters
        ----------
        asked : point, index of the trial, index of the source
        here : differences (trials, 3 m) at each of the points
        longest : longest step of each difference; by default that of the source
        central : whether differences are central, which those of effects never are; causes that do the same have then
            the same derivatives, to whatever sides they bend the response
        """
        places, steps = [], []
        for n, (point, t, j) in enumerate(asked):
            at, source = self._place(point, t), self.listed[j]
            there = source.added and dict(at.amounts).get(j, 0.0) > LEAST_ADDED
            steps.append(min([LEAST_ADDED if there else source.step, *longest[n : n + 1]]))
            places.append((_add_amount(at, j, steps[-1]), t))
            if central and not source.added:
                places.append((_add_amount(at, j, -steps[-1]), t))
        out, found = [], iter(self._read_all(places))
        for (_, t, j), step, differences in zip(asked, steps, here, strict=True):
            predicted, above = self.measured[t] - differences[t], next(found)
            below = next(found) if central and not self.listed[j].added else None
            if above is None:
                out.append(np.zeros(predicted.size))
            else:
                out.append((above - predicted) / step if below is None else (above - below) / (2.0 * step))
        return out

    def force_columns(self, at: Point, t: int, here: Array) -> Array:
        """Derivatives (m, 3, 1 + SEGMENTS) of trial ``t``'s angles (key, whippen, hammer) at a point, rad per standard
        deviation of its force's offset and of the noise at each knot but the first; 0 where a run fails. ``here``:
        differences (trials, 3 m)."""
        trial, place = self.trials[t], self._place(at, t)
        places = [replace(place, offset_n=BUMP_N), *(replace(place, knot=k) for k in range(1, SEGMENTS + 1))]
        steps = np.array([BUMP_N, *SEGMENTS * [BUMP_N]])
        base = self.measured[t] - here[t]
        found = self._read_all([(p, t) for p in places])
        moved = np.column_stack([np.zeros(base.size) if turn is None else turn - base for turn in found]) / steps
        scaled = moved * np.concatenate([[trial.u_offset_n], knot_noise_n(trial)])
        return np.moveaxis(scaled.reshape(3, -1, scaled.shape[1]), 0, 1)

    def curve_changes(self, amounts: Array, here: Array, at: Point) -> Array:
        """Changes (draws, 3 m), rad, of predicted curves from the point ``at`` by drawn ``amounts`` (draws, p) of the
        sources, each draw in the next trial in turn; zero where a run fails. ``here``: measured less predicted angles
        (trials, 3 m) there.

        Parameters
        ----------
        amounts : (draws, p) drawn amounts of the sources
        here : differences (trials, 3 m) at the point
        at : the point
        """
        moved, trials = np.flatnonzero(np.any(amounts != 0.0, axis=0)), range(len(self.trials))
        there = [dict(self._place(at, t).amounts) for t in trials]
        places = []
        for k, z in enumerate(amounts):
            t = k % len(trials)
            total = there[t] | {int(j): there[t].get(int(j), 0.0) + float(z[j]) for j in moved}
            places.append((_Place(tuple(sorted(total.items()))), t))
        base = self.measured - here
        found = zip(places, self._read_all(places), strict=True)
        return np.array([0.0 * base[t] if turn is None else turn - base[t] for (_, t), turn in found])

    def _place(self, point: Point, t: int) -> _Place:
        """Amounts of the sources, index -> amount, that trial ``t`` (index) has at a point, which gives amounts of
        candidates; those that it lacks are left out."""
        amounts: dict[int, float] = {}
        for j, z in point.amounts:
            c = self.candidates[j]
            if c.weights[t] != 0.0:
                amounts[c.source] = amounts.get(c.source, 0.0) + self.listed[c.source].share(z, c.weights[t])
        return _Place(tuple(sorted(amounts.items())))

    def _group_trials(self, point: Point) -> dict[_Place, list[int]]:
        """Indices of the trials by their amounts."""
        groups: dict[_Place, list[int]] = {}
        for t in range(len(self.trials)):
            groups.setdefault(self._place(point, t), []).append(t)
        return groups

    def _read_all(self, asked: Sequence[tuple[_Place, int]]) -> list[Array | None]:
        """Encoder readings (3 m,), rad since rest, for each (place, trial index), with all errors of the place; equal
        requests run once, and runs are kept. None where the model cannot run."""
        runs = [
            (replace(place, amounts=tuple(a for a in place.amounts if a[0] not in self._read)), t) for place, t in asked
        ]
        missing = [one for one in dict.fromkeys(runs) if one not in self._turned]
        self._turned.update(zip(missing, self._run_all(missing), strict=True))
        return [self._read_encoders(self._turned[run], place) for run, (place, _) in zip(runs, asked, strict=True)]

    def _read_encoders(self, turned: Array | None, place: _Place) -> Array | None:
        """Encoder readings (3 m,), rad since rest, of the model's angles ``turned``, with the scale and zero errors of
        a place; delays are in ``turned`` already. None where ``turned`` is."""
        wrong = [(self._read[j], z) for j, z in place.amounts if j in self._read]
        if turned is None or not wrong:
            return turned
        read = turned.reshape(len(ENCODERS), -1).copy()
        for source, z in wrong:
            error = source.error
            assert error is not None
            size = source.at(1.0 if source.unit == "1" else 0.0, z)
            read[error.encoder] = error.reading(read[error.encoder], size)
        return read.ravel()

    def _reading_times(self, place: _Place, trial: ObservedTrial) -> Array:
        """Model times (3, m), s, whose angles each encoder reads at the trial's phases: earlier by its delay, rescaled
        for an error of the clock's rate, never before the force's record begins."""
        when = np.tile(trial.time_s, (len(ENCODERS), 1))
        rate = 1.0
        for j, z in place.amounts:
            source, error = self.listed[j], self.listed[j].error
            if error is not None and error.kind == DELAY:
                when[error.encoder] -= source.at(0.0, z)
            elif source.name == CLOCK:
                rate = source.at(rate, z)
        start = float(trial.force_time_s[0])
        return np.maximum(start + (when - start) / rate, start)  # the clock reads more seconds than passed

    def _run_all(self, asked: Sequence[tuple[_Place, int]]) -> list[Array | None]:
        """Encoder angles since rest (3 m,), rad, at each encoder's reading times, for each (place, trial index), by new
        runs; the key's include the lift of its pivot. None where the model cannot run."""
        runs = [self._run(place, self.trials[t]) for place, t in asked]

        def turn(i: int, solution: model.Solution) -> Array:
            run = runs[i]
            assert run is not None
            change = np.asarray(solution.angle_rad, dtype=float) - np.asarray(run.rest.angle_rad)
            if _can_lift(run.action):
                change[:, 0] += _lift_m(solution) / SCALE_RADIUS_M
            place, t = asked[i]
            at = np.searchsorted(run.output_time_s, self._reading_times(place, self.trials[t]))
            return np.concatenate([change[k, body] for k, body in zip(at, ENCODER_BODIES, strict=True)])

        return run_many(self.tested, runs, turn)

    def _run(self, place: _Place, trial: ObservedTrial) -> Run | None:
        """What to simulate for a trial at a place (not simulated here): action, rest, coarse force with its errors,
        output times. None where the action cannot rest or take an effect."""
        changed: dict[str, float] = {}
        added: list[tuple[Source, float]] = []
        error = {FORCE_GAIN: 1.0, FORCE_LEVEL: 0.0, FORCE_DELAY: 0.0, CLOCK: 1.0}
        for j, z in place.amounts:
            source = self.listed[j]
            changed |= source.values(self.tested.action, z)
            if source.added and z > LEAST_ADDED:
                added.append((source, z))
            if source.name in error:
                error[source.name] = source.at(error[source.name], z)
        gain, level = error[FORCE_GAIN], error[FORCE_LEVEL] - place.offset_n
        key = tuple(changed.items()), tuple(added), trial.preload_n - level
        if key not in self._rests:
            self._rests[key] = self._find_rest(changed, added, key[-1], trial.preload_n)
        found = self._rests[key]
        if found is None:
            return None
        action, rest = found
        when, read = self._coarse_force(trial, error[FORCE_DELAY], place.knot)
        table = when, (read - trial.preload_n) / gain + trial.preload_n - level
        start, rate = trial.force_time_s[0], error[CLOCK]
        if rate != 1.0:
            table = start + (table[0] - start) / rate, table[1]
        output = np.unique(self._reading_times(place, trial))
        if _can_lift(action) and start < output[0]:
            output = np.append(start, output)  # where the key's pivot was at rest
        return Run(action, rest, *table, output, drawn_tolerance(self.tested))

    def _coarse_force(self, trial: ObservedTrial, delay_s: float, knot: int) -> tuple[Array, Array]:
        """Coarse force table (time, s; force, N) of a trial, corrected for a reading ``delay_s`` late and raised by
        `BUMP_N` at noise knot ``knot`` (none below 0); cached."""
        key = trial.number, delay_s, knot
        if key not in self._forces:
            force = np.interp(trial.force_time_s + delay_s, trial.force_time_s, trial.force_n)
            if knot >= 0:
                knots = noise_knots(trial)
                force = force + np.interp(trial.force_time_s, knots, BUMP_N * (np.arange(knots.size) == knot))
            self._forces[key] = coarse_force(trial.force_time_s, force, FINE_SPACING_S)
        return self._forces[key]

    def _find_rest(
        self, changed: dict[str, float], added: Sequence[tuple[Source, float]], preload_n: float, declared_n: float
    ) -> tuple[model.Action, model.RestState] | None:
        """Action with values ``changed`` (path -> SI) and effects ``added`` (with amounts), and its rest under
        ``preload_n``; the search starts from the unchanged rest where that is ``declared_n``, N. None where it cannot
        rest or take an effect."""
        try:
            action = self.tested.action.with_values(changed) if changed else self.tested.action
            for source, z in added:
                scene = source.scene(action, z)
                if scene is None:
                    return None
                action = scene.apply_to(action)
            near = self.tested.load(declared_n).rest if preload_n == declared_n else None
            return action, self.tested.rest_of(action, preload_n, near)
        except ModelError:
            return None


def knot_noise_n(trial: ObservedTrial) -> Array:
    """Standard deviations (SEGMENTS,), N, of the force averaged around each knot but the first: of the sensor's noise,
    and of what the force does between its samples.

    A straight line between two samples misses the mean of a bent force by a twelfth of its second difference: where an
    arm hits the key again, by far more than the noise.
    """
    when, knots = trial.force_time_s, noise_knots(trial)
    missed = np.zeros(when.size)
    missed[1:-1] = np.diff(trial.force_n, 2) / 12.0
    edges = np.searchsorted(when, np.append(0.5 * (knots[:-1] + knots[1:]), when[-1]))
    power = np.append(0.0, np.cumsum(missed**2))
    mean = (power[edges[1:]] - power[edges[:-1]]) / np.maximum(np.diff(edges), 1)
    return np.asarray(slow_noise_n(replace(trial, noise_n=1.0)) * np.hypot(trial.noise_n, np.sqrt(mean)))


def _can_lift(action: model.Action) -> bool:
    """Whether the key's pivot can rise."""
    return not {RAIL, "key_pin"}.isdisjoint(model.choice_of(action).effects)


def _lift_m(solution: model.Solution) -> Array:
    """How far the key's pivot has risen: on its rail, or in its joint; the key's scale reads it as rotation."""
    rise = np.zeros(len(solution.time_s)) if solution.give is None else solution.give.joint_motion("key")[0][:, 1]
    if KEY_LIFT in solution.bodies:
        rise = np.asarray(solution.angle_rad)[:, solution.bodies.index(KEY_LIFT)]
    return rise - rise[0]


def _add_amount(place: _Place, j: int, step: float) -> _Place:
    """Copy of a point with the amount of source ``j`` (index) raised by ``step``."""
    amounts = dict(place.amounts)
    amounts[j] = amounts.get(j, 0.0) + step
    return replace(place, amounts=tuple(sorted(amounts.items())))
