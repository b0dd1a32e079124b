"""What may be wrong, in which trials, and what the model does then: runs side by side, under a force of few points.

Conventions: differences are measured less predicted, channel after channel, (3 m,) rad, at phases that the trials
share. Derivatives are differences of runs of one trial, which stands for the others: strokes of one kind. What is wrong
with a channel is its error: a force gain of 0.9 reads 0.9 of the force that acted beside the preload, which is
declared and not read; a level of 0.1 N is a preload declared 0.1 N too large. Of an effect that the model does not
have, amount 1 is the effect as its file and the laws of felt state it, 2 gives twice as much (half the stiffness), and
0 is the model as it is.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

import model
from model.errors import ModelError
from model.parameters.action import CONTACTS
from model.parameters.effects import KEY_LIFT, PINS, RAIL, STRING_EFFECT
from validation.conventions import ENCODER_BODIES, ENCODER_CHANNELS, Array
from validation.events.key_lift import SCALE_RADIUS_M
from validation.infer.blocks import rows
from validation.infer.observations import ObservedTrial
from validation.infer.response import SEGMENTS, noise_knots, slow_noise_n
from validation.infer.unknowns import (
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

MASS_WRONG, LENGTH_WRONG_M, DRIVE_WRONG_M = 0.1, 1e-3, 5e-3  # the arm is set on the key by hand
GAIN_WRONG, LEVEL_WRONG_N, DELAY_WRONG_S = 0.05, 0.1, 1e-3
LAWS = (".friction.A", ".joint_friction.A", ".normal.D", ".torque", ".stiffness")
MASSES = (".mass", ".inertia")
STEP_SIZE, SMALL_STEP = 0.33, 0.1  # of ``wrong``, for differences


# from trial to trial, in units of ``wrong``: 2 % of a law, 0.3 % of the force (a bench's blows), 0.01 N, 0.05 ms,
# 0.1 % of a scale; of lengths in m
LAW_SCATTER, GAIN_SCATTER, LEVEL_SCATTER, DELAY_SCATTER = 0.07, 0.06, 0.1, 0.05
SCALE_SCATTER, LENGTH_SCATTER_M = 0.02, 3e-6
CLOCK = "clock rate"
ENCODER_SCALES = tuple(f"{name} encoder scale" for name in ENCODER_CHANNELS)
SESSION_ERRORS = (FORCE_GAIN, FORCE_LEVEL, FORCE_DELAY, CLOCK, *ENCODER_SCALES)
CLOCK_WRONG = 0.01
SCALE_WRONG = 0.05
ALL, ONE, TREND, STEP = "all", "one", "trend", "step"
FEWEST_TOLD_APART = 4  # trials, below which one trial cannot be told from a change between two of them
ADDED = "added "
MODES, MOST_MODES = "string.modes", 100.0  # so many, that it is as finely swung as any specimen
STIFF = -1.0  # power of the amount that stiffness goes with
SIZES: Mapping[str, tuple[tuple[str, float], ...]] = {
    "shank": (("shank.frequency_hz", 0.5 * STIFF),),
    STRING_EFFECT: (("string.tension", STIFF), ("string.mass", STIFF), (MODES, 0.0)),
    RAIL: ((f"{RAIL}.normal.c", STIFF),),
    **{pin: ((f"{pin}.stiffness", STIFF), (f"{pin}.damping", STIFF)) for pin in PINS},
}
"""What an effect's amount moves, first the value by which its size is told: a string of as much speed and less weight,
a joint of as long a time and less stiffness."""
MEMORIES = {"stulov": "tau", "hysteresis": "beta"}
"""Laws of felt that remembers, and the number that makes their memory larger."""
JOINTS = f"{ADDED}giving joints' stiffness"
FURTHEST, FURTHEST_ADDED, FURTHEST_OF_SESSION = 4.0, 10.0, 10.0
"""Amounts that are looked at: a part is what it is said to be to some degree, an amplifier or a clock need not be."""
LEAST_ADDED, STEP_ADDED = 0.03, 0.05  # amounts: below the first it is as if not there; the step once it is


@dataclass(frozen=True)
class Source:
    """One thing that may be wrong."""

    name: str  # of a parameter, a felt, or an error of the session
    unit: str  # SI unit of what is added; 1 means a factor
    paths: tuple[str, ...]  # parameters of the action that move together; none for an error of the session
    wrong: float  # how far off it may be, as a logarithm where ``unit`` is 1
    known: float  # its stated standard uncertainty, in units of ``wrong``
    law: bool = False  # whether it is a law: all together say what the model can do
    named: bool = True  # whether it may be named; else it is only taken out
    step: float = STEP_SIZE  # for differences, in units of ``wrong``
    scatter: float = 0.0  # from trial to trial, standard deviation in units of ``wrong``
    profiles: tuple[str, ...] = (ALL,)  # in which trials it may be wrong
    # effects, laws: what the model lacks and an amount adds to its scene: effects, and laws of felt by contact
    effects: tuple[str, ...] = ()
    laws: tuple[tuple[str, str], ...] = ()
    # paths with their values at amount 1, and the power of the amount that each goes with
    scaled: tuple[tuple[str, float, float], ...] = ()

    @property
    def added(self) -> bool:
        """Whether it is an effect that the model does not have."""
        return bool(self.scaled)

    def scene(self, action: model.Action, z: float) -> model.SceneChoice | None:
        """The scene of the action with so much of the effect; None where it has one that excludes it."""
        choice = model.choice_of(action)
        if set(self.effects) & set(choice.effects) or any(action.law(felt) in MEMORIES for felt, _ in self.laws):
            return None
        values = tuple((path, value * z**power) for path, value, power in self.scaled)
        return replace(choice, effects=(*choice.effects, *self.effects), laws=self.laws, values=values)

    def size(self, z: float, u: float) -> tuple[float, float]:
        """What a reader is told of an amount and its u: a factor and its relative u where ``unit`` is 1, else SI."""
        if not self.added:
            return self.at(1.0 if self.unit == "1" else 0.0, z), self.wrong * u
        _, value, power = self.scaled[0]
        size, relative = (1.0 if self.unit == "1" else value) * z**power, abs(power) * u / z
        return size, relative * (1.0 if self.unit == "1" else size)

    @property
    def kind(self) -> str:
        """What it is called in a list of all that was tried."""
        if not self.paths:
            return self.name
        return "laws of friction, felt and springs" if self.law else "lengths" if self.unit == "m" else "masses"

    def values(self, action: model.Action, z: float) -> dict[str, float]:
        """Values of its paths at ``z``."""
        return {path: self.at(action[path], z) for path in self.paths}

    def at(self, value: float, z: float) -> float:
        """A value changed by ``z``."""
        return value * math.exp(self.wrong * z) if self.unit == "1" else value + self.wrong * z

    @property
    def of_session(self) -> bool:
        """Whether it is an error of the session's channels or its clock."""
        return self.name in SESSION_ERRORS

    @property
    def of_setup(self) -> bool:
        """Whether it is an error of the session, or where the force acts, which is set by hand."""
        return self.of_session or self.name.startswith("drive")

    @property
    def furthest(self) -> float:
        """The largest amount that is looked at."""
        return FURTHEST_ADDED if self.added else FURTHEST_OF_SESSION if self.of_session else FURTHEST

    @property
    def encoder(self) -> int:
        """Channel whose scale it is; -1 for all else."""
        return ENCODER_SCALES.index(self.name) if self.name in ENCODER_SCALES else -1


@dataclass(frozen=True)
class Candidate:
    """One thing that may be wrong in some trials."""

    source: int  # its index
    # ``all`` trials, ``one``, a ``trend`` that grows evenly from the first trial on, a ``step`` at one trial
    profile: str
    weights: tuple[float, ...]  # (trials,) share of the amount that each trial has
    # first, last: numbers of the first and last trial that has it
    first: int
    last: int
    rarity: float  # negative logarithm of the share of what may be wrong that it has beforehand

    @property
    def seen_in(self) -> int:
        """Index of the trial that has most of it."""
        return int(np.argmax(np.abs(self.weights)))


def sources(action: model.Action, trial: ObservedTrial) -> tuple[Source, ...]:
    """Everything that may be wrong: the channels of the session first, then the action's values.

    Conventions: amounts are in units of `Source.wrong`: a factor exp(wrong z), or wrong z added in SI. What is known
    of a value (its stated u, or the joint uncertainty of an identified action) is taken out of every comparison;
    ``wrong`` is how far off a value may be that is not what it is said to be: 30 % of a law, as in `unknowns.priors`,
    10 % of a mass, a millimetre of a length, 5 mm of where the force acts, of the force 5 %, 0.1 N and 1 ms, 5 % of an
    encoder's scale and 1 % of the rate of the clock. The force may be wrong in one trial, drift or jump; laws drift or
    jump; where a contact is or the force acts jumps, as a scale does; the clock's rate, masses, pivots and centres of
    mass are what they are.
    """
    every, lasting = (ALL, ONE, TREND, STEP), (ALL, STEP)
    gain, level, delay = math.log1p(trial.u_gain) / GAIN_WRONG, trial.u_preload_n / LEVEL_WRONG_N, trial.u_delay_s
    found = [
        Source(FORCE_GAIN, "1", (), GAIN_WRONG, gain, scatter=GAIN_SCATTER, profiles=every),
        Source(FORCE_LEVEL, "N", (), LEVEL_WRONG_N, level, scatter=LEVEL_SCATTER, profiles=every),
        Source(
            FORCE_DELAY, "s", (), DELAY_WRONG_S, delay / DELAY_WRONG_S,
            step=SMALL_STEP, scatter=DELAY_SCATTER, profiles=every,
        ),
        Source(CLOCK, "1", (), CLOCK_WRONG, 0.0),
        *(
            Source(name, "1", (), SCALE_WRONG, 0.0, scatter=SCALE_SCATTER, profiles=(ALL, ONE, STEP))
            for name in ENCODER_SCALES
        ),
    ]  # fmt: skip
    quantities = model.quantities_of(action)
    for name, paths in sorted(single_names(action).items()):
        lead = lead_of(quantities, paths)
        relative = lead.u / abs(lead.value)
        law = len(paths) > 1 or name.endswith(LAWS)
        if law or name.endswith(MASSES):
            wrong = LAW_U if law else MASS_WRONG
            profiles = (ALL, TREND, STEP) if law else (ALL,)
            scatter = LAW_SCATTER if law else 0.0
            found.append(Source(name, "1", paths, wrong, relative / wrong, law, scatter=scatter, profiles=profiles))
        elif name in THRESHOLDS:
            found.append(Source(name, "1", paths, LAW_U, relative / LAW_U, named=False))
        elif lead.unit == "m":
            drive = name.startswith("drive")
            wrong = DRIVE_WRONG_M if drive else LENGTH_WRONG_M
            known, moves, scatter = lead.u / wrong, lasting if drive or "contact" in name else (ALL,), LENGTH_SCATTER_M
            found.append(
                Source(name, "m", paths, wrong, known, step=SMALL_STEP, scatter=scatter / wrong, profiles=moves)
            )
        elif lead.u > 0.0 and not name.endswith(NORMAL):
            found.append(Source(name, lead.unit, paths, lead.u, 1.0, named=False))
    return (*found, *addable(action))


def addable(action: model.Action) -> Iterator[Source]:
    """Effects that the action does not have: of its parts, of all joints together, and memory of each felt."""

    def source(effects: Sequence[str], sizes: Sequence[tuple[str, float]], name: str = "", **laws: str) -> Source:
        scaled = tuple((path, MOST_MODES if path == MODES else action[path], power) for path, power in sizes)
        unit = "1" if name else action.effects[sizes[0][0]].unit
        return Source(
            name or f"{ADDED}{sizes[0][0]}", unit, (), 1.0, 0.0,
            step=1.0, effects=tuple(effects), laws=tuple(laws.items()), scaled=scaled,
        )  # fmt: skip

    choice = model.choice_of(action)
    for effect, sizes in SIZES.items():
        if effect not in choice.effects:
            yield source([effect], sizes)
    if not {RAIL, *PINS} & set(choice.effects):
        yield source([RAIL, *PINS], [size for pin in PINS for size in SIZES[pin]], JOINTS)
    for felt in CONTACTS:
        if action.law(felt) not in MEMORIES and felt not in choice.without:
            for law, number in MEMORIES.items():
                yield source([], [(f"{felt}.{law}.{number}", 1.0)], **{felt: law})


def candidates(listed: Sequence[Source], numbers: Sequence[int]) -> tuple[Candidate, ...]:
    """Every source that may be named, in all trials, in one, as a trend, and from one trial on.

    Half of what may be wrong is so in all trials, the rest evenly a matter of one trial, a trend, a step, of the
    session and of the model: each share is that of all candidates of the kind together. Of what may be wrong in one, a
    step at the second trial is the first trial alone, one at the last trial that trial alone.

    Parameters
    ----------
    listed : sources
    numbers : of the trials, in the order of the trials
    """
    found: list[Candidate] = []
    for k, source in enumerate(listed):
        if source.named:
            wanted = source.profiles if len(numbers) >= FEWEST_TOLD_APART else (ALL,)
            found += [
                Candidate(k, profile, tuple(weights), first, last, 0.0)
                for profile in wanted
                for weights, first, last in _profile(profile, numbers, ONE in wanted)
            ]
    kinds = [(c.profile, c.profile != ALL and listed[c.source].of_session) for c in found]
    share = {kind: 0.5 / max(len(set(kinds)) - 1, 1) if kind[0] != ALL else 0.5 for kind in set(kinds)}
    among = {kind: kinds.count(kind) * sum(share.values()) / share[kind] for kind in share}
    return tuple(replace(c, rarity=math.log(among[kind])) for c, kind in zip(found, kinds, strict=True))


def _profile(profile: str, numbers: Sequence[int], apart: bool) -> Iterator[tuple[NDArray[Any], int, int]]:
    """Weights of the trials, first and last number."""
    at, order = np.array(numbers), sorted(numbers)
    if profile == ALL:
        yield np.ones(at.size), order[0], order[-1]
    elif profile == ONE:
        yield from ((1.0 * (at == n), n, n) for n in order)
    elif profile == TREND:
        yield (at - order[0]) / (order[-1] - order[0]), order[0], order[-1]
    else:
        yield from ((1.0 * (at >= n), n, order[-1]) for n in (order[2:-1] if apart else order[1:]))


def known_root(action: model.Action, listed: Sequence[Source]) -> Array:
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
    """Where the model is run: amounts of some candidates, index -> amount."""

    amounts: tuple[tuple[int, float], ...] = ()


@dataclass(frozen=True)
class _Place:
    """Where one trial is run: amounts of sources, index -> amount; an offset, or one knot, of the force."""

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
        Of one kind of stroke; the first stands for all where derivatives are found.
    listed : sequence of Source

    Attributes
    ----------
    candidates : `candidates` of the sources in these trials
    """

    def __init__(self, tested: ModelUnderTest, trials: Sequence[ObservedTrial], listed: Sequence[Source]) -> None:
        self.tested, self.trials, self.listed = tested, tuple(trials), tuple(listed)
        self.candidates = candidates(listed, [t.number for t in trials])
        self.measured = np.array([rows(t.change_rad) for t in self.trials])
        self._known: list[Array] = []
        self._turned: dict[tuple[_Place, int], Array | None] = {}
        self._rests: dict[Any, tuple[model.Action, model.RestState] | None] = {}

    @cached_property
    def base(self) -> Array | None:
        """Differences (trials, 3 m) of the model as it is; None where one of the trials cannot be run."""
        return self.exact(Point())

    def exact(self, point: Point) -> Array | None:
        """Differences (trials, 3 m) with every trial run; those of points near by are found from there."""
        places = [self._place(point, t) for t in range(len(self.trials))]
        found = self._turns([(place, t) for t, place in enumerate(places)])
        known = [turn for turn in found if turn is not None]
        if len(known) < len(found):
            return None
        self._known.append(self.measured - np.array(known))
        return self._known[-1]

    def differences(self, points: Sequence[Point]) -> list[Array | None]:
        """Differences (trials, 3 m) at each point; None where a trial cannot be run there.

        Where all trials have the same, two are run, and the others move as these do on the average, from the nearest
        point where all were run (`exact`).
        """
        base = self.base
        if base is None:
            return [None] * len(points)
        alike = [self._alike(point) for point in points]
        asked = [(place, t) for groups in alike for place, group in groups.items() for t in self._run_of(groups, group)]
        found = iter(self._turns([(place, t) for place, t in asked if place.amounts]))
        out: list[Array | None] = []
        for groups in alike:
            each: Array | None = base.copy()
            for place, group in groups.items():
                run = self._run_of(groups, group)
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
    def _run_of(groups: Mapping[_Place, list[int]], group: list[int]) -> list[int]:
        """Trials of a group that are run: what trials differ by is a matter of each."""
        return group[:MOST_RUN] if len(groups) == 1 else group

    def columns(self, asked: Sequence[tuple[Point, int, int]], here: Sequence[Array]) -> list[Array]:
        """Derivative (3 m,) of one trial's prediction with respect to one source; zeros where none is found.

        Parameters
        ----------
        asked : point, index of the trial, index of the source
        here : differences (trials, 3 m) at each of the points
        """
        places, steps = [], []
        for point, t, j in asked:
            at, source = self._place(point, t), self.listed[j]
            there = source.added and dict(at.amounts).get(j, 0.0) > LEAST_ADDED
            steps.append(STEP_ADDED if there else source.step)
            places.append((_moved(at, j, steps[-1]), t))
        scales = [self.listed[j].encoder for _, _, j in asked]
        found = iter(self._turns([p for p, scale in zip(places, scales, strict=True) if scale < 0]))
        out = []
        for (_, t, j), step, scale, differences in zip(asked, steps, scales, here, strict=True):
            predicted = self.measured[t] - differences[t]
            if scale >= 0:
                channel = np.repeat(np.arange(len(ENCODER_SCALES)), predicted.size // len(ENCODER_SCALES))
                out.append(np.where(channel == scale, self.listed[j].wrong * predicted, 0.0))
                continue
            turn = next(found)
            out.append(np.zeros(predicted.size) if turn is None else (turn - predicted) / step)
        return out

    def force_columns(self, at: Point, here: Array) -> Array:
        """Changes (m, 3, 1 + n) of the first trial under one u of its own force's offset, and parts of its noise."""
        first, place = self.trials[0], self._place(at, 0)
        places = [replace(place, offset_n=OFFSET_N), *(replace(place, knot=k) for k in range(1, SEGMENTS + 1))]
        steps = np.array([OFFSET_N, *SEGMENTS * [BUMP_N]])
        base = self.measured[0] - here[0]
        found = self._turns([(p, 0) for p in places])
        moved = np.column_stack([np.zeros(base.size) if turn is None else turn - base for turn in found]) / steps
        scaled = moved * np.concatenate([[first.u_offset_n], slow_noise_n(first)])
        return np.moveaxis(scaled.reshape(3, -1, scaled.shape[1]), 0, 1)

    def scattered(self, amounts: Array, here: Array) -> Array:
        """Changes (draws, 3 m) of the curves of the trials in turn, with amounts (draws, p); zero where a run fails."""
        moved = np.flatnonzero(np.any(amounts != 0.0, axis=0))
        places = [
            (_Place(tuple((int(j), float(z[j])) for j in moved)), k % len(self.trials)) for k, z in enumerate(amounts)
        ]
        base = self.measured - here
        found = zip(places, self._turns(places), strict=True)
        return np.array([0.0 * base[t] if turn is None else turn - base[t] for (_, t), turn in found])

    def _place(self, point: Point, t: int) -> _Place:
        amounts: dict[int, float] = {}
        for j, z in point.amounts:
            c = self.candidates[j]
            if c.weights[t] != 0.0:
                amounts[c.source] = amounts.get(c.source, 0.0) + z * c.weights[t]
        return _Place(tuple(sorted(amounts.items())))

    def _alike(self, point: Point) -> dict[_Place, list[int]]:
        """Indices of the trials by their amounts."""
        groups: dict[_Place, list[int]] = {}
        for t in range(len(self.trials)):
            groups.setdefault(self._place(point, t), []).append(t)
        return groups

    def _turns(self, asked: Sequence[tuple[_Place, int]]) -> list[Array | None]:
        """Turns since rest (3 m,) of each run, as the encoders would read them; what is asked twice is run once."""
        missing = [one for one in dict.fromkeys(asked) if one not in self._turned]
        self._turned.update(zip(missing, self._run_all(missing), strict=True))
        return [self._turned[one] for one in asked]

    def _run_all(self, asked: Sequence[tuple[_Place, int]]) -> list[Array | None]:
        runs = [self._run(place, self.trials[t]) for place, t in asked]

        def turn(i: int, solution: model.Solution) -> Array:
            run = runs[i]
            assert run is not None
            change = np.asarray(solution.angle_rad, dtype=float) - np.asarray(run.rest.angle_rad)
            if _lifts(run.action):
                change[:, 0] += _lift_m(solution) / SCALE_RADIUS_M
            change = change[change.shape[0] - self.trials[asked[i][1]].time_s.size :]
            scale = np.ones(len(ENCODER_SCALES))
            for j, z in asked[i][0].amounts:
                if self.listed[j].encoder >= 0:
                    scale[self.listed[j].encoder] *= self.listed[j].at(1.0, z)
            return rows(change[:, ENCODER_BODIES] * scale)

        return run_many(self.tested, runs, turn)

    def _run(self, place: _Place, trial: ObservedTrial) -> Run | None:
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
            self._rests[key] = self._at_rest(changed, added, key[-1])
        found = self._rests[key]
        if found is None:
            return None
        action, rest = found
        read = np.interp(trial.force_time_s + error[FORCE_DELAY], trial.force_time_s, trial.force_n)
        driven = (read - trial.preload_n) / gain + trial.preload_n - level
        if place.knot >= 0:
            knots = noise_knots(trial)
            driven = driven + np.interp(trial.force_time_s, knots, BUMP_N * (np.arange(knots.size) == place.knot))
        table = coarse_force(trial.force_time_s, driven)
        start, rate = trial.force_time_s[0], error[CLOCK]
        if rate != 1.0:  # the clock reads more seconds than passed
            table = start + (table[0] - start) / rate, table[1]
        output = trial.time_s if rate == 1.0 else start + (trial.time_s - start) / rate
        if _lifts(action) and start < output[0]:
            output = np.append(start, output)  # where the key's pivot was at rest
        return Run(action, rest, *table, output, drawn_tolerance(self.tested))

    def _at_rest(
        self, changed: dict[str, float], added: Sequence[tuple[Source, float]], preload_n: float
    ) -> tuple[model.Action, model.RestState] | None:
        try:
            action = self.tested.action.with_values(changed) if changed else self.tested.action
            for source, z in added:
                scene = source.scene(action, z)
                if scene is None:
                    return None
                action = scene.apply_to(action)
            return action, self.tested.rest_of(action, preload_n)
        except ModelError:
            return None


def _lifts(action: model.Action) -> bool:
    """Whether the key's pivot can rise."""
    return not {RAIL, "key_pin"}.isdisjoint(model.choice_of(action).effects)


def _lift_m(solution: model.Solution) -> Array:
    """How far the key's pivot has risen: on its rail, or in its joint; the key's scale reads it as rotation."""
    rise = np.zeros(len(solution.time_s)) if solution.give is None else solution.give.joint_motion("key")[0][:, 1]
    if KEY_LIFT in solution.bodies:
        rise = np.asarray(solution.angle_rad)[:, solution.bodies.index(KEY_LIFT)]
    return rise - rise[0]


def _moved(place: _Place, j: int, step: float) -> _Place:
    """The place with one source moved further."""
    amounts = dict(place.amounts)
    amounts[j] = amounts.get(j, 0.0) + step
    return replace(place, amounts=tuple(sorted(amounts.items())))
