"""What is compared: angles of encoders and films of each trial, thinned to phases that the trials of a session share.

Conventions: phases are times relative to the moment the hammer first came 90 % of its way; they are spaced so that the
action moves equally far between them, from just before the force acts until it ends, before the key goes up: later
differences grow of themselves. The force is trimmed to that, starts at its declared preload, and is not changed else.
A film has a clock of its own: of each phase its nearest frame is compared, at its time (`film_channels`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from model.motion_driven.spline_fit import KeyFit
from validation.conventions import BODIES, ENCODER_CHANNELS, FILM_CHANNELS, Array
from validation.errors import ValidationInputError
from validation.identification.film_channels import FilmSeen, film_seen
from validation.measurement.trial import MeasuredTrial

PHASES = 60
LEAD_S = 0.02  # rest kept before the force acts
HELD = 0.15  # of the peak force: below it for good, the key is being let go
EVEN = 0.15  # share of the phases that is spread evenly over time
APART = 1.5  # samples between neighbouring phases, at least: each is the nearest sample of every trial
CHANNEL_NAMES = (*ENCODER_CHANNELS, *FILM_CHANNELS)
ENCODERS, FILM = (0, 1, 2), (3, 4)
"""Channels by their place in `CHANNEL_NAMES`."""
BODY = tuple(BODIES.index(name) for name in CHANNEL_NAMES)


@dataclass(frozen=True)
class ObservedTrial:
    """One trial as the fit sees it.

    Attributes
    ----------
    label : session and number, for messages
    session, number : which session of the fit (from 0), number of the trial in it
    force_time_s, force_n : (k,) what drives the model; the first value is the preload; empty where the key does
    time_s : (m,) when angles are compared
    change_rad : (m, c) of ``channels`` since rest; NaN where a film lost a body
    u_white_rad : (c,) or (m, c) from sample to sample
    u_steady_rad, u_scale : (c,) not growing with the angle; relative
    preload_n, u_preload_n, u_offset_n, u_gain, u_delay_s : of the force
    noise_n : standard deviation of one force sample
    channels : what is compared, as places in `CHANNEL_NAMES`
    film_time_s : (m,) times of the frames that film channels are compared at; None without a film
    u_film_time_s : of the film's clock
    key : the fitted motion of the key that drives the model, since rest; None where the force does
    u_key_rad, u_key_scale : errors of the key's encoder, of the motion that drives
    key_moves : whether the errors of the key's encoder are fitted (with a trial that the key drives), not linear
    """

    label: str
    session: int
    number: int
    force_time_s: Array
    force_n: Array
    time_s: Array
    change_rad: Array
    u_white_rad: Array
    u_steady_rad: Array
    u_scale: Array
    preload_n: float
    u_preload_n: float
    u_offset_n: float
    u_gain: float
    u_delay_s: float
    noise_n: float
    channels: tuple[int, ...] = ENCODERS
    film_time_s: Array | None = None
    u_film_time_s: float = 0.0
    key: KeyFit | None = None
    u_key_rad: float = 0.0
    u_key_scale: float = 0.0
    key_moves: bool = False

    def column(self, name: str) -> Array:
        """Change (m,) of one channel."""
        return np.asarray(self.change_rad[:, self.channels.index(CHANNEL_NAMES.index(name))])

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


def observe(
    name: str, session: int, trials: Sequence[MeasuredTrial], phases: int = PHASES, film: bool = False
) -> list[ObservedTrial]:
    """Thin the trials of one session to common phases.

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
        The trials have no span in common: they are not of one kind of stroke.
    """
    spans = [_span(m) for m in trials]
    at = common_phases(name, trials, spans, phases)
    seen = [_observed(name, session, m, s, at) for m, s in zip(trials, spans, strict=True)]
    return [with_film(t, m) for t, m in zip(seen, trials, strict=True)] if film else seen


def common_phases(name: str, trials: Sequence[MeasuredTrial], spans: Sequence[Span], phases: int) -> Array:
    """Times (m,) from the moment the hammer is up, for all trials of one session.

    Raises
    ------
    ValidationInputError
        The trials have no span in common.
    """
    before = min(s.top_s - s.start_s for s in spans)
    after = min(s.end_s - s.top_s for s in spans)
    if before <= 0.0 or after <= 0.0:
        raise ValidationInputError(
            f"{name}: in some trials the hammer does not rise while the key is pressed; reject them (pianorig "
            "annotate), or give sessions of one kind of stroke each"
        )
    fine = np.arange(-before, after, 1e-3)
    lead, first = trials[0], spans[0]
    curve = _at(lead, first.top_s + fine)
    way = np.abs(np.gradient(curve, axis=0)) / np.ptp(lead.change_rad, axis=0)
    density = way.sum(axis=1) / way.sum() * (1.0 - EVEN) + EVEN / fine.size
    passed = np.concatenate([[0.0], np.cumsum(density)[:-1]])
    at = np.unique(np.interp((np.arange(phases) + 0.5) / phases, passed, fine))
    return _apart(at, APART * max(float(np.median(np.diff(m.time_s))) for m in trials))


def with_film(trial: ObservedTrial, m: MeasuredTrial) -> ObservedTrial:
    """The trial with jack and repetition lever as its film shows them; lost throughout without one."""
    seen: FilmSeen = film_seen(m, trial.time_s)
    white = np.broadcast_to(trial.u_white_rad, trial.change_rad.shape)
    return replace(
        trial,
        change_rad=np.hstack([trial.change_rad, seen.change_rad]),
        u_white_rad=np.hstack([white, seen.u_white_rad]),
        u_steady_rad=np.append(trial.u_steady_rad, seen.u_zero_rad),
        u_scale=np.append(trial.u_scale, seen.u_scale),
        channels=(*trial.channels, *FILM),
        film_time_s=seen.time_s,
        u_film_time_s=seen.u_time_s,
    )


def sampled(m: MeasuredTrial, span: Span, phases: Array) -> Array:
    """Indices (m,) of samples nearest to the phases: between samples a straight line misses an impact by 1e-4 rad."""
    nearest = np.round(np.interp(span.top_s + phases, m.time_s, np.arange(m.time_s.size)))
    return np.asarray(np.clip(nearest, 0, m.time_s.size - 1), dtype=int)


def encoder_noise(m: MeasuredTrial) -> tuple[Array, Array]:
    """Standard uncertainty of one sample's rounding (3,), and what does not change from sample to sample (3,), rad."""
    white = np.abs(np.asarray(m.resolution_rad, dtype=float)) / np.sqrt(12.0)
    return white, np.sqrt(np.maximum(np.asarray(m.u_rad) ** 2 - 2.0 * white**2, 0.0))


def _apart(times: Array, least_s: float) -> Array:
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
    return Span(max(m.quiet.onset_s - 2e-3, float(m.force.time_s[0]) + LEAD_S), top, end)


def _at(m: MeasuredTrial, time_s: Array) -> Array:
    return np.column_stack([np.interp(time_s, m.time_s, column) for column in m.change_rad.T])


def _observed(name: str, session: int, m: MeasuredTrial, span: Span, phases: Array) -> ObservedTrial:
    index = sampled(m, span, phases)
    time = m.time_s[index]
    f = m.force
    # from where it begins to act, not from the first phase, which may be later: what moved the key till then counts
    inside = (f.time_s > span.start_s - LEAD_S) & (f.time_s <= time[-1] + 2e-3)
    force_s, force_n = f.time_s[inside], f.force_n[inside].copy()
    force_n[force_s < m.quiet.onset_s - 2e-3] = (
        f.preload_n
    )  # the baseline's mean is the preload; its noise is not force
    white, steady = encoder_noise(m)
    offset = f.hum.u_offset_n if np.isfinite(f.hum.u_offset_n) else 0.0
    return ObservedTrial(
        label=f"{name}, trial {m.number}",
        session=session,
        number=m.number,
        force_time_s=force_s,
        force_n=force_n,
        time_s=time,
        change_rad=m.change_rad[index],
        u_white_rad=np.hypot(white, white),
        u_steady_rad=steady,
        u_scale=np.asarray(m.scale_relative_u, dtype=float),
        preload_n=f.preload_n,
        u_preload_n=f.channel.u_preload_n,
        u_offset_n=float(offset),
        u_gain=f.channel.gain_relative_u,
        u_delay_s=f.channel.u_group_delay_s,
        noise_n=float(f.noise_n),
    )
