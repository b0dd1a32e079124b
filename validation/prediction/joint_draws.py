"""Draws of all uncertain inputs at once: what the trials would have read, had the model been right.

Conventions: a draw is one possible truth of the *whole session*. Common to its trials: the action's parameters, the
gain and delay of the force, the preload, the scale of each encoder and the part of its error that does not grow with
the angle. Each trial's own: the offset fitted on its baseline, the noise of its force, quantisation. A draw with
``parameters=False`` leaves the action as it is: a *perfect* model under a force known as well as declared.
Source: JCGM 101; u of the parameters as in `validation.prediction.input_sampling`.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Collection, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

import model
from model.errors import ModelError
from validation.conventions import BODIES, ENCODER_CHANNELS, FILM_CHANNELS, WORKERS, Array
from validation.measurement.position_sensors import CURVE_AT
from validation.measurement.trial import FilmAngles, MeasuredTrial
from validation.prediction.input_sampling import parameter_draws
from validation.prediction.key_driven import KeyErrors, run_many_key_driven
from validation.prediction.many_runs import AT_ONCE, Run, coarse_force, run_many
from validation.prediction.model_under_test import ModelUnderTest

CHANNELS = (*ENCODER_CHANNELS, *FILM_CHANNELS)
FILM_CLOCK = len(ENCODER_CHANNELS)  # place of its error in `JointDraw.z_scale`: one clock moves all of a film
MOVED_RAD = 1e-3  # turn over which the error of an encoder that does not grow with the angle comes about
SEED = 65
LEVELS, OWN, RULER = range(2, 5)  # uses of the seed
# departures of position sensors' rulers, beside a scale and a zero of each
RULERS = ("bow of the key's ruler", *(f"ruler of the hammer at {100 * at:.0f} %" for at in CURVE_AT))
USES = ("force", "readings")
MOST_TRIALS = 5  # of a condition that are drawn, for time: choice
T = TypeVar("T")
DRAWN_TOLERANCE = 3e-5  # rad: choice, a count of a scale, far below what draws scatter


@dataclass(frozen=True)
class JointDraw:
    """One possible truth of a session."""

    number: int  # which draw
    changed: Mapping[str, float] = field(hash=False)  # parameters of the action that differ
    # z_gain, z_preload, z_delay: errors of the force, in standard uncertainties
    z_gain: float
    z_preload: float
    z_delay: float
    # z_scale, z_change: errors of each of `CHANNELS`, in standard uncertainties
    z_scale: tuple[float, ...]
    z_change: tuple[float, ...]
    own: tuple[int, ...]  # seed of what each trial has for itself
    z_levels: tuple[float, float] = (0.0, 0.0)  # errors of hammer height and key dip at rest, in standard uncertainties
    z_ruler: tuple[float, ...] = ()  # departures of position sensors' rulers, in standard uncertainties; () of none
    has_own_errors: bool = True  # whether a trial's own errors are drawn: offset and noise of its force, quantisation

    @property
    def key_errors(self) -> KeyErrors:
        """Errors of the sensors of a trial that the key drives, in standard uncertainties."""
        bow, *curve = self.z_ruler or (0.0,) * len(RULERS)
        (key, key_zero), (hammer, hammer_zero) = ((self.z_scale[i], self.z_change[i]) for i in (0, 2))
        return KeyErrors(key, key_zero, np.array([key, key_zero, bow, hammer, hammer_zero, *curve]))

    def rng(self, trial: int, use: Literal["force", "readings"]) -> np.random.Generator:
        return np.random.default_rng([*self.own, trial, USES.index(use)])


def chosen_trials(
    trials: Sequence[MeasuredTrial], without: Collection[tuple[int, str]] = (), max_trials: int = MOST_TRIALS
) -> list[MeasuredTrial]:
    """At most ``max_trials`` trials, in order of number, by lots drawn from their own data, one of them filmed if any
    is; those that ``without`` names (trial number, channel left out) come last.

    Each trial draws its lot from its own recorded data, and the lowest are taken: a trial that is added or rejected
    changes at most one of the others (docs/explanation/uncertainty.md).
    """
    faulty = {number for number, _ in without}
    order = sorted(trials, key=lambda m: (m.number in faulty, *_lot(m)))
    filmed = [m for m in order if m.film is not None][:1]
    chosen = filmed + [m for m in order if not any(m is f for f in filmed)][: max_trials - len(filmed)]
    return sorted(chosen, key=lambda m: m.number)


def _lot(m: MeasuredTrial) -> tuple[bytes, int]:
    return hashlib.sha256(f"lot {m.seal}".encode()).digest(), m.number


def session_seed(trials: Sequence[MeasuredTrial]) -> int:
    first = min(trials, key=lambda m: m.number)  # a trial added later changes no draw
    return int.from_bytes(hashlib.sha256(first.seal.encode()).digest()[:8], "big")


def joint_draws(action: model.Action, seed: int, n: int, *, parameters: bool) -> list[JointDraw]:
    """Draw ``n`` possible truths of a session: errors of force, sensors and levels, in standard uncertainties, and,
    with ``parameters``, values of the action within their u (else its own); the same draws for the same ``seed``."""
    rng = np.random.default_rng([SEED, seed, int(parameters)])
    changes = parameter_draws(action, n, rng) if parameters else [{} for _ in range(n)]
    out = []
    for i, changed in enumerate(changes):
        z = rng.standard_normal(3)
        scale, change = (tuple(map(float, rng.standard_normal(len(CHANNELS)))) for _ in range(2))
        own = (SEED, seed, int(parameters), i)
        levels = np.random.default_rng([*own, LEVELS]).standard_normal(2)
        ruler = tuple(map(float, np.random.default_rng([*own, RULER]).standard_normal(len(RULERS))))
        errors = (float(z[0]), float(z[1]), float(z[2]), scale, change)
        out.append(JointDraw(i, changed, *errors, own, (float(levels[0]), float(levels[1])), ruler))
    return out


def own_draws(seed: int, n: int) -> list[JointDraw]:
    """``n`` + 1 draws of the trial's errors alone (offset, noise, quantisation); the first has no error at all."""
    zero = (0.0,) * len(CHANNELS)
    every = [JointDraw(i, {}, 0.0, 0.0, 0.0, zero, zero, (SEED, seed, OWN, i)) for i in range(n + 1)]
    return [replace(every[0], has_own_errors=False), *every[1:]]


@dataclass(frozen=True)
class DrawnAction:
    """The action of a draw, and its rest state under the preload of that draw."""

    draw: JointDraw
    action: model.Action
    rest: model.RestState

    @property
    def key_inputs(self) -> tuple[object, ...]:
        """What decides the motion of a trial that the key drives."""
        return id(self.action), self.rest.angle_rad.tobytes(), self.draw.z_scale, self.draw.z_change, self.draw.z_ruler


def drawn_action(tested: ModelUnderTest, m: MeasuredTrial, draw: JointDraw) -> DrawnAction | None:
    """Action with the values of a draw, and its rest under the declared preload of trial ``m`` with the drawn errors of
    gain and preload; None where it cannot rest."""
    channel = m.force.channel
    preload = channel.preload_n * (1 + channel.gain_relative_u * draw.z_gain) + channel.u_preload_n * draw.z_preload
    try:
        if not draw.changed and preload == channel.preload_n:
            return DrawnAction(draw, tested.action, tested.load(preload).rest)
        action = tested.action.with_values(draw.changed) if draw.changed else tested.action
        return DrawnAction(draw, action, tested.rest_of(action, preload, tested.load(channel.preload_n).rest))
    except ModelError:
        return None


def run_draws(
    tested: ModelUnderTest,
    trials: Sequence[tuple[MeasuredTrial, Array]],
    draws: Sequence[JointDraw],
    use: Callable[[int, Array], T],
) -> list[list[T | None]]:
    """Simulate every trial in every draw, all driven by force or all by the key: what ``use(trial index, readings (n,
    5) of `CHANNELS`, rad)`` returns, [trial][draw], None where it cannot run; ``trials``: with times (n,), s, of
    readings.

    Parameters
    ----------
    trials : sequence of (trial, times), times (n,) s; trials under the same declared preload share the actions drawn
    use : given the index of the trial and its readings as of `drawn_readings`, on a thread; what it returns is kept
    """
    if trials and all(m.driven_by_key for m, _ in trials):
        return [_run_draws_by_key(tested, m, time_s, draws, partial(use, i)) for i, (m, time_s) in enumerate(trials)]
    known: dict[tuple[float, float, float], list[DrawnAction | None]] = {}
    places: list[tuple[int, DrawnAction | None]] = []
    for i, (m, _) in enumerate(trials):
        c = m.force.channel
        key = c.preload_n, c.gain_relative_u, c.u_preload_n
        if key not in known:
            known[key] = [drawn_action(tested, m, draw) for draw in draws]
        places += [(i, drawn) for drawn in known[key]]
    runs = [
        drawn_run(tested, trials[i][0], drawn, trials[i][1]) if drawn is not None and trials[i][1].size else None
        for i, drawn in places
    ]

    def read(k: int, solution: model.Solution) -> T:
        i, drawn = places[k]
        assert drawn is not None
        return use(i, drawn_readings(trials[i][0], drawn, trials[i][1], solution))

    found = run_many(tested, runs, read)
    return [found[k : k + len(draws)] for k in range(0, len(found), len(draws))]


def _run_draws_by_key(
    tested: ModelUnderTest, m: MeasuredTrial, time_s: Array, draws: Sequence[JointDraw], use: Callable[[Array], T]
) -> list[T | None]:
    """Simulate one key-driven trial in each draw: what ``use(readings)`` returns of the readings (n, 5), rad, at the
    times ``time_s`` (n,), s, in the order of the draws; None where the draw cannot be run."""

    def some(part: Sequence[JointDraw]) -> list[T | None]:
        drawn = [drawn_action(tested, m, draw) for draw in part]
        distinct = {one.key_inputs: one for one in drawn if one is not None}  # a trial's own errors move no key
        runs = [
            (one.action, np.asarray(one.rest.angle_rad, dtype=float)[: len(BODIES)], one.draw.key_errors)
            for one in distinct.values()
        ]
        turns = dict(zip(distinct, run_many_key_driven(runs, m, drawn_tolerance(tested)), strict=True))
        return [None if one is None else read(one.draw, turns[one.key_inputs]) for one in drawn]

    def read(draw: JointDraw, turn: Array | None) -> T | None:
        if turn is None:
            return None
        at = turn
        if time_s is not m.time_s:
            at = np.column_stack([np.interp(time_s, m.time_s, column) for column in turn.T])
        return use(_readings(m, draw, time_s, at))

    parts = [draws[first : first + AT_ONCE] for first in range(0, len(draws), AT_ONCE)]
    with ThreadPoolExecutor(WORKERS) as pool:
        return [value for values in pool.map(some, parts) for value in values]


def drawn_tolerance(tested: ModelUnderTest) -> float:
    """Tolerance of the runs of draws, rad: draws scatter by a hundred times as much and more."""
    return max(tested.tolerance, DRAWN_TOLERANCE)


def drawn_run(tested: ModelUnderTest, m: MeasuredTrial, drawn: DrawnAction, time_s: Array) -> Run:
    """What to simulate for a draw (not simulated here): its action and rest, the force of trial ``m`` with the drawn
    errors, and the ``time_s`` at which the delayed force is recorded."""
    draw, f, rng = drawn.draw, m.force, drawn.draw.rng(m.number, "force")
    offset = f.hum.u_offset_n if np.isfinite(f.hum.u_offset_n) else 0.0
    force = f.force_n * (1 + f.channel.gain_relative_u * draw.z_gain) + f.channel.u_preload_n * draw.z_preload
    if draw.has_own_errors:
        force = force + offset * rng.standard_normal() + f.noise_n * rng.standard_normal(force.size)
    when = f.time_s + f.channel.u_group_delay_s * draw.z_delay
    at = time_s[_find_known_times(m, draw, time_s)]
    return Run(drawn.action, drawn.rest, *coarse_force(when, force), at, drawn_tolerance(tested))


def drawn_readings(m: MeasuredTrial, drawn: DrawnAction, time_s: Array, solution: model.Solution) -> Array:
    """Readings (len(time_s), 5), rad since rest, of trial ``m``'s `CHANNELS` (key, whippen, hammer, jack, repetition)
    if the draw were true; NaN of a film where the trial has none, and where the delayed force is not recorded.

    ``solution`` is that of `drawn_run`.
    """
    draw = drawn.draw
    turn = np.full((time_s.size, len(BODIES)), np.nan)
    moved = np.asarray(solution.angle_rad, dtype=float) - np.asarray(drawn.rest.angle_rad, dtype=float)
    turn[_find_known_times(m, draw, time_s)] = moved[:, : len(BODIES)]
    return _readings(m, draw, time_s, turn)


def _readings(m: MeasuredTrial, draw: JointDraw, time_s: Array, turn: Array) -> Array:
    """Readings since rest (n, 5), rad, of key, whippen, hammer, jack, repetition at ``time_s``, s, for turns (n, 5) of
    key, whippen, jack, repetition, hammer, with the draw's errors; of position sensors ``turn`` holds curve and scale
    already."""
    rng = draw.rng(m.number, "readings")
    out = np.full((time_s.size, len(CHANNELS)), np.nan)
    for i, name in enumerate(CHANNELS):
        angle = turn[:, BODIES.index(name)]
        if name in FILM_CHANNELS:
            if m.film is None:
                continue
            common, u_frame = film_errors(m.film, name, time_s)
            clock = np.gradient(angle, time_s) * m.film.u_time_s * draw.z_scale[FILM_CLOCK]
            out[:, i] = angle + clock + common * draw.z_change[i]
            if draw.has_own_errors:
                out[:, i] += np.interp(time_s, m.film.time_s, u_frame * rng.standard_normal(m.film.time_s.size))
            continue
        moved = 1.0 - np.exp(-np.abs(angle) / MOVED_RAD)
        white = abs(float(m.resolution_rad[i])) / np.sqrt(12.0)
        steady = float(np.sqrt(max(float(m.u_rad[i]) ** 2 - 2.0 * white**2, 0.0)))
        scale = 0.0 if m.sensors is not None else float(m.scale_relative_u[i]) * draw.z_scale[i]
        out[:, i] = angle * (1 + scale) + steady * draw.z_change[i] * moved
        if draw.has_own_errors:
            out[:, i] += white * (rng.standard_normal(angle.size) + rng.standard_normal())
    return out


def film_errors(film: FilmAngles, name: str, time_s: Array) -> tuple[Array, float]:
    """Standard uncertainties, rad, of one filmed angle: of what all frames share, at the times ``time_s``, (n,), and of
    what each frame has for itself, one number; ``name``: of the body.

    All frames share the reference, which is as noisy as one frame at most, at rest too, and camera, shutter and codec.
    """
    noise = film.u_noise_rad.get(name, film.u_rad[name])
    u_frame = float(np.nanmedian(noise)) / np.sqrt(2.0)
    beside = film.u_rad[name] ** 2 - noise**2
    known = np.isfinite(beside)
    of_film = np.interp(time_s, film.time_s[known], np.sqrt(np.maximum(beside[known], 0.0))) if known.any() else 0.0
    return np.asarray(np.hypot(u_frame, of_film)) + np.zeros(time_s.size), u_frame


def _find_known_times(m: MeasuredTrial, draw: JointDraw, time_s: Array) -> NDArray[np.bool_]:
    """Mask (n,) of the times ``time_s``, s, at which the draw's delayed force is recorded."""
    first, last = m.force.time_s[[0, -1]] + m.force.channel.u_group_delay_s * draw.z_delay
    return (time_s >= first) & (time_s <= last)
