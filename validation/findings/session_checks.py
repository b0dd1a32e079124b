"""Checks of the recorded trials: wiring, dead channels, hum, sample rates, short records, lifts of the key.

Conventions: nothing is repaired and no trial removed; a finding names the trial, what was found, the limit, what to do.
Source: each rule compares with the model under test or with the other trials; limits stand beside the rules, and a
session without faults raises none (`tests/validation/findings/test_planted_faults.py`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from validation.conventions import ENCODER_CHANNELS
from validation.events.encoder_wiring import WRONG_WIRED, miswired_channels
from validation.events.key_lift import KeyLift
from validation.findings.finding import SessionFinding
from validation.measurement.trial import MeasuredTrial
from validation.prediction.trial_prediction import PredictedAngles

HUM_N = 0.1
LIFT_LATE_M = 0.15e-3  # as stated, which is some 70 % of the true lift
RATE_RELATIVE = 1e-4
SHORT_S = 0.02
SHORT_SHARE = 0.1
STANDS_STILL = 0.01  # of the predicted range


def wiring(m: MeasuredTrial, p: PredictedAngles) -> list[SessionFinding]:
    """Encoders that turn the wrong way round, or stand in each other's place."""
    out = []
    for found in miswired_channels(m, p):
        name, is_swapped = found.channel, found.recorded_as != found.channel
        parts = []
        if is_swapped:
            parts.append(f"what is recorded as {found.recorded_as} moves as the {name} should; channels are swapped")
        if found.reversed:
            parts.append("it turns the wrong way round (sign flip)")
        text = (
            f"trial {m.number}: encoder {name}: {', and '.join(parts)}; error {100 * found.error:.0f} % of the "
            f"predicted motion, {100 * found.error_rewired:.0f} % the other way; it counts in no pooled figure; "
            "correct the rig file's channels or signs and record again"
        )
        kind = "swapped channels" if is_swapped else "sign flip"
        out.append(SessionFinding(kind, m.number, name, found.error, WRONG_WIRED, text))
    return out


def dead(m: MeasuredTrial, p: PredictedAngles) -> list[SessionFinding]:
    """Encoders that stand still while their body should move."""
    out = []
    for i, name in enumerate(ENCODER_CHANNELS):
        moved, expected = (
            np.ptp(m.change_rad[:, i]),
            np.ptp(p.change_rad(name)[np.isfinite(p.angle_rad[:, 0])]),
        )
        if moved < STANDS_STILL * expected:
            text = (
                f"trial {m.number}: encoder {name}: it moves by {1e3 * moved:.2f} mrad where {1e3 * expected:.0f} mrad "
                "are predicted (dead channel); check scale, cable and counter"
            )
            out.append(
                SessionFinding("dead channel", m.number, name, float(moved), float(STANDS_STILL * expected), text)
            )
    return out


def hum(m: MeasuredTrial) -> list[SessionFinding]:
    """Mains hum that was subtracted and is large enough to look for its cause."""
    fit = m.force.hum
    amplitude = max(fit.amplitude_n)
    if not fit.accepted or amplitude <= HUM_N:
        return []
    text = (
        f"trial {m.number}: force: hum of {amplitude:.2f} N at {fit.frequency_hz:.2f} Hz was subtracted "
        f"(limit {HUM_N:g} N); check shield and ground of the load cell"
    )
    return [SessionFinding("hum", m.number, "force", amplitude, HUM_N, text)]


def rates(measured: Sequence[MeasuredTrial]) -> list[SessionFinding]:
    """Trials that were sampled at another rate than most."""
    rate = {m.number: (m.time_s.size - 1) / float(m.time_s[-1] - m.time_s[0]) for m in measured}
    usual = float(np.median(list(rate.values())))
    return [
        SessionFinding(
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


def short_records(measured: Sequence[MeasuredTrial]) -> list[SessionFinding]:
    """Trials whose record ends well before the others': every curve is scored up to there only."""
    end = {m.number: float(m.time_s[-1]) for m in measured}
    usual = float(np.median(list(end.values())))
    return [
        SessionFinding(
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


def lifts(by_trial: Mapping[int, Sequence[KeyLift]], release_s: Mapping[int, float]) -> list[SessionFinding]:
    """The largest lift of each trial that has one; after the release the model's timing tells large ones only."""
    out = []
    for number, every in by_trial.items():
        found = [x for x in every if x.lift_m > LIFT_LATE_M or not x.largest_at_s > release_s[number]]
        if not found:
            continue
        worst = max(found, key=lambda x: x.gap_m)
        times = "once" if len(found) == 1 else f"{len(found)} times"
        text = (
            f"trial {number}: key: lifts off its balance rail {times}, by about {1e3 * worst.lift_m:.2f} mm at "
            f"{worst.largest_at_s:.4f} s; these samples are left out of the scores"
        )
        out.append(SessionFinding("key lift", number, "key", worst.lift_m, 0.0, text))
    return out
