"""What is compared: angles of encoders and films of each trial, thinned to phases that the trials of a session share.

Conventions: phases are times relative to the moment the hammer first came 90 % of its way; they are spaced so that the
action moves equally far between them, from just before the force acts until it ends, before the key goes up: later
differences grow of themselves. The force is trimmed to that, starts at its declared preload, and is not changed else.
A film has a clock of its own: of each phase its nearest frame is compared, at its time (`film_channels`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from model.errors import ModelError
from model.motion_driven.spline_fit import KeyFit, fit_key_motion
from validation.conventions import BODIES, ENCODER_CHANNELS, FILM_CHANNELS, RECTANGULAR, Array
from validation.errors import ValidationInputError
from validation.infer.unknowns import FORCE, KEY, POSITIONS, Parameter, Unknowns
from validation.measurement.position_sensors import PositionSensors, SensorCalibration
from validation.measurement.trial import FilmAngles, MeasuredTrial

NEAR = 0.75  # of the time between two frames: how far a frame may be from its phase
OUTSIDE_S = 1e-3  # a frame may be beyond the first and last phase by this


@dataclass(frozen=True)
class FilmSeen:
    """What a film says at m phases."""

    time_s: Array  # (m,) of the frames; of the phase itself where there is none
    # change_rad, u_white_rad: (m, 2) since rest, and from frame to frame; NaN where lost
    change_rad: Array
    u_white_rad: Array
    # u_zero_rad, u_scale: (2,) of the reference, rad; of what grows with the angle, relative
    u_zero_rad: Array
    u_scale: Array
    u_time_s: float  # of the film's clock


def read_film(m: MeasuredTrial, phase_s: Array) -> FilmSeen:
    """Jack and repetition lever (m, 2) of a trial's film, rad since rest and relative to the whippen, with their u, at
    phases (m,), s: of each phase its nearest frame; NaN where none is near, and throughout without a film.

    Conventions: relative to the whippen and to rest, rad; a phase without a frame of its own is lost (NaN): frames may
    be further apart than phases, and one frame counts once. Noise differs from frame to frame; the reference, an
    average of the frames at rest, errs alike in all frames of a film; what camera, shutter and codec add is taken to
    grow with the angle.
    """
    n, size = len(FILM_CHANNELS), phase_s.size
    lost = np.full((size, n), np.nan)
    if m.film is None or m.film.time_s.size < 2:
        return FilmSeen(phase_s, lost, lost, np.zeros(n), np.zeros(n), 0.0)
    film = m.film
    frame, there = _assign_frames(film.time_s, phase_s)
    change, white = lost.copy(), lost.copy()
    zero, scale = np.zeros(n), np.zeros(n)
    still = max(int(np.sum(film.time_s < m.quiet.end_s)), 1)
    for c, name in enumerate(FILM_CHANNELS):
        noise = film.u_noise_rad.get(name, film.u_rad[name])
        change[there, c], white[there, c] = film.change_rad[name][frame[there]], noise[frame[there]]
        known = np.isfinite(film.change_rad[name]) & np.isfinite(noise) & np.isfinite(film.u_rad[name])
        if known.any():
            zero[c] = float(np.median(noise[known])) / np.sqrt(still)
            scale[c] = _estimate_growing_u(film, name, noise, known)
    change[~np.isfinite(white)] = np.nan
    return FilmSeen(np.where(there, film.time_s[frame], phase_s), change, white, zero, scale, film.u_time_s)


def _assign_frames(frame_s: Array, phase_s: Array) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """For each phase (m,), s, the index of the nearest frame, and whether it may be used: near enough, within the
    phases, and nearest to no other phase."""
    frame = np.clip(np.round(np.interp(phase_s, frame_s, np.arange(frame_s.size))), 0, frame_s.size - 1).astype(int)
    away = np.abs(frame_s[frame] - phase_s)
    there = away <= NEAR * float(np.median(np.diff(frame_s)))
    there &= (frame_s[frame] >= phase_s[0] - OUTSIDE_S) & (frame_s[frame] <= phase_s[-1] + OUTSIDE_S)
    for k in np.unique(frame):
        same = np.flatnonzero(frame == k)
        there[np.delete(same, int(np.argmin(away[same])))] = False
    return frame, there


def _estimate_growing_u(film: FilmAngles, name: str, noise: Array, known: NDArray[np.bool_]) -> float:
    """Relative standard uncertainty of a film angle beyond its noise, where the body has turned most."""
    beside = np.sqrt(np.maximum(film.u_rad[name][known] ** 2 - noise[known] ** 2, 0.0))
    turned = np.abs(film.change_rad[name][known])
    far = turned > 0.5 * turned.max()
    return float(np.median(beside[far] / turned[far])) if far.any() and turned.max() > 0.0 else 0.0


PHASES = 60  # instants a stroke, of three encoders each
LEAD_S, AFTER_S = 0.02, 2e-3  # rest kept before the force acts; kept of the force around what is compared
HELD = 0.15  # of the peak force: below it for good, the key is being let go
EVEN = 0.15  # share of the phases, and of the knots of the force noise, that is spread evenly over time
APART = 1.5  # samples between neighbouring phases, at least: each is the nearest sample of every trial
CHANNEL_NAMES = (*ENCODER_CHANNELS, *FILM_CHANNELS)
ENCODERS, FILM = (tuple(CHANNEL_NAMES.index(name) for name in group) for group in (ENCODER_CHANNELS, FILM_CHANNELS))
"""Channels by their place in `CHANNEL_NAMES`."""
BODY = tuple(BODIES.index(name) for name in CHANNEL_NAMES)


@dataclass(frozen=True)
class ObservedTrial:
    """One trial as the fit sees it."""

    label: str  # session and number, for messages
    # session, number: which session of the fit (from 0), number of the trial in it
    session: int
    number: int
    # force_time_s, force_n: (k,) what drives the model; the first value is the preload; empty where the key does
    force_time_s: Array
    force_n: Array
    time_s: Array  # (m,) when angles are compared
    change_rad: Array  # (m, c) of ``channels`` since rest; NaN where a film lost a body
    u_white_rad: Array  # (c,) or (m, c) from sample to sample
    u_zero_rad: Array  # (c,) of the trial's own zero: its rounding; of a film its reference
    # u_steady_rad, u_scale: (c,) alike in all trials: not growing with the angle; relative
    u_steady_rad: Array
    u_scale: Array
    # preload_n, u_preload_n, u_offset_n, u_gain, u_delay_s: of the force
    preload_n: float
    u_preload_n: float
    u_offset_n: float
    u_gain: float
    u_delay_s: float
    noise_n: float  # standard deviation of one force sample
    channels: tuple[int, ...] = ENCODERS  # what is compared, as places in `CHANNEL_NAMES`
    film_time_s: Array | None = None  # (m,) times of the frames that film channels are compared at; None without a film
    u_film_time_s: float = 0.0  # of the film's clock
    # the fitted motion of the key that drives the model, since rest, or its position sensor; None where the force does
    key: KeyFit | PositionSensors | None = None
    # u_key_rad, u_key_scale: errors of the key's encoder, of the motion that drives
    u_key_rad: float = 0.0
    u_key_scale: float = 0.0
    # whether the errors of the key's encoder are fitted (with a trial that the key drives), not linear
    key_moves: bool = False

    def column(self, name: str) -> Array:
        """Change (m,) of one channel."""
        return np.asarray(self.change_rad[:, self.channels.index(CHANNEL_NAMES.index(name))])

    @property
    def u_calibrated_rad(self) -> Array:
        """``u_steady_rad`` (c,) without the zero's rounding: what a better calibration makes smaller."""
        return remove_rounding(self.u_steady_rad, self.u_zero_rad)

    def model_time_s(self, film_late_s: float = 0.0) -> Array:
        """Times (k,) at which the model is needed: phases and frames."""
        if self.film_time_s is None:
            return self.time_s
        return np.unique(np.concatenate([self.time_s, self.film_time_s + film_late_s]))

    def seen(self, turn_rad: Array, film_late_s: float = 0.0) -> Array:
        """Channels (m, c) of the model's turns (k, 5) of all bodies at `model_time_s`."""
        when = self.model_time_s(film_late_s)
        phase = np.searchsorted(when, self.time_s)
        frame = phase if self.film_time_s is None else np.searchsorted(when, self.film_time_s + film_late_s)
        return np.column_stack([turn_rad[frame if c in FILM else phase, BODY[c]] for c in self.channels])


@dataclass(frozen=True)
class Span:
    """What of a trial is compared; ``top_s`` is when the hammer first came 90 % of its way."""

    start_s: float
    top_s: float
    end_s: float


_SpanOf = Callable[[MeasuredTrial], Span]
_Seen = Callable[[str, int, MeasuredTrial, Span, Array], ObservedTrial]


def observe(
    name: str, session: int, trials: Sequence[MeasuredTrial], phases: int = PHASES, film: bool = False
) -> list[ObservedTrial]:
    """Trials of one session, each driven by its force, thinned to at most ``phases`` common times; ``session``: its
    index in the fit; ``film``: with jack and repetition lever. Input error without a common span, or where an encoder
    stands still.

    Parameters
    ----------
    name : of the session, for messages
    session : its index in the fit
    trials : of one kind of stroke
    phases : how many times of each trial are compared
    film : compare the angles of films, too; those of trials without one are lost

    Raises
    ------
    ValidationInputError
        The trials have no span in common: they are not of one kind of stroke; or an encoder stands still.
    """
    return _thin_trials(name, session, trials, (_span, _observe_trial), phases, film)


def _thin_trials(
    name: str, session: int, trials: Sequence[MeasuredTrial], ways: tuple[_SpanOf, _Seen], phases: int, film: bool
) -> list[ObservedTrial]:
    """Trials of a session thinned to at most ``phases`` common times; ``ways``: functions that give a trial's span, and
    its observation at these times. Input error where an encoder stands still, or trials have no span in common."""
    for m in trials:
        still = np.flatnonzero(np.ptp(m.change_rad, axis=0) == 0.0)
        if still.size:
            raise ValidationInputError(
                f"{name}, trial {m.number}: the {ENCODER_CHANNELS[still[0]]} encoder stands still; reject the trial "
                "(pianorig annotate), or check the encoder's cable and record again"
            )
    spans = [ways[0](m) for m in trials]
    at = common_phases(name, trials, spans, phases)
    seen = [ways[1](name, session, m, s, at) for m, s in zip(trials, spans, strict=True)]
    return [add_film_angles(t, m) for t, m in zip(seen, trials, strict=True)] if film else seen


def common_phases(name: str, trials: Sequence[MeasuredTrial], spans: Sequence[Span], phases: int) -> Array:
    """Times (m,), s, since the hammer first came 90 % of its way (negative before), at which all trials are compared:
    at most ``phases``, closer where the first trial moves fast; input error where the trials have no span in common."""
    before = min(s.top_s - s.start_s for s in spans)
    after = min(s.end_s - s.top_s for s in spans)
    if before <= 0.0 or after <= 0.0:
        raise ValidationInputError(
            f"{name}: in some trials the hammer does not rise while the key is pressed; reject them (pianorig "
            "annotate), or give sessions of one kind of stroke each"
        )
    fine = np.arange(-before, after, 1e-3)
    lead, first = trials[0], spans[0]
    measured = np.isfinite(lead.change_rad).any(axis=0)
    curve = _interpolate_change(lead, first.top_s + fine)[:, measured]
    way = np.abs(np.gradient(curve, axis=0)) / np.ptp(lead.change_rad[:, measured], axis=0)
    density = way.sum(axis=1) / way.sum() * (1.0 - EVEN) + EVEN / fine.size
    passed = np.concatenate([[0.0], np.cumsum(density)[:-1]])
    at = np.unique(np.interp((np.arange(phases) + 0.5) / phases, passed, fine))
    return _keep_apart(at, APART * max(float(np.median(np.diff(m.time_s))) for m in trials))


def add_film_angles(trial: ObservedTrial, m: MeasuredTrial) -> ObservedTrial:
    """Copy of an observed trial with two more channels, jack and repetition lever, rad, as the film of ``m`` shows them
    in the frames nearest to its phases; NaN throughout without a film."""
    seen: FilmSeen = read_film(m, trial.time_s)
    white = np.broadcast_to(trial.u_white_rad, trial.change_rad.shape)
    return replace(
        trial,
        change_rad=np.hstack([trial.change_rad, seen.change_rad]),
        u_white_rad=np.hstack([white, seen.u_white_rad]),
        u_zero_rad=np.append(trial.u_zero_rad, seen.u_zero_rad),
        u_steady_rad=np.append(trial.u_steady_rad, np.zeros(len(FILM))),
        u_scale=np.append(trial.u_scale, seen.u_scale),
        channels=(*trial.channels, *FILM),
        film_time_s=seen.time_s,
        u_film_time_s=seen.u_time_s,
    )


def nearest_samples(m: MeasuredTrial, span: Span, phases: Array) -> Array:
    """Indices (m,) of samples nearest to the phases: between samples a straight line misses an impact by 1e-4 rad."""
    nearest = np.round(np.interp(span.top_s + phases, m.time_s, np.arange(m.time_s.size)))
    return np.asarray(np.clip(nearest, 0, m.time_s.size - 1), dtype=int)


def remove_rounding(u_steady_rad: Array, u_zero_rad: Array) -> Array:
    """Standard uncertainty (c,), rad, that a calibration leaves of what is alike in all trials, without the rounding of
    the zero."""
    return np.sqrt(np.maximum(u_steady_rad**2 - u_zero_rad**2, 0.0))


def encoder_noise(m: MeasuredTrial) -> dict[str, Any]:
    """Standard uncertainties (3,), rad, of one sample (its rounding, jitter), of the zero, and alike in all trials.

    The zero's rounding is in the last two: a body that comes to rest at the same place is rounded alike in all trials.
    """
    zero = np.abs(np.asarray(m.resolution_rad, dtype=float)) * RECTANGULAR
    white = np.hypot(zero, m.change_rad[: m.quiet.stop].std(axis=0, ddof=1))
    steady = np.sqrt(np.maximum(np.asarray(m.u_rad) ** 2 - white**2, zero**2))
    return {"u_white_rad": white, "u_zero_rad": zero, "u_steady_rad": steady}


def _keep_apart(times: Array, least_s: float) -> Array:
    """Those of increasing times that are at least so far from the last one kept."""
    kept = [float(times[0])]
    for t in times[1:]:
        if t - kept[-1] >= least_s:
            kept.append(float(t))
    return np.array(kept)


def _span(m: MeasuredTrial) -> Span:
    hammer = np.abs(m.change_rad[:, 2])
    top = float(m.time_s[int(np.argmax(hammer > 0.9 * hammer.max()))])
    force = m.force.force_n - m.force.preload_n
    acts = np.flatnonzero(force > HELD * force.max())
    end = min(float(m.force.time_s[acts[-1]]), float(m.time_s[-1]))
    return Span(max(m.quiet.onset_s - AFTER_S, float(m.force.time_s[0]) + LEAD_S), top, end)


def _interpolate_change(m: MeasuredTrial, time_s: Array) -> Array:
    return np.column_stack([np.interp(time_s, m.time_s, column) for column in m.change_rad.T])


def _observe_trial(name: str, session: int, m: MeasuredTrial, span: Span, phases: Array) -> ObservedTrial:
    """Observation of a force-driven trial: encoder angles of the samples nearest to ``phases`` (m,), s since the hammer
    came up, the force from before it acts, and their u; ``session``: its index in the fit."""
    index = nearest_samples(m, span, phases)
    time = m.time_s[index]
    f = m.force
    # from where it begins to act, not from the first phase, which may be later: what moved the key till then counts
    inside = (f.time_s > span.start_s - LEAD_S) & (f.time_s <= time[-1] + AFTER_S)
    force_s, force_n = f.time_s[inside], f.force_n[inside].copy()
    force_n[force_s < m.quiet.onset_s - AFTER_S] = f.preload_n  # the baseline's mean; its noise is not force
    offset = f.hum.u_offset_n if np.isfinite(f.hum.u_offset_n) else 0.0
    return ObservedTrial(
        label=f"{name}, trial {m.number}",
        session=session,
        number=m.number,
        force_time_s=force_s,
        force_n=force_n,
        time_s=time,
        change_rad=m.change_rad[index],
        **encoder_noise(m),
        u_scale=np.asarray(m.scale_relative_u, dtype=float),
        preload_n=f.preload_n,
        u_preload_n=f.channel.u_preload_n,
        u_offset_n=float(offset),
        u_gain=f.channel.gain_relative_u,
        u_delay_s=f.channel.u_group_delay_s,
        noise_n=float(f.noise_n),
    )


MOVES, DOWN = 0.01, 0.5  # of the key's largest turn: from where on it moves; below it for good, it goes up
WITHOUT_KEY = (1, 2)


def observe_driven(
    name: str, session: int, trials: Sequence[MeasuredTrial], phases: int = PHASES, film: bool = False
) -> list[ObservedTrial]:
    """Trials of one session thinned to common times, each driven by the motion fitted to its key's encoder; whippen and
    hammer are compared. Arguments and input errors as of `observe`, and where a key's angles are no motion.

    Conventions: whippen and hammer (and a film's bodies) are compared, at phases as in `observations`, from just before
    the key moves until it goes up again. The key's motion is a differentiable curve fitted to its encoder, since rest;
    the model adds its own rest angle under the arm's preload. Errors of the key's encoder are errors of what drives:
    they move like parameters, in the trials that a force drives, too.

    Raises
    ------
    ValidationInputError
        The trials have no span in common, an encoder stands still, or a key's angles are no motion.
    """
    return _thin_trials(name, session, trials, (_driven_span, _observe_driven_trial), phases, film)


def _driven_span(m: MeasuredTrial) -> Span:
    key, hammer = (np.abs(m.change_rad[:, c]) for c in (0, 2))
    moves = int(np.argmax(key > MOVES * key.max()))
    top = float(m.time_s[int(np.argmax(hammer > 0.9 * hammer.max()))])
    down = np.flatnonzero(key > DOWN * key.max())
    return Span(max(float(m.time_s[moves]) - AFTER_S, float(m.time_s[0]) + LEAD_S), top, float(m.time_s[down[-1]]))


def _observe_driven_trial(name: str, session: int, m: MeasuredTrial, span: Span, phases: Array) -> ObservedTrial:
    """Observation of a trial driven by its key's encoder: a motion fitted to the key since rest, whippen and hammer
    angles of the samples nearest to ``phases`` (m,), s since the hammer came up; input error where no motion fits."""
    index = nearest_samples(m, span, phases)
    time = m.time_s[index]
    inside = (m.time_s > span.start_s - LEAD_S) & (m.time_s <= time[-1] + AFTER_S)
    try:
        key = fit_key_motion(m.time_s[inside], m.change_rad[inside, 0], resolution_rad=float(m.resolution_rad[0]))
    except ModelError as error:
        raise ValidationInputError(f"{name}, trial {m.number}: {error}") from None
    noise, measured = encoder_noise(m), list(WITHOUT_KEY)
    scale = np.asarray(m.scale_relative_u, dtype=float)
    force = m.force.channel
    return ObservedTrial(
        label=f"{name}, trial {m.number}",
        session=session,
        number=m.number,
        force_time_s=np.empty(0),
        force_n=np.empty(0),
        time_s=time,
        change_rad=m.change_rad[index][:, measured],
        **{name: u[measured] for name, u in noise.items()},
        u_scale=scale[measured],
        preload_n=force.preload_n,
        u_preload_n=force.u_preload_n,
        u_offset_n=0.0,
        u_gain=0.0,
        u_delay_s=0.0,
        noise_n=0.0,
        channels=WITHOUT_KEY,
        key=key,
        u_key_rad=float(remove_rounding(noise["u_steady_rad"], noise["u_zero_rad"])[0]),
        u_key_scale=float(scale[0]),
        key_moves=True,
    )


UP = 0.02  # of the hammer's way: below it for good, it is back
HAMMER_ALONE = (ENCODER_CHANNELS.index("hammer"),)


def observe_positions(
    name: str, session: int, trials: Sequence[MeasuredTrial], phases: int = PHASES, film: bool = False
) -> list[ObservedTrial]:
    """Trials of one session of position sensors, thinned to common times until the hammer is back: the key's sensor
    drives the model, the hammer's is compared. Arguments and input errors as of `observe`.

    Conventions: the hammer is compared, from just before the key moves until it is back: a key that is let go moves the
    action on. Errors of the sensors move like parameters.
    """
    return _thin_trials(name, session, trials, (_positions_span, _observe_positions_trial), phases, film)


def _positions_span(m: MeasuredTrial) -> Span:
    key, hammer = (np.abs(m.change_rad[:, c] - m.change_rad[0, c]) for c in (0, 2))
    moves = int(np.argmax(key > MOVES * key.max()))
    top = float(m.time_s[int(np.argmax(hammer > 0.9 * hammer.max()))])
    back = min(int(np.flatnonzero(hammer > UP * hammer.max())[-1]) + 1, m.time_s.size - 1)
    return Span(max(float(m.time_s[moves]) - AFTER_S, float(m.time_s[0]) + 1e-3), top, float(m.time_s[back]))


def _observe_positions_trial(name: str, session: int, m: MeasuredTrial, span: Span, phases: Array) -> ObservedTrial:
    """Observation of a trial of position sensors: the key's drives the model, the hammer's is compared, rad since rest,
    at the samples nearest to ``phases`` (m,), s since the hammer came up."""
    index, measured = nearest_samples(m, span, phases), list(HAMMER_ALONE)
    white = (m.resolution_rad * RECTANGULAR)[measured]
    return ObservedTrial(
        label=f"{name}, trial {m.number}",
        session=session,
        number=m.number,
        force_time_s=np.empty(0),
        force_n=np.empty(0),
        time_s=m.time_s[index],
        change_rad=m.change_rad[index][:, measured],
        u_white_rad=white,
        u_zero_rad=np.zeros(1),
        u_steady_rad=m.u_rad[measured],
        u_scale=np.zeros(1),
        preload_n=0.0,
        u_preload_n=0.0,
        u_offset_n=0.0,
        u_gain=0.0,
        u_delay_s=0.0,
        noise_n=0.0,
        channels=HAMMER_ALONE,
        key=m.sensors,
    )


def with_calibration(trials: Sequence[ObservedTrial], sensors: SensorCalibration | None) -> tuple[ObservedTrial, ...]:
    """Trials whose position sensors have these errors; others as they are."""
    return tuple(
        replace(t, key=replace(t.key, calibration=sensors)) if sensors and isinstance(t.key, PositionSensors) else t
        for t in trials
    )


def share_key_errors(trials: Sequence[ObservedTrial]) -> list[ObservedTrial]:
    """The trials; where a key's encoder drives any of them, those that a force drives are copied with the errors of
    their key's encoder to be fitted, too (``key_moves``)."""
    if not any(isinstance(t.key, KeyFit) for t in trials):
        return list(trials)
    return [
        t
        if t.key is not None
        else replace(t, key_moves=True, u_key_rad=float(t.u_calibrated_rad[0]), u_key_scale=float(t.u_scale[0]))
        for t in trials
    ]


def add_drive_errors(asked: Unknowns, trials: Sequence[ObservedTrial]) -> Unknowns:
    """Copy of the unknowns whose ``force`` holds the errors of what drives the trials: of the force, the key's encoder
    or the position sensors, each where it drives any trial."""
    errors: tuple[Parameter, ...] = ()
    if any(t.key is None for t in trials):
        errors += FORCE
    if any(isinstance(t.key, KeyFit) for t in trials):
        errors += KEY
    if any(isinstance(t.key, PositionSensors) for t in trials):
        errors += POSITIONS
    return replace(asked, force=errors)
