"""What may differ from what is stated, and in which trials: errors of channels, values of the action, effects.

Conventions: of an effect that the model does not have, amount 1 is the effect as its file and the laws of felt state
it, 2 gives twice as much (half the stiffness), and 0 is the model as it is.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

import model
from model.parameters.action import CONTACTS
from model.parameters.effects import PINS, RAIL, STRING_EFFECT
from validation.conventions import Array
from validation.infer.channels import (
    CHANNEL_ERRORS,
    CLOCK,
    ERROR_BY_NAME,
    FORCE_DELAY,
    FORCE_GAIN,
    FORCE_LEVEL,
    ChannelError,
)
from validation.infer.noise import NULL_SCATTER
from validation.infer.observations import ObservedTrial
from validation.infer.unknowns import LAW_U, NORMAL, THRESHOLDS, lead_of, single_names
from validation.prediction.posterior import Posterior, posterior_of, principal_axes
from validation.statistics.repeatability import FEWEST_TO_STAND_OUT

MASS_WRONG, LENGTH_WRONG_M, DRIVE_WRONG_M = 0.1, 1e-3, 5e-3  # the arm is set on the key by hand
LAWS = (".friction.A", ".joint_friction.A", ".normal.D", ".torque", ".stiffness")
MASSES = (".mass", ".inertia")
STEP_SIZE, SMALL_STEP = 0.33, 0.1  # of ``wrong``, for differences
LENGTH_SCATTER_M = 3e-6  # from trial to trial
ALL, ONE, TREND, STEP = "all", "one", "trend", "step"
FEWEST_TOLD_APART = FEWEST_TO_STAND_OUT  # trials, below which one cannot be told from a change between two
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
FURTHEST, FURTHEST_OTHERS = 4.0, 10.0
"""Amounts that are looked at: a part is what it is said to be to some degree, an amplifier or a clock need not be."""
LEAST_ADDED = 0.03  # amount: below it is as if not there; the step once it is


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
        """Scene of the action with the amount ``z`` of the effect added; None where the action excludes it."""
        choice = model.choice_of(action)
        if set(self.effects) & set(choice.effects) or any(action.law(felt) in MEMORIES for felt, _ in self.laws):
            return None
        values = tuple((path, value * z**power) for path, value, power in self.scaled)
        return replace(choice, effects=(*choice.effects, *self.effects), laws=self.laws, values=values)

    def size(self, z: float, u: float) -> tuple[float, float]:
        """Size and its u for a reader: a factor and its relative u where ``unit`` is 1, else in SI units."""
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

    def share(self, z: float, w: float) -> float:
        """Amount that has the share ``w`` of the change by the amount ``z``: of a factor of 1.5 half is 1.25."""
        return w * z if self._is_linear else math.log1p(w * math.expm1(self.wrong * z)) / self.wrong

    def share_slope(self, z: float, w: float) -> float:
        """Derivative of `share` by ``z``."""
        factor = math.exp(self.wrong * z)
        return w if self._is_linear else w * factor / (1.0 + w * (factor - 1.0))

    @property
    def _is_linear(self) -> bool:
        """Whether what it changes goes in proportion with its amount."""
        return self.added or self.unit != "1"

    @property
    def error(self) -> ChannelError | None:
        """The error of a channel that it is; None of the model."""
        return ERROR_BY_NAME.get(self.name)

    @property
    def furthest(self) -> float:
        """The largest amount that is looked at."""
        return FURTHEST_OTHERS if self.added or self.error else FURTHEST


@dataclass(frozen=True)
class Candidate:
    """One thing that may be wrong in some trials."""

    source: int  # its index
    # ``all`` trials, ``one``, a ``trend`` that grows evenly from the first trial on, a ``step`` at one trial
    profile: str
    weights: tuple[float, ...]  # (trials,) share of the amount that each trial has
    # first, last: numbers of the first and last trial that has it; of a trend, those between which it grows
    first: int
    last: int

    @property
    def seen_in(self) -> int:
        """Index of the trial that has most of it."""
        return int(np.argmax(np.abs(self.weights)))


def sources(action: model.Action, trial: ObservedTrial) -> tuple[Source, ...]:
    """All possible causes in a session like ``trial``, whose declared u of the force are taken: errors of its channels,
    values of the action, effects that the action lacks, in this order.

    Conventions: an amount z is a factor exp(wrong z), or wrong z added in SI. What is known
    of a value (its stated u, or the joint uncertainty of an identified action) is taken out of every comparison;
    ``wrong`` is how far off a value may be that is not what it is said to be: 30 % of a law (`unknowns.LAW_U`),
    10 % of a mass, a millimetre of a length, 5 mm of where the force acts. A channel may be wrong in all trials, in
    one, drift or jump; laws drift or jump; where a contact is or the force acts jumps; the clock's rate, masses, pivots
    and centres of mass are what they are. What is declared of an encoder is in the noise model.
    """
    every, lasting = (ALL, ONE, TREND, STEP), (ALL, STEP)
    declared = {FORCE_GAIN: math.log1p(trial.u_gain), FORCE_LEVEL: trial.u_preload_n, FORCE_DELAY: trial.u_delay_s}
    found = [
        Source(
            e.name, e.unit, (), e.wrong, declared.get(e.name, 0.0) / e.wrong,
            step=SMALL_STEP if e.unit == "s" else STEP_SIZE, profiles=(ALL,) if e.name == CLOCK else every,
        )
        for e in CHANNEL_ERRORS
    ]  # fmt: skip
    quantities = model.quantities_of(action)
    for name, paths in sorted(single_names(action).items()):
        lead = lead_of(quantities, paths)
        relative = lead.u / abs(lead.value)
        law = len(paths) > 1 or name.endswith(LAWS)
        if law or name.endswith(MASSES):
            wrong = LAW_U if law else MASS_WRONG
            profiles = (ALL, TREND, STEP) if law else (ALL,)
            scatter = NULL_SCATTER if law else 0.0
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
            wrong = relative if lead.unit == "1" else lead.u
            found.append(Source(name, lead.unit, paths, wrong, 1.0, named=False))
    return (*found, *list_addable_effects(action))


def list_addable_effects(action: model.Action) -> Iterator[Source]:
    """Yield as a `Source` each effect that the action lacks: of its parts, of all joints together, and two laws of
    hereditary felt for each contact."""

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
    """Each source that may be named, once for every way in which trials may have it: all, one, a trend, or from one on
    (all only, for fewer than four trials); ``numbers``: the trials' numbers in their order.

    Of what may be wrong in one, a step at the second trial is the first trial alone, one at the last trial that trial
    alone.
    """
    found: list[Candidate] = []
    for k, source in enumerate(listed):
        if source.named:
            wanted = source.profiles if len(numbers) >= FEWEST_TOLD_APART else (ALL,)
            found += [
                Candidate(k, profile, tuple(weights), first, last)
                for profile in wanted
                for weights, first, last in _list_weights(profile, numbers, ONE in wanted)
            ]
    return tuple(found)


def _list_weights(profile: str, numbers: Sequence[int], apart: bool) -> Iterator[tuple[NDArray[Any], int, int]]:
    """Yield (weights (trials,), first, last) for every way of ``profile``: the share of the amount that each trial has,
    and the numbers of the first and last that have it; ``apart``: single trials are candidates, too, so that such steps
    are left out."""
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
    """Root L (p, p) of the prior covariance L Lᵀ of the amounts of the ``listed`` sources, in units of `Source.wrong`:
    diagonal, but for the parameters that an identified action's posterior correlates."""
    root = np.diag([c.known for c in listed])
    before = posterior_of(action)
    if before is None:
        return root
    place = {c.name: i for i, c in enumerate(listed)}
    both = [(place[name], j) for j, name in enumerate(before.names) if name in place]
    mine, theirs = [i for i, _ in both], [j for _, j in both]
    unit = np.array([_relative_u(before, j, listed[i], action) / listed[i].wrong for i, j in both])
    together = before.covariance[np.ix_(theirs, theirs)] * np.outer(unit, unit)
    values, vectors = principal_axes(together)
    root[mine] = 0.0
    root[np.ix_(mine, mine)] = vectors * np.sqrt(np.maximum(values, 0.0))
    return root


def _relative_u(before: Posterior, j: int, source: Source, action: model.Action) -> float:
    """Prior standard uncertainty of the j-th parameter of an identification in the unit of a source: relative where its
    unit is 1, else SI."""
    value = abs(action[source.paths[0]])
    if before.factor[j] == (source.unit == "1"):
        return before.u[j]
    return before.u[j] / value if source.unit == "1" else before.u[j] * value
