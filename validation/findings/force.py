"""Faults of the force channel, one rule a function: sign and unit, delay, drift, range."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict

import numpy as np
from numpy.typing import NDArray

from model.errors import ModelError
from rig.session.force_correction import correlation_inflation
from validation.conventions import ENCODER_BODIES, ENCODER_CHANNELS, KEY, SIGMAS, Array
from validation.events.crossings import find_runs
from validation.events.miswired_encoders import MISSED
from validation.findings.encoders import is_at_rest_again, select_last_samples
from validation.findings.finding import (
    OF_TRIAL,
    PREDICTION,
    SessionFinding,
    make_finding,
    name_trials,
    register_kinds,
    uncertainty_of_mean,
)
from validation.findings.limits import GROSS
from validation.findings.readings import COARSE, is_followed_by_jump
from validation.measurement.trial import MeasuredTrial
from validation.prediction.model_under_test import ModelUnderTest
from validation.prediction.predict_session import PredictedAngles

MATTERS_N = 0.1  # choice: half of an up weight


@register_kinds({"hum": "Check shield and ground of the load cell."}, among=OF_TRIAL)
def find_mains_hum(m: MeasuredTrial) -> list[SessionFinding]:
    """One finding where mains hum of more than 0.1 N amplitude was subtracted from the force, else an empty list; the
    value is the largest amplitude, N."""
    fit = m.force.hum
    amplitude = max(fit.amplitude_n)
    if not fit.accepted or amplitude <= MATTERS_N:
        return []
    text = (
        f"trial {m.number}: force: hum of {amplitude:.2f} N at {fit.frequency_hz:.2f} Hz was subtracted "
        f"(limit {MATTERS_N:g} N)"
    )
    return [SessionFinding("hum", m.number, "force", amplitude, MATTERS_N, text)]


FLAT = 0.2  # of the noise
FEWEST_FLAT, FEWEST_EQUAL = 5, 3  # readings in a row: choice


@register_kinds(
    {"force saturation": "Widen the range of the force channel and record again."},
    spoils=PREDICTION,
    among=OF_TRIAL,
)
def find_force_saturation(m: MeasuredTrial) -> list[SessionFinding]:
    """One finding of a plateau at the largest or the smallest raw force reading, else an empty list; the value is the
    number of readings in a row: three equal ones, or five within a fifth of the noise, at least.

    Conventions: raw readings, N. A plateau is three equal readings in a row at the largest or smallest value, or five
    within a fifth of the channel's noise. Not judged are a channel without noise and, for equal readings, one whose
    converter is so coarse that more than a twentieth of the neighbours at rest are equal. Detectable from three
    readings. A plateau that ends with a jump is a reading that stood still.
    """
    force = m.raw_force_n
    steps = np.diff(force[: m.quiet.stop])
    noise = float(np.std(steps, ddof=1) / np.sqrt(2))
    if not noise > 0:
        return []
    fine = float(np.mean(steps == 0)) < COARSE
    for sign, words in ((1.0, "largest"), (-1.0, "smallest")):
        most = float((sign * force).max())
        start, length = _find_longest_run(sign * force > most - FLAT * noise)
        fewest = FEWEST_FLAT
        if length < fewest and fine:
            start, length = _find_longest_run(sign * force == most)
            fewest = FEWEST_EQUAL
        if length < fewest or is_followed_by_jump(m, start + length - 1):
            continue
        text = (
            f"trial {m.number}: force: {length} readings in a row stay at the {words} value {sign * most:.2f} N from "
            f"{m.time_s[start]:.4f} s, without the channel's noise of {noise:.3f} N (limit {fewest} readings), and "
            "leave it without a jump"
        )
        return [SessionFinding("force saturation", m.number, "force", float(length), float(fewest), text)]
    return []


def _find_longest_run(flat: NDArray[np.bool_]) -> tuple[int, int]:
    first, end = max(find_runs(flat).tolist(), key=lambda run: run[1] - run[0], default=(0, 0))
    return first, end - first


LEAVES = 0.4  # of the error: choice, what a factor that explains it may leave
STILL_MISSES = 1.0 - MISSED  # of the motion: more is no explanation
LARGEST_N = 500.0  # beyond any stroke
HARDLY = 0.25  # of the trial's turn of the key, the way the trial goes: choice
LARGE_FACTOR = 4.0  # smallest one that a key which hardly moves is told by: friction cannot do that
# what the recorded force would have to be multiplied by, and the mistake that makes it so
FACTORS = {
    -1.0: "reversed",
    4.448222: "pounds-force to newtons",
    1 / 4.448222: "newtons to pounds-force",
    9.80665: "kilograms-force to newtons",
    1 / 9.80665: "newtons to kilograms-force",
    1e3: "kilonewtons to newtons",
    1e-3: "millinewtons to newtons",
    2.0: "twice",
    0.5: "half",
}


@register_kinds(
    {
        "reversed force": "Turn the sign of the load cell in the {settings} and {remake}.",
        "force factor": "Check unit and sensitivity of the load cell in the {settings}.",
    },
    spoils=PREDICTION,
)
def find_force_factor(
    tested: ModelUnderTest, m: MeasuredTrial, p: PredictedAngles, until_s: float
) -> list[SessionFinding]:
    """One finding of a factor on the force (reversed sign, wrong unit, twice, half) with which the model predicts the
    trial much better, until ``until_s``, s; else an empty list. The value is the factor. Simulates, unless the model's
    store has the result.

    Conventions: errors are root mean squares of model − trial over the trial's own motion, of key, whippen and hammer
    each, until the release. A trial is looked at only when the model misses at least 30 % of the motion of a body; a
    factor is named when it leaves at most 40 % of each body's error. Soft strokes are not predicted that well: where
    the key goes its way and the model's hardly moves, or lifts, under the force as recorded, a reversed sign or a
    factor of four and more is also named when key and whippen then travel as far as in the trial. A force too large
    shows only as far as stops allow, and a smaller error of the gain looks like friction: both may stay silent.
    """
    expected = np.column_stack([p.change_rad(name) for name in ENCODER_CHANNELS])
    known = np.isfinite(expected).all(axis=1) & (m.time_s <= until_s)
    if not known.any():
        return []
    size = np.sqrt(np.mean(m.change_rad[known] ** 2, axis=0))
    if not np.all(size > 0):
        return []
    errors = _compute_errors(expected[known], m.change_rad[known], size)
    if errors.max() < MISSED:
        return []
    force = m.force
    found = tested.store.value(
        "force sign and unit",
        (tested.identity, m.number, force.time_s, force.force_n, force.preload_n, m.time_s, m.change_rad, until_s),
        lambda: [asdict(f) for f in _search_factors(tested, m, expected[known], known)],
    )
    return [SessionFinding(**f) for f in found]


def _compute_errors(expected: Array, trial: Array, size: Array) -> Array:
    return np.asarray(np.sqrt(np.mean((expected - trial) ** 2, axis=0)) / size)


def _find_furthest(change: Array) -> Array:
    return np.asarray(np.take_along_axis(change, np.abs(change).argmax(axis=0)[None], axis=0)[0])


def _search_factors(
    tested: ModelUnderTest, m: MeasuredTrial, expected: Array, inside: NDArray[np.bool_]
) -> list[SessionFinding]:
    """One finding of the factor in `FACTORS` by which the force beyond the preload, multiplied, predicts the trial much
    better, else []; ``inside`` (n,): samples compared, ``expected`` (k, 3): the model's key, whippen, hammer there, rad
    since rest."""
    force, trial = m.force, m.change_rad[inside]
    size = np.sqrt(np.mean(trial**2, axis=0))
    errors = _compute_errors(expected, trial, size)
    far = _find_furthest(trial)
    still = bool((expected[:, 0] * np.sign(far[0])).max() < HARDLY * abs(far[0]))
    rest = tested.load(force.preload_n).rest
    left: dict[float, float] = {}
    for factor in FACTORS:
        # the declared preload stays: it is what the arm rests with, whatever the channel reads
        taken = force.preload_n + factor * (force.force_n - force.preload_n)
        if float(np.abs(taken).max()) > LARGEST_N:
            continue
        try:
            run = tested.simulate(
                tested.action,
                force.time_s,
                taken,
                tolerance=tested.tolerance,
                output_time_s=m.time_s[inside],
                initial=rest,
            )
        except ModelError:
            continue
        change = np.asarray(run.angle_rad, dtype=float) - np.asarray(rest.angle_rad, dtype=float)
        change = change[:, ENCODER_BODIES]
        by_body = _compute_errors(change, trial, size)
        explains = bool(np.all(by_body < np.minimum(LEAVES * errors, STILL_MISSES)))
        if still and (factor < 0 or factor >= LARGE_FACTOR):
            explains |= bool(np.all(np.abs(_find_furthest(change) / far - 1)[:2] < GROSS) and np.all(by_body < errors))
        if explains:
            left[factor] = float(np.sqrt(np.mean(by_body**2)))
    order = sorted(left, key=lambda factor: left[factor])
    if not order:
        return []
    error = float(np.sqrt(np.mean(errors**2)))
    best = order[0]
    alike = [factor for factor in order if left[factor] < 1.5 * left[best]]
    kind = "reversed force" if best < 0 else "force factor"
    words = " or ".join(f"× {factor:.4g} ({FACTORS[factor]})" for factor in alike)
    text = (
        f"trial {m.number}: force: the model misses {100 * error:.0f} % of the motion under the force as recorded and "
        f"{100 * left[best]:.0f} % when it is taken {words}"
    )
    return [SessionFinding(kind, m.number, "force", best, MISSED, text)]


BAND_HZ = (30.0, 400.0)  # choice: above a slow press, below the noise of a second derivative
SMOOTH_S = 2.2e-3  # of that derivative: about a period of the band's upper end
LONGEST_S = 8e-3  # lag that is looked for: longer ones show in every event
# correlation, and lag from which it is then stated: choice
CLEAR, CLEAR_S = 0.85, 0.5e-3
VISIBLE, VISIBLE_S = 0.5, 1.2e-3  # and where the stroke is softer


def estimate_force_lag(m: MeasuredTrial, p: PredictedAngles) -> tuple[float, float]:
    """Lag of the force behind the key's acceleration that the prediction ``p`` does not have, s, positive when the
    force is late, and the limit from which it is stated, s; both NaN where the correlation is below 0.5 or the record
    too short or slow."""
    step = float(np.median(np.diff(m.time_s)))
    force = np.interp(m.time_s, m.force.time_s, m.force.force_n)
    expected = p.change_rad("key")
    known = np.isfinite(p.angle_rad[:, KEY])
    if 1 / step < 3 * BAND_HZ[1] or known.sum() < round(0.1 / step):
        return float("nan"), float("nan")
    lag, clear = _correlate_lag(force[known], m.change_rad[known, 0], step)
    lag_model, clear_model = _correlate_lag(force[known], expected[known], step)
    if min(clear, clear_model) < VISIBLE:
        return float("nan"), float("nan")
    limit = CLEAR_S if clear > CLEAR else VISIBLE_S
    # both the lag itself and what the prediction does not have must be large: the smaller one is safe to state
    apart = lag - lag_model
    safe = min(lag, apart, key=abs) if lag * apart > 0 else 0.0
    return float(safe), limit


def _correlate_lag(force: Array, key_rad: Array, step: float) -> tuple[float, float]:
    """Lag, s, of best correlation between force (n,) and the key's acceleration, positive when the force is late, and
    that correlation; both filtered to 30 to 400 Hz. ``key_rad`` (n,): key angle, ``step``: sample period, s."""
    a, f = filter_band(second_derivative(key_rad, step), step), filter_band(force, step)
    reach = round(LONGEST_S / step)
    inner = slice(2 * reach, a.size - 2 * reach)
    a0 = a[inner] - a[inner].mean()
    near = f[reach : f.size - reach] - f[reach : f.size - reach].mean()
    # a0 has no mean, so the mean of each shifted piece need not be taken off; its square sum comes from running sums
    running, squares = (np.concatenate([[0.0], np.cumsum(x)]) for x in (near, near**2))
    total, power = (x[a0.size :] - x[: -a0.size] for x in (running, squares))
    size = np.sqrt(np.maximum(power - total**2 / a0.size, 0.0) * (a0 @ a0))
    c = np.divide(np.correlate(near, a0, "valid"), size, out=np.zeros(size.size), where=size > 0)
    best = int(np.argmax(c))
    part = 0.0
    if 0 < best < c.size - 1:
        bend = c[best - 1] - 2 * c[best] + c[best + 1]
        part = 0.5 * float(c[best - 1] - c[best + 1]) / float(bend) if bend < 0 else 0.0
    return (best - c.size // 2 + part) * step, float(c[best])


def second_derivative(values: Array, step: float) -> Array:
    """Second derivative of the cubics fitted over `SMOOTH_S` around each sample (Savitzky and Golay 1964)."""
    half = max(round(SMOOTH_S / step / 2), 2)
    weights = 2.0 * np.linalg.pinv(np.vander(np.arange(-half, half + 1.0), 4, increasing=True))[2] / step**2
    return np.convolve(_extend(values, half), weights[::-1], "valid")


def filter_band(values: Array, step: float) -> Array:
    """Values (n,), sampled every ``step`` s, filtered to 30 to 400 Hz by a second-order Butterworth band-pass applied
    forwards and backwards, so that nothing is delayed.

    By the transform: ``scipy.signal`` takes half a second to import.
    """
    pad = min(round(2.0 / BAND_HZ[0] / step), values.size - 1)
    whole = _extend(values, pad)
    tangent = np.tan(np.pi * np.fft.rfftfreq(whole.size)[1:])
    low, high = np.tan(np.pi * step * np.array(BAND_HZ))
    apart = (tangent**2 - low * high) / (tangent * (high - low))
    gain = np.concatenate([[0.0], 1.0 / (1.0 + apart**4)])
    return np.asarray(np.fft.irfft(gain * np.fft.rfft(whole), whole.size)[pad : pad + values.size])


def _extend(values: Array, by: int) -> Array:
    """Values with ``by`` more at either end, turned about the first and the last."""
    return np.pad(values, by, mode="reflect", reflect_type="odd")


@register_kinds(
    {"force lag": "Measure the delay of the force channel against the encoders and state it in the {settings}."}
)
def find_force_lags(lags: Mapping[int, tuple[float, float]]) -> list[SessionFinding]:
    """One finding for all trials whose lag is beyond its limit in either sense (value: mean lag, s, positive when the
    force is late); empty where none is or fewer than half have a lag. ``lags``: trial number → lag, NaN where unclear,
    and limit, s.

    Conventions: s, positive when the force comes late after the declared delay was taken off. The motor's own inertia
    makes force and acceleration rise together, whatever the friction; both are filtered alike, 30 to 400 Hz, and the
    lag of their best correlation is compared with the lag in the prediction, where motion follows the same force by the
    laws alone. Stated from 0.5 ms where the correlation is above 0.85 (forte), from 1.2 ms above 0.5; silent below, and
    where fewer than half of the trials show it. Lags that are not alike are stated trial by trial.
    """
    known = {n: v for n, v in lags.items() if np.isfinite(v[0])}
    if not known or len(known) < (len(lags) + 1) // 2:
        return []
    away = {n: v[0] for n, v in known.items() if abs(v[0]) > v[1]}
    if not away:
        return []
    limit = float(np.median([known[n][1] for n in away]))

    beside = f"force: {name_trials(away, lags)} it lags the key's acceleration"
    stated = f"than in the model (limit {1e3 * limit:.1f} ms)"
    if np.ptp(list(away.values())) > limit:
        each = ", ".join(f"{_format_ms(lag)} in trial {n}" for n, lag in sorted(away.items()))
        text = f"{beside} otherwise {stated}: {each}"
    else:
        u = uncertainty_of_mean(away.values())
        text = f"{beside} by {_format_ms(float(np.mean(list(away.values()))))} {stated}"
        text += f", standard uncertainty {1e3 * u:.2g} ms" if np.isfinite(u) else ""
    return [make_finding("force lag", "force", away, limit, text)]


def _format_ms(lag: float) -> str:
    return f"{1e3 * abs(lag):.1f} ms {'more' if lag > 0 else 'less'}"


@register_kinds(
    {"force return": "Let the load cell warm up, check its cable and mounting; loosen nothing in the action for this."},
    spoils=PREDICTION,
)
def find_force_drift(m: MeasuredTrial) -> list[SessionFinding]:
    """One finding where the mean force of the last 50 ms is off the one before the stroke by more than 0.1 N and five u
    (the value, N: after less before); empty else, and where fewer than two encoders are back at rest.

    Conventions: N; the reading after is the mean over the last 50 ms, in which two encoders must stand where they
    began. Detectable from 0.1 N, or five standard uncertainties of the two means. The force is not corrected.
    """
    last = select_last_samples(m)
    if int(is_at_rest_again(m).sum()) < 2:
        return []
    reading = m.force.force_n[last]
    u = float(reading.std(ddof=1) * np.sqrt(correlation_inflation(reading) / reading.size))
    u = float(np.hypot(u, m.force.hum.u_offset_n))
    away = float(reading.mean()) - m.force.preload_n
    limit = max(MATTERS_N, SIGMAS * u)
    if abs(away) <= limit:
        return []
    quiet = slice(0, m.quiet.stop)
    before_s, after_s = float(m.time_s[quiet].mean()), float(m.time_s[last].mean())
    slope = float(np.polyfit(m.time_s[quiet], m.raw_force_n[quiet], 1)[0])
    text = (
        f"trial {m.number}: force: at rest after the stroke it reads {away:+.2f} N against before (limit {limit:.2f} "
        f"N), "
        f"{away / (after_s - before_s):+.2f} N/s on average, {slope:+.2f} N/s before the stroke (standard "
        f"uncertainty {u:.2g} N)"
    )
    return [SessionFinding("force return", m.number, "force", away, limit, text)]
