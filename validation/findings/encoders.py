"""Faults of the encoders: wiring, dead channels, scale, lost counts, stuck bits, lifts of the key.

Conventions: nothing is repaired and no trial removed; a finding names the trial, what was found, the limit, what to do.
Source: each rule compares with the model under test or with the other trials; limits stand beside the rules, and a
session without faults raises none (`tests/validation/findings/test_planted_faults.py`).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from validation.conventions import ENCODER_CHANNELS, Array
from validation.events.definitions import Event
from validation.events.key_lift import KeyLift
from validation.events.miswired_encoders import WRONG_WIRED, miswired_channels
from validation.findings.finding import CHANNEL, CURVES, SessionFinding, finds
from validation.measurement.geometry import ActionGeometry
from validation.measurement.trial import MeasuredTrial
from validation.prediction.predict_session import PredictedAngles

STANDS_STILL = 0.01  # of the predicted range


@finds(
    {
        "sign flip": "Turn the sign of the encoder in the rig file and record again.",
        "swapped channels": "Exchange the channels in the rig file and record again.",
    },
    spoils=CHANNEL,
)
def wiring(m: MeasuredTrial, p: PredictedAngles) -> list[SessionFinding]:
    """Encoders that turn the wrong way round, or stand in each other's place."""
    out = []
    for found in miswired_channels(m, p):
        name, recorded_as = ENCODER_CHANNELS[found.place], ENCODER_CHANNELS[found.source]
        is_swapped = recorded_as != name
        parts = []
        if is_swapped:
            parts.append(f"what is recorded as {recorded_as} moves as the {name} should; channels are swapped")
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


@finds({"dead channel": "Check scale, cable and counter of the encoder that stands still."}, spoils=CHANNEL)
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


STOPS_MAY = 0.05
SCALE_ONLY = 0.2
MOVES_RAD = 2e-3
PRESSED = 0.25  # of the key's dip, in the prediction
AGREE = 0.25  # of the deviation, largest scatter between trials
ON_FELT_S = 0.01
SHARP_M_PER_S = 0.15  # beyond what gravity turns round within SHARP_S
SHARP_S = (1e-3, 4e-3)
DECODING = {0.25: "decoded × 1 and declared × 4", 0.5: "decoded × 2 and declared × 4, or × 1 and × 2"}
DECODING |= {2.0: "twice the counts declared", 4.0: "decoded × 4 and declared × 1"}
NEAR_DECODING = 0.03


@dataclass(frozen=True)
class Travel:
    """Travel of key, whippen and hammer over the predicted one, (3,), NaN where the stops were not reached.

    ``lever`` is that of the whippen over that of the key, ``held`` whether the predicted key rests on its felt.
    """

    ratio: Array
    lever: float
    held: bool


def travel_of(m: MeasuredTrial, p: PredictedAngles, model: Mapping[str, Event], geometry: ActionGeometry) -> Travel:
    """Travel of one trial; the sign belongs to the wiring."""
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
        if _turns_sharply(m.time_s[known], to_m * np.abs(m.change_rad[known, 2]), step):
            out[2] = ratio
    return Travel(out, lever, on_felt >= ON_FELT_S)


def _turns_sharply(time: Array, way: Array, step: float) -> bool:
    """Whether the way turns round at its largest value as at a string, not as under gravity."""
    top = int(np.argmax(way))
    near, far = (max(round(x / step), 1) for x in SHARP_S)
    if near == far or top < far or top + far >= time.size:
        return False
    rise = (way[top - near] - way[top - far]) / ((far - near) * step)
    fall = (way[top + near] - way[top + far]) / ((far - near) * step)
    return bool(min(rise, fall) > SHARP_M_PER_S)


@finds({"encoder scale": "Check decoding and lines per revolution of the encoder in the rig file."}, spoils=CHANNEL)
@finds(
    {
        "encoder scale or stops": "Measure key dip and blow distance, and check the scale of the encoder.",
        "stops not reached": "Look at the action: key and whippen end elsewhere than at its stops.",
    }
)
def encoder_travel(travels: Mapping[int, Travel], without: Sequence[tuple[int, str]] = ()) -> list[SessionFinding]:
    """Encoders whose travel does not fit the action's stops or levers.

    Conventions: ratios of largest angles, trial over prediction, which share stops and levers and not their timing.
    *Lever*: whippen over key, in every stroke. *Stops*: key and whippen where the predicted key meets its felt; hammer
    where both turn round sharply at the top. A lever that differs is a wrong scale, of the encoder whose travel misses
    the stops; key and whippen alike are a key dip that is not the model's, or a key that is blocked. A wrong scale of
    the hammer and another blow distance give the same ratio: between 5 % and 20 % the two are named together, beyond 20
    % only a scale is left. Detectable from 5 %; without faults the ratios are within 1 %.

    Parameters
    ----------
    travels : dict
        Trial → `travel_of`.
    without : sequence
        (trial, channel) that something else is said of.
    """
    hammer = {n: float(t.ratio[2]) for n, t in travels.items() if (n, "hammer") not in without}
    lower = {n: t for n, t in travels.items() if not {(n, "key"), (n, "whippen")} & set(without)}
    return _key_and_whippen(lower, len(travels)) + _scales("hammer", hammer, len(travels))


def _key_and_whippen(travels: Mapping[int, Travel], n_trials: int) -> list[SessionFinding]:
    """A lever that differs, or stops that both miss."""
    apart = {n: t for n, t in travels.items() if abs(t.lever - 1) > STOPS_MAY}
    told = Counter(_off(t) for t in apart.values() if np.isfinite(t.ratio[:2]).all())
    by_name: dict[str, dict[int, float]] = {"key": {}, "whippen": {}}
    for number, t in apart.items():
        name = _off(t) if np.isfinite(t.ratio[:2]).all() else (told.most_common(1)[0][0] if told else "")
        if name:
            by_name[name][number] = t.lever if name == "whippen" else 1 / t.lever
    out = [f for name, ratios in by_name.items() for f in _scales(name, ratios, n_trials)]
    if apart and not told:
        lever = float(np.median([t.lever for t in apart.values()]))
        if len(apart) >= max(2, n_trials // 2):
            out.append(_lever(lever))
    alike = {n: t for n, t in travels.items() if n not in apart and np.isfinite(t.ratio[:2]).all()}
    gross = {n: float(t.ratio[0]) for n, t in alike.items() if abs(t.ratio[0] - 1) > SCALE_ONLY}
    out += [_not_reached(number, ratio) for number, ratio in gross.items()]
    held = {n: float(t.ratio[0]) for n, t in alike.items() if t.held and n not in gross}
    return out + _scales("key", held, n_trials)


def _off(t: Travel) -> str:
    """Which of key and whippen misses the stops."""
    return "whippen" if abs(t.ratio[1] - 1) > abs(t.ratio[0] - 1) else "key"


def _scales(name: str, ratios: Mapping[int, float], n_trials: int) -> list[SessionFinding]:
    """A gross scale of single trials, or a smaller one that all trials share."""
    found = {n: r for n, r in ratios.items() if np.isfinite(r)}
    gross = {n: r for n, r in found.items() if not 1 - SCALE_ONLY < r < 1 + SCALE_ONLY}
    out = [_scale(number, name, ratio) for number, ratio in gross.items()]
    rest = np.array([r for n, r in found.items() if n not in gross])
    if rest.size < max(2, n_trials // 2):
        return out
    middle = float(np.median(rest))
    if abs(middle - 1) > STOPS_MAY and float(np.abs(rest - middle).max()) < AGREE * abs(middle - 1):
        out.append(_travel(name, middle))
    return out


def _lever(ratio: float) -> SessionFinding:
    text = (
        f"encoders key and whippen: the whippen turns {ratio:.3f} times as far for the key's turn as the levers of "
        f"this "
        f"action make it (limit {100 * STOPS_MAY:g} %): the scale of one of them is wrong; no stroke reached the "
        f"stops, "
        "which would tell of which"
    )
    return SessionFinding("encoder scale or stops", float("nan"), "key", ratio, STOPS_MAY, text)


def _not_reached(number: int, ratio: float) -> SessionFinding:
    text = (
        f"trial {number}: key and whippen travel {ratio:.3f} times as far as between the stops of this action: the "
        f"key is "
        "blocked or goes past its bed, or the scales of both encoders are wrong; look at the action"
    )
    return SessionFinding("stops not reached", number, "key", ratio, SCALE_ONLY, text)


def _scale(number: int, name: str, ratio: float) -> SessionFinding:
    like = [words for by, words in DECODING.items() if abs(ratio / by - 1) < NEAR_DECODING]
    hint = f", as if {like[0]}" if like else ""
    text = (
        f"trial {number}: encoder {name}: it travels {ratio:.3f} times as far as between the stops of this "
        f"action{hint}: its "
        "scale is wrong; it counts in no pooled figure; check decoding, lines per revolution and interpolation in the "
        "rig file"
    )
    return SessionFinding("encoder scale", number, name, ratio, SCALE_ONLY, text)


def _travel(name: str, ratio: float) -> SessionFinding:
    stop = "blow distance" if name == "hammer" else "key dip"
    text = (
        f"encoder {name}: in all trials it travels {ratio:.3f} times as far as between the stops of this action (limit "
        f"{100 * STOPS_MAY:g} %): its scale is wrong, or the {stop} is not that of the model; measure the {stop}"
    )
    return SessionFinding("encoder scale or stops", float("nan"), name, ratio, STOPS_MAY, text)


END_S = 0.05
STILL_RAD = 0.3e-3
RETURNS_RAD = (3e-3, 5e-3, 1.5e-3)  # key, whippen, hammer: friction lets a soft stroke rest up to half of it away


def end_of(m: MeasuredTrial) -> slice:
    """Samples of the last 50 ms."""
    return slice(int(np.searchsorted(m.time_s, m.time_s[-1] - END_S)), m.time_s.size)


def stands_still(m: MeasuredTrial) -> NDArray[np.bool_]:
    """Whether each encoder stands still at the end of the record."""
    return np.asarray(np.ptp(m.change_rad[end_of(m)], axis=0) < STILL_RAD)


def at_rest_again(m: MeasuredTrial) -> NDArray[np.bool_]:
    """Whether each encoder stands still where it began."""
    return stands_still(m) & (np.abs(m.change_rad[end_of(m)].mean(axis=0)) < np.array(RETURNS_RAD))


@finds(
    {"encoder return": "Check signal level and largest count rate of the encoder, then record again."},
    spoils=CURVES,
)
def encoder_return(m: MeasuredTrial, p: PredictedAngles) -> list[SessionFinding]:
    """Encoders that stand still elsewhere than where they began, though the stroke is over.

    Conventions: rad, changes since rest; the last 50 ms of the record. An encoder that stands still elsewhere, while
    the model or the two others are back, has lost or gained counts, or its body rests elsewhere: the two cannot be told
    apart. Detectable from 3, 5 and 1.5 mrad.
    """
    end = m.change_rad[end_of(m)].mean(axis=0)
    still, back = stands_still(m), at_rest_again(m)
    known = np.isfinite(p.angle_rad[:, 0])
    if not known.any():
        return []
    last = np.flatnonzero(known)[-1]
    model_back = all(
        abs(float(p.change_rad(name)[last])) < limit for name, limit in zip(ENCODER_CHANNELS, RETURNS_RAD, strict=True)
    )
    over = model_back or int(back.sum()) == 2
    out = []
    for i, name in enumerate(ENCODER_CHANNELS):
        if not over or not still[i] or back[i]:
            continue
        counts = end[i] / m.resolution_rad[i]
        text = (
            f"trial {m.number}: encoder {name}: at rest after the stroke it reads {1e3 * end[i]:+.2f} mrad against "
            f"before, "
            f"{counts:+.0f} counts (limit {1e3 * RETURNS_RAD[i]:g} mrad): counts were lost or gained, or the body "
            f"rests "
            "elsewhere; check signal levels and largest count rate of the reader"
        )
        out.append(SessionFinding("encoder return", m.number, name, float(end[i]), RETURNS_RAD[i], text))
    return out


SECTORS = 16
FILLED = 10  # sectors, at most, with a stuck bit
FEWEST_COUNTS = 200
LOWEST = 6  # below, a sector is so narrow that wrong decoding leaves it empty
PASSES = 4


@finds({"stuck bit": "Check cable and counter of the encoder, then record again."}, spoils=CURVES)
def stuck_bits(m: MeasuredTrial) -> list[SessionFinding]:
    """Bits of each encoder's counter that never change.

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
                    f"bit is "
                    f"stuck, an error of up to {2**bit} counts; check cable and counter"
                )
                out.append(SessionFinding("stuck bit", m.number, name, float(bit), float(FILLED), text))
                break
            bit += 1
    return out


LIFT_LATE_M = 0.15e-3  # as stated, which is some 70 % of the true lift


@finds({"key lift": ""})
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
