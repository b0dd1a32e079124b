"""What is seen of the encoders: wiring, no motion, travel, return to rest, stuck bits, gaps at the capstan.

Conventions: nothing is repaired and no trial removed; a finding names the trial, what was found, the limit, what to do.
Source: each rule compares with the model under test or with the other trials; limits stand beside the rules, and a
session without faults raises none (`tests/validation/findings/test_planted_faults.py`).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from validation.conventions import ENCODER_CHANNELS, Array, rms
from validation.events.contact import SHARP_M_PER_S
from validation.events.definitions import Event
from validation.events.detect import LONG_S
from validation.events.encoder_readings import EDGE_S, MOVES_RAD
from validation.events.key_lift import EXCESS_M, KeyLift
from validation.events.miswired_encoders import MISSED, find_miswired_channels
from validation.findings.finding import (
    CHANNEL,
    CURVES,
    SessionFinding,
    make_finding,
    name_trials,
    register_kinds,
    uncertainty_of_mean,
)
from validation.findings.limits import FAR, GROSS, SCALES_MAY
from validation.measurement.geometry import ActionGeometry
from validation.measurement.trial import MeasuredTrial
from validation.numbers import with_named_u
from validation.prediction.predict_session import PredictedAngles

MOVES_AS_PREDICTED = 0.5  # of the predicted range, at least: choice, half is neither still nor wrong


@register_kinds(
    {
        "sign flip": "Turn the sign of the encoder in the {settings} and {remake}.",
        "swapped channels": "Exchange the channels in the {settings} and {remake}.",
    },
    spoils=CHANNEL,
)
def find_miswired_encoders(m: MeasuredTrial, p: PredictedAngles) -> list[SessionFinding]:
    """One finding for each encoder of trial ``m`` whose motion fits the prediction ``p`` only with the opposite sign
    (sign flip) or as another encoder's (swapped channels); its value is the error as wired, a share of the predicted
    motion."""
    out = []
    for found in find_miswired_channels(m, p):
        name, recorded_as = ENCODER_CHANNELS[found.place], ENCODER_CHANNELS[found.source]
        is_swapped = recorded_as != name
        parts = []
        if is_swapped:
            parts.append(f"what is recorded as {recorded_as} moves as the {name} should (swapped channels)")
        if found.reversed:
            parts.append("it turns the wrong way round (sign flip)")
        text = (
            f"trial {m.number}: encoder {name}: {', and '.join(parts)}; error {100 * found.error:.0f} % of the "
            f"predicted motion, {100 * found.error_rewired:.0f} % the other way, in motion and at rest"
        )
        kind = "swapped channels" if is_swapped else "sign flip"
        out.append(SessionFinding(kind, m.number, name, found.error, MISSED, text))
    return out


@register_kinds({"no motion": "Check scale, cable and counter of the encoder that stands still."}, spoils=CHANNEL)
def find_motionless_encoders(m: MeasuredTrial, p: PredictedAngles) -> list[SessionFinding]:
    """One finding for each encoder that moves by less than a hundredth of its predicted range while another one moves
    by more than half of its own; the value is its range, rad."""
    known = np.isfinite(p.angle_rad[:, 0])
    moved = np.ptp(m.change_rad, axis=0)
    expected = np.array([np.ptp(p.change_rad(name)[known]) for name in ENCODER_CHANNELS])
    out = []
    for i, name in enumerate(ENCODER_CHANNELS):
        others = np.delete(moved > MOVES_AS_PREDICTED * expected, i)
        if moved[i] < FAR * expected[i] and others.any():
            text = (
                f"trial {m.number}: encoder {name}: it moves by {1e3 * moved[i]:.2f} mrad where "
                f"{1e3 * expected[i]:.0f} mrad are predicted (limit {100 * FAR:g} %), while another "
                "one moves as predicted"
            )
            limit = float(FAR * expected[i])
            out.append(SessionFinding("no motion", m.number, name, float(moved[i]), limit, text))
    return out


FEWEST_RISING = 5  # samples of which a slope is taken
PRESSED = 0.25  # of the key's dip, in the prediction: less is play and felt
ON_FELT_S = 0.01  # for which a key rests on its felt: a touch in passing is shorter
SHARP_S = (EDGE_S, 4e-3)  # before and after a turn round: beyond the contact with a string, within the flight


@dataclass(frozen=True)
class Travel:
    """Travel of key, whippen and hammer over the predicted one, (3,), NaN where the stops were not reached.

    ``lever`` is that of the whippen over that of the key, ``held`` whether the predicted key rests on its felt,
    ``hammer_lever`` the way of the hammer for that of the whippen over the predicted one, before it flies, ``apart``
    the share of the key's turn that does not go with the whippen's.
    """

    ratio: Array
    lever: float
    held: bool
    hammer_lever: float = float("nan")
    apart: float = 0.0


def measure_travel(
    m: MeasuredTrial, p: PredictedAngles, model: Mapping[str, Event], geometry: ActionGeometry
) -> Travel:
    """Travel of one trial over its prediction: largest magnitudes of key, whippen and hammer angle, and lever ratios,
    as the fields of `Travel`; NaN where the stops were not reached. ``model``: the prediction's events by name. Signs
    do not enter."""
    out = np.full(3, np.nan)
    expected = np.column_stack([p.change_rad(name) for name in ENCODER_CHANNELS])
    known = np.isfinite(expected).all(axis=1)
    if not known.any():
        return Travel(out, float("nan"), False)
    size, wanted = np.abs(m.change_rad[known]).max(axis=0), np.abs(expected[known]).max(axis=0)
    dip = geometry.key_dip_m(p.angle_rad[known])
    step = float(np.median(np.diff(m.time_s)))
    on_felt = step * int((dip > geometry.key_touch_dip_m).sum())
    if on_felt > 0:
        out[:2] = size[:2] / wanted[:2]
    # small motions depend on felts and play, and a key that is lifted instead of pressed tells nothing of levers
    pressed = float(dip.max()) > PRESSED * geometry.key_touch_dip_m
    moves = pressed and min(size[0], wanted[0]) > MOVES_RAD and min(size[1], wanted[1]) > MOVES_RAD
    lever = float(size[1] * wanted[0] / (wanted[1] * size[0])) if moves else float("nan")
    if model["string_impact"].status == "found" and wanted[2] > 0 and size[2] > 0:
        ratio = float(size[2] / wanted[2])
        to_m = geometry.string_lever_m / ratio
        if _has_sharp_turn(m.time_s[known], to_m * np.abs(m.change_rad[known, 2]), step):
            out[2] = ratio
    hammer_lever = _fit_lever_before_flight(m.change_rad[known]) / _fit_lever_before_flight(expected[known])
    key, whippen = m.change_rad[known, 0], m.change_rad[known, 1]
    share = float(key @ whippen) / max(float(whippen @ whippen), 1e-300)
    return Travel(out, lever, on_felt >= ON_FELT_S, hammer_lever, rms(key - share * whippen) / max(rms(key), 1e-300))


RISES = (0.1, 0.5)  # choice, of the hammer's largest angle: from there to there the jack carries it


def _fit_lever_before_flight(change_rad: Array) -> float:
    """Slope of the hammer's angle over the whippen's, of changes (n, 3) of key, whippen, hammer, rad, while the hammer
    first rises; NaN where either hardly moves."""
    hammer = np.abs(change_rad[:, 2])
    first, last = (int(np.argmax(hammer > share * hammer.max(initial=0.0))) for share in RISES)
    if last - first < FEWEST_RISING or not np.ptp(change_rad[first:last, 1]) > MOVES_RAD:
        return float("nan")
    return float(np.polyfit(change_rad[first:last, 1], change_rad[first:last, 2], 1)[0])


def _has_sharp_turn(time: Array, height: Array, step: float) -> bool:
    """Whether a path ``height`` (n,), m, sampled every ``step`` s, turns round at its largest value with speeds of more
    than 0.15 m/s on both sides, as at a string; gravity turns it more slowly."""
    top = int(np.argmax(height))
    near, far = (max(round(x / step), 1) for x in SHARP_S)
    if near == far or top < far or top + far >= time.size:
        return False
    rise = (height[top - near] - height[top - far]) / ((far - near) * step)
    fall = (height[top + near] - height[top + far]) / ((far - near) * step)
    return bool(min(rise, fall) > SHARP_M_PER_S / 2)


@register_kinds({"gross travel difference": "Check decoding and lines per revolution of the encoder, and its place."},
       spoils=CHANNEL)  # fmt: skip
@register_kinds({"travel difference": "Measure key dip and blow distance, and check the scale of the encoder."})
def find_travel_differences(
    travels: Mapping[int, Travel], excluded: Collection[tuple[int, str]] = ()
) -> list[SessionFinding]:
    """Findings of encoders whose travel over the prediction's is more than 5 % from 1; beyond 20 %, where a wrong scale
    explains it, gross ones. ``travels`` by trial number; pairs (trial, channel) of ``excluded`` do not count.

    Conventions: ratios of largest angles, trial over prediction, which share stops and levers and not their timing.
    *Lever*: whippen over key, in every stroke. *Stops*: key and whippen where the predicted key meets its felt; hammer
    where both turn round sharply at the top. Stated from 5 %; without faults the ratios are within 1 %. From 20 % on a
    channel is left out where the other encoders' travel is the model's and it goes with the whippen all the way, as by
    a scale; key and whippen alike are the motion's. So is a hammer that only ends elsewhere.
    """
    hammer = {n: float(t.ratio[2]) for n, t in travels.items() if (n, "hammer") not in excluded}
    lower = {n: t for n, t in travels.items() if not {(n, "key"), (n, "whippen")} & set(excluded)}
    ratios: dict[str, dict[int, float]] = {"key": {}, "whippen": {}, "key and whippen": {}, "hammer": hammer}
    levers: dict[int, float] = {}
    stopped = [n for n, t in lower.items() if _has_another_key_stop(t)]
    ratios["hammer"] = {n: ratio for n, ratio in hammer.items() if n not in stopped}  # it goes where the key takes it
    told = Counter(
        _name_wrong_encoder(t)
        for t in lower.values()
        if abs(t.lever - 1) > SCALES_MAY and np.isfinite(t.ratio[:2]).all()
    )
    for number, t in lower.items():
        reached = bool(np.isfinite(t.ratio[:2]).all())
        if abs(t.lever - 1) > SCALES_MAY and (reached or told):
            # a trial that reached the stops tells of which encoder; the others have the same encoders
            name = _name_wrong_encoder(t) if reached else told.most_common(1)[0][0]
            ratios[name][number] = t.lever if name == "whippen" else 1 / t.lever
            if reached and min(np.abs(t.ratio[:2] - 1)) > SCALES_MAY:  # neither goes as far as in the model
                ratios["key"][number], ratios["whippen"][number] = t.ratio[:2].tolist()
        elif abs(t.lever - 1) > SCALES_MAY:
            levers[number] = t.lever
        elif reached and (t.held or abs(t.ratio[0] - 1) > GROSS):
            ratios["key and whippen"][number] = float(t.ratio[0])
    hammer_goes = {n for n, t in travels.items() if abs(t.hammer_lever - t.ratio[2]) < abs(t.hammer_lever - 1)}
    key_goes = {n for n, t in travels.items() if t.apart < GROSS and not _has_another_key_stop(t)}
    out = []
    for name, found in ratios.items():
        out += _describe_travel(name, found, travels, hammer_goes if name == "hammer" else key_goes)
    if levers:
        text = (
            f"encoders key and whippen: {name_trials(levers, travels)} the whippen turns {_format_mean(levers)} times "
            f"as far for the key's turn as in the model (limit {100 * SCALES_MAY:g} %)"
        )
        out.append(make_finding("travel difference", "key", levers, SCALES_MAY, text))
    return out


def _has_another_key_stop(t: Travel) -> bool:
    """Whether key and whippen both travel far less, or both far more, than in the model."""
    away = t.ratio[:2] - 1
    return bool(np.all(np.abs(away) > GROSS)) and away[0] * away[1] > 0


def _name_wrong_encoder(t: Travel) -> str:
    """Which of key and whippen misses the stops."""
    return "whippen" if abs(t.ratio[1] - 1) > abs(t.ratio[0] - 1) else "key"


def _describe_travel(
    name: str, ratios: Mapping[int, float], trials: Collection[int], scale_trials: Collection[int]
) -> list[SessionFinding]:
    """Findings for the channel ``name`` from its travel over the model's (``ratios``, by trial number) among all
    ``trials``: one gross (beyond 20 %; only of ``scale_trials``, where a wrong scale explains it) and one small (beyond
    5 %), if any."""
    both = " and " in name
    head, verb = (f"encoders {name}", "they travel") if both else (f"encoder {name}", "it travels")
    away = {n: r for n, r in ratios.items() if abs(r - 1) > SCALES_MAY}
    gross = {n: r for n, r in away.items() if abs(r - 1) > GROSS and not both and n in scale_trials}
    out = []
    for kind, part, limit in (
        ("gross travel difference", gross, GROSS),
        ("travel difference", {n: r for n, r in away.items() if n not in gross}, SCALES_MAY),
    ):
        if part:
            text = (
                f"{head}: {name_trials(part, trials)} {verb} {_format_mean(part)} times as far as in "
                f"the model (limit {100 * limit:g} %)"
            )
            out.append(make_finding(kind, "key" if both else name, part, limit, text))
    return out


def _format_mean(values: Mapping[int, float]) -> str:
    mean, u = float(np.mean(list(values.values()))), uncertainty_of_mean(values.values())
    return with_named_u(mean, u) if np.isfinite(u) else f"{mean:.3f}"


STILL_RAD = 0.3e-3  # within `LONG_S`, some eight counts of a scale on the key
DRIFTS = 0.5  # choice, of the rate that leads from the first reading to the last
MOVED_BY = (1, 0, 1)  # the encoder whose body moves with each: where both end elsewhere, it is the motion that does
RETURNS_RAD = (3e-3, 5e-3, 1.5e-3)  # key, whippen, hammer: friction lets a soft stroke rest up to half of it away


def select_last_samples(m: MeasuredTrial) -> slice:
    return slice(int(np.searchsorted(m.time_s, m.time_s[-1] - LONG_S)), m.time_s.size)


def is_standing_still(m: MeasuredTrial) -> NDArray[np.bool_]:
    return np.asarray(np.ptp(m.change_rad[select_last_samples(m)], axis=0) < STILL_RAD)


def is_at_rest_again(m: MeasuredTrial) -> NDArray[np.bool_]:
    """Whether each encoder ends at rest, back at its angle of rest."""
    return is_standing_still(m) & (np.abs(m.change_rad[select_last_samples(m)].mean(axis=0)) < np.array(RETURNS_RAD))


@register_kinds(
    {"encoder return": "Check signal level and largest count rate of the encoder, then record again."},
    spoils=CURVES,
)
def find_encoder_returns(m: MeasuredTrial, p: PredictedAngles) -> list[SessionFinding]:
    """One finding for each encoder whose mean over the last 50 ms is off its reading before the stroke by more than 3
    (key), 5 (whippen) or 1.5 mrad (hammer), though the stroke is over; the value is that difference, rad.

    Conventions: rad, changes since rest. Named is an encoder that reads something else and stands still, or goes on at
    the rate that led there, while the body that moves it is back at rest, and so is the model or the third one.
    """
    end = m.change_rad[select_last_samples(m)].mean(axis=0)
    still, back = is_standing_still(m), is_at_rest_again(m)
    known = np.isfinite(p.angle_rad[:, 0])
    if not known.any():
        return []
    last = np.flatnonzero(known)[-1]
    model_back = all(
        abs(float(p.change_rad(name)[last])) < limit for name, limit in zip(ENCODER_CHANNELS, RETURNS_RAD, strict=True)
    )
    over = model_back or int(back.sum()) == 2
    rate = np.polyfit(m.time_s[select_last_samples(m)], m.change_rad[select_last_samples(m)], 1)[0]
    out = []
    for i, name in enumerate(ENCODER_CHANNELS):
        if not (over and back[MOVED_BY[i]]) or back[i] or abs(end[i]) < RETURNS_RAD[i]:
            continue
        others = int(np.delete(back, i).sum()) == 2
        drifts = others and abs(rate[i] * (m.time_s[-1] - m.time_s[0]) / end[i] - 1) < DRIFTS
        if not (still[i] or drifts):
            continue
        counts = end[i] / m.resolution_rad[i]
        text = (
            f"trial {m.number}: encoder {name}: at the end of the record it reads {1e3 * end[i]:+.2f} mrad against "
            f"before, {counts:+.0f} counts (limit {1e3 * RETURNS_RAD[i]:g} mrad)"
        )
        if not still[i]:
            text += f", and goes on by {1e3 * rate[i]:+.2g} mrad/s while the other two stand where they began"
        out.append(SessionFinding("encoder return", m.number, name, float(end[i]), RETURNS_RAD[i], text))
    return out


SECTORS = 16  # into which twice a bit's weight is divided: choice
FILLED = 10  # sectors, at most, with a stuck bit, which leaves eight and their neighbours
FEWEST_COUNTS = 200  # so that a turning encoder leaves none of 16 sectors empty (chance below 1e-4)
LOWEST = 6  # below, a sector is so narrow that wrong decoding leaves it empty
PASSES = 4  # of the bit, so that one that stands still by chance is none


@register_kinds({"stuck bit": "Check cable and counter of the encoder, then record again."}, spoils=CURVES)
def find_stuck_bits(m: MeasuredTrial) -> list[SessionFinding]:
    """One finding for each encoder with a counter bit that never changes, told by counts that never occur; the value is
    the lowest such bit, 0 being the least significant. Bits below 6 are not tested.

    Conventions: counts since rest modulo twice the bit's weight, in sixteen sectors. A turning encoder fills all of
    them; with a stuck bit, and whatever the first count, half stay empty. Looked for are bits whose weight the travel
    passes four times or more, with 200 different counts; a stuck lowest bit is half the resolution and not detectable.
    """
    out = []
    for i, name in enumerate(ENCODER_CHANNELS):
        change = m.change_rad[:, i]
        counts = np.unique(np.rint((change - change[0]) / m.resolution_rad[i]).astype(np.int64))
        extent = int(np.ptp(counts)) if counts.size else 0
        bit = LOWEST
        while counts.size >= FEWEST_COUNTS and PASSES * 2 ** (bit + 1) <= extent:
            sector = np.unique(counts % 2 ** (bit + 1) // (2 ** (bit + 1) // SECTORS))
            if sector.size <= FILLED:
                text = (
                    f"trial {m.number}: encoder {name}: of the values of the counter's bit {bit} only half occur: the "
                    f"bit is stuck, which shifts a reading by up to {2**bit} counts"
                )
                out.append(SessionFinding("stuck bit", m.number, name, float(bit), float(FILLED), text))
                break
            bit += 1
    return out


LIFT_LATE_M = 0.15e-3  # as stated, which is some 70 % of the true lift


@register_kinds({"capstan gap": ""})
def find_capstan_gaps(
    by_trial: Mapping[int, Sequence[KeyLift]], release_s: Mapping[int, float]
) -> list[SessionFinding]:
    """One finding for each trial with a disagreement of key and whippen encoder: its largest gap at the capstan, m.
    ``by_trial``: lifts of the key, ``release_s``: times of the key's release, both by trial number.

    After the release the model's timing tells large ones only.
    """
    out = []
    for number, every in by_trial.items():
        found = [x for x in every if x.lift_m > LIFT_LATE_M or not x.largest_at_s > release_s[number]]
        if not found:
            continue
        worst = max(found, key=lambda x: x.gap_m)
        text = (
            f"trial {number}: the gap at the loaded capstan, by key and whippen encoder, is larger than the model's, "
            f"by up to {1e3 * worst.gap_m:.2f} mm at {worst.largest_at_s:.4f} s (limit {1e3 * EXCESS_M:g} mm); these "
            "samples are left out of the scores of the key"
        )
        out.append(SessionFinding("capstan gap", number, "key", worst.gap_m, EXCESS_M, text))
    return out
