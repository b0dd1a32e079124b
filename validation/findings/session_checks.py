"""What is wrong with a session, in one line each: wiring, clocks, hum, lifts, odd trials, rates, a wrong friction.

Place in the data flow: measurements, predictions and marked intervals of all trials → here →
`ValidationResult.findings` and the warnings at the top of the report.
Conventions: nothing is repaired and no trial removed; a finding names the trial, what was found, the limit, what to do.
Source: each rule compares with the model under test or with the other trials; limits stand beside the rules, and a
session without faults raises none (`tests/validation/findings/test_planted_faults.py`).
Failure: none; what cannot be judged is not reported.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import permutations, product

import numpy as np
import pandas as pd

from validation.events.key_lift import Lift
from validation.measurement.geometry import Array
from validation.measurement.trial import ENCODER_CHANNELS, Measurement
from validation.prediction.model_under_test import TrialPrediction

WIRING = ("sign flip", "swapped channels", "dead channel")  # the channel is no measurement of what it is named after
DISTORTING = ("camera offset", "outlying trial")
COLUMNS = ["kind", "trial", "channel", "value", "limit", "text"]
BETTER_WIRED = 0.25  # the other wiring must leave a quarter of the error
WRONG_WIRED = 0.3  # of the predicted motion: below this error the wiring is right
HUM_N = 0.1
CLOCK_S = 1e-4
RATE_RELATIVE = 1e-4
SHORT_S = 0.02
SHORT_SHARE = 0.1
STANDS_STILL = 0.01  # of the predicted range


@dataclass(frozen=True)
class Finding:
    """One fault: its kind, the trial and channel (NaN and empty for the whole session), value, limit, and words."""

    kind: str
    trial: float
    channel: str
    value: float
    limit: float
    text: str


def wiring(m: Measurement, p: TrialPrediction) -> list[Finding]:
    """Encoders that turn the wrong way round, or stand in each other's place.

    Every permutation and sign of the three encoders is held against the prediction; the best one is named when it
    leaves a quarter of the error of the wiring as declared.
    """
    predicted = np.column_stack([p.model.change_rad(name) for name in ENCODER_CHANNELS])
    known = np.isfinite(predicted).all(axis=1) & np.isfinite(m.change_rad).all(axis=1)
    size = np.sqrt(np.mean(predicted[known] ** 2, axis=0))
    if not np.all(size > 0):
        return []
    error = np.empty((2, 3, 3))  # sign, place as measured, body as predicted
    for s, (i, j) in product(range(2), product(range(3), range(3))):
        difference = (1 - 2 * s) * m.change_rad[known, i] - predicted[known, j]
        error[s, i, j] = np.sqrt(np.mean(difference**2)) / size[j]
    sign = error.argmin(axis=0)
    best = error.min(axis=0)
    order = min(permutations(range(3)), key=lambda o: sum(best[o[j], j] ** 2 for j in range(3)))
    out = []
    for j, name in enumerate(ENCODER_CHANNELS):
        i = order[j]
        s = int(sign[i, j])
        as_declared, found = error[0, j, j], best[i, j]
        if (i == j and s == 0) or as_declared < WRONG_WIRED or found > BETTER_WIRED * as_declared:
            continue
        text = f"trial {m.number}: encoder {name}: "
        if i != j:
            text += f"what is recorded as {ENCODER_CHANNELS[i]} moves as the {name} should; channels are swapped"
        if s:
            text += ("" if i == j else ", and ") + "it turns the wrong way round (sign flip)"
        action = "it counts in no pooled figure; correct the rig file's channels or signs and record again"
        out.append(
            Finding(
                "swapped channels" if i != j else "sign flip",
                m.number,
                name,
                float(as_declared),
                WRONG_WIRED,
                f"{text}; error {100 * as_declared:.0f} % of the predicted motion, {100 * found:.0f} % the other way; "
                f"{action}",
            )
        )
    return out


def dead(m: Measurement, p: TrialPrediction) -> list[Finding]:
    """Encoders that stand still while their body should move."""
    out = []
    for i, name in enumerate(ENCODER_CHANNELS):
        moved, expected = (
            np.ptp(m.change_rad[:, i]),
            np.ptp(p.model.change_rad(name)[np.isfinite(p.model.angle_rad[:, 0])]),
        )
        if moved < STANDS_STILL * expected:
            text = (
                f"trial {m.number}: encoder {name}: it moves by {1e3 * moved:.2f} mrad where {1e3 * expected:.0f} mrad "
                "are predicted (dead channel); check scale, cable and counter"
            )
            out.append(Finding("dead channel", m.number, name, float(moved), float(STANDS_STILL * expected), text))
    return out


def hum(m: Measurement) -> list[Finding]:
    """Mains hum that was subtracted and is large enough to look for its cause."""
    fit = m.force.hum
    amplitude = max(fit.amplitude_n)
    if not fit.accepted or amplitude <= HUM_N:
        return []
    text = (
        f"trial {m.number}: force: hum of {amplitude:.2f} N at {fit.frequency_hz:.2f} Hz was subtracted "
        f"(limit {HUM_N:g} N); check shield and ground of the load cell"
    )
    return [Finding("hum", m.number, "force", amplitude, HUM_N, text)]


def camera_clock(m: Measurement) -> list[Finding]:
    """Film times against the DAQ clock, by the whippen that both film and encoder see."""
    film = m.film
    if film is None or film.whippen_rad is None:
        return []
    offset, u = clock_offset(film.time_s, film.whippen_rad, m.time_s, m.change_rad[:, 1])
    limit = max(CLOCK_S, 3 * float(np.hypot(u, film.u_time_s)))
    if not abs(offset) > limit:
        return []
    side = "late" if offset > 0 else "early"
    text = (
        f"trial {m.number}: film: frame times are {1e3 * abs(offset):.2f} ms {side} against the whippen's encoder "
        f"(u {1e3 * u:.3f} ms, limit {1e3 * limit:.2f} ms); check trigger frame, exposure and delay of the camera"
    )
    return [Finding("camera offset", m.number, "film", offset, limit, text)]


def clock_offset(film_s: Array, film_rad: Array, time_s: Array, angle_rad: Array) -> tuple[float, float]:
    """Delay of a film's clock against the encoder's, s, positive when frame times are late, and its uncertainty.

    Least squares of delay and zero by Gauss–Newton; the uncertainty takes neighbouring residuals for dependent.
    """
    from validation.measurement.mains_hum import correlation_inflation

    speed = np.gradient(angle_rad, time_s)
    delay, u = 0.0, float("nan")
    for _ in range(20):
        at = film_s - delay
        known = np.isfinite(film_rad) & (at > time_s[0]) & (at < time_s[-1])
        if known.sum() < 10:
            return 0.0, float("nan")
        difference = film_rad[known] - np.interp(at[known], time_s, angle_rad)
        design = np.column_stack([np.ones(known.sum()), -np.interp(at[known], time_s, speed)])
        value, *_ = np.linalg.lstsq(design, difference, rcond=None)
        residual = difference - design @ value
        variance = float(residual @ residual) / max(known.sum() - 2, 1) * correlation_inflation(residual)
        u = float(np.sqrt(variance * np.linalg.pinv(design.T @ design)[1, 1]))
        delay += float(np.clip(value[1], -5e-3, 5e-3))
        if abs(value[1]) < 1e-9:
            break
    return delay, u


def rates(measured: list[Measurement]) -> list[Finding]:
    """Trials that were sampled at another rate than most."""
    rate = {m.number: (m.time_s.size - 1) / float(m.time_s[-1] - m.time_s[0]) for m in measured}
    usual = float(np.median(list(rate.values())))
    return [
        Finding(
            "sample rate",
            number,
            "",
            value,
            usual,
            f"trial {number}: sampled at {value:.6g} Hz, most trials at {usual:.6g} Hz; curves are put on one time "
            "base by straight lines, prefer one rate per session",
        )
        for number, value in rate.items()
        if abs(value / usual - 1) > RATE_RELATIVE
    ]


def short_records(measured: list[Measurement]) -> list[Finding]:
    """Trials whose record ends well before the others': every curve is scored up to there only."""
    end = {m.number: float(m.time_s[-1]) for m in measured}
    usual = float(np.median(list(end.values())))
    return [
        Finding(
            "short record",
            number,
            "",
            value,
            usual,
            f"trial {number}: its record ends at {value:.3f} s, most end at {usual:.3f} s; no score looks further than "
            "the shortest record, annotate this trial to leave it out",
        )
        for number, value in end.items()
        if value < usual - max(SHORT_S, SHORT_SHARE * usual)
    ]


def lifts(marks: dict[int, list[Lift]]) -> list[Finding]:
    """The largest lift of each trial that has one."""
    out = []
    for number, found in marks.items():
        if not found:
            continue
        worst = max(found, key=lambda x: x.gap_m)
        times = "once" if len(found) == 1 else f"{len(found)} times"
        text = (
            f"trial {number}: key: lifts off its balance rail {times}, by about {1e3 * worst.lift_m:.2f} mm at "
            f"{worst.largest_at_s:.4f} s; these samples are left out of the scores"
        )
        out.append(Finding("key lift", number, "key", worst.lift_m, 0.0, text))
    return out


def distorted_trials(findings: Sequence[Finding]) -> list[int]:
    """Trials whose curves are not what happened, or not the others' blow: they widen what is called repeatability."""
    return sorted({int(f.trial) for f in findings if f.kind in DISTORTING and np.isfinite(f.trial)})


def finding_table(findings: list[Finding]) -> pd.DataFrame:
    """Every finding as a row."""
    return pd.DataFrame([asdict(f) for f in findings], columns=COLUMNS)


def summary_line(findings: Sequence[Finding]) -> str:
    """All kinds of finding with their trials in one sentence; empty when there is none."""
    kinds: dict[str, list[int]] = {}
    for f in findings:
        trials = kinds.setdefault(f.kind, [])
        if np.isfinite(f.trial) and int(f.trial) not in trials:
            trials.append(int(f.trial))
    if not kinds:
        return ""
    parts = []
    for kind, trials in kinds.items():
        where = f"trial{'' if len(trials) == 1 else 's'} {', '.join(map(str, trials))}" if trials else "model"
        parts.append(f"{kind} ({where})")
    return f"Faults found: {', '.join(parts)}; read the warnings before the scores."
