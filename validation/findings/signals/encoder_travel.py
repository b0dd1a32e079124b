"""Travel of the encoders against the action's stops: whatever the force, key and hammer go as far as they can.

Conventions: ratio of the largest angle of trial and prediction, which share their stops and not their timing. Key and
whippen are compared where the predicted key rests on its felt for 10 ms; the hammer where both turn round sharply at
the top. A wrong scale, and stops that lie elsewhere (dip, blow distance), give the same ratio: between 5 % and 20 %
the two are named together, beyond 20 % only a scale is left. Detectable from 5 %; without faults the ratio is within
1 %.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from validation.conventions import ENCODER_CHANNELS, Array
from validation.events.definitions import Event
from validation.findings.finding import SessionFinding
from validation.measurement.geometry import ActionGeometry
from validation.measurement.trial import MeasuredTrial
from validation.prediction.trial_prediction import PredictedAngles

STOPS_MAY = 0.05
SCALE_ONLY = 0.2
AGREE = 0.25  # of the deviation, largest scatter between trials
ON_FELT_S = 0.01
SHARP_M_PER_S = 0.15  # beyond what gravity turns round within SHARP_S
SHARP_S = (1e-3, 4e-3)
DECODING = {0.25: "decoded × 1 and declared × 4", 0.5: "decoded × 2 and declared × 4, or × 1 and × 2"}
DECODING |= {2.0: "twice the counts declared", 4.0: "decoded × 4 and declared × 1"}
NEAR_DECODING = 0.03


def travel_ratios(m: MeasuredTrial, p: PredictedAngles, model: Mapping[str, Event], geometry: ActionGeometry) -> Array:
    """Travel of key, whippen and hammer over the predicted one, (3,); NaN where the stops were not reached."""
    out = np.full(3, np.nan)
    expected = np.column_stack([p.change_rad(name) for name in ENCODER_CHANNELS])
    known = np.isfinite(expected).all(axis=1)
    if not known.any():
        return out
    # the sign belongs to the wiring
    size, wanted = np.abs(m.change_rad[known]).max(axis=0), np.abs(expected[known]).max(axis=0)
    dip = geometry.key_dip_m(p.angle_rad[known])
    step = float(np.median(np.diff(m.time_s)))
    if step * int((dip > geometry.key_touch_dip_m).sum()) >= ON_FELT_S:
        out[:2] = size[:2] / wanted[:2]
    if model["string_impact"].status == "found" and wanted[2] > 0 and size[2] > 0:
        ratio = float(size[2] / wanted[2])
        to_m = geometry.string_lever_m / ratio
        if _turns_sharply(m.time_s[known], to_m * np.abs(m.change_rad[known, 2]), step):
            out[2] = ratio
    return out


def _turns_sharply(time: Array, way: Array, step: float) -> bool:
    """Whether the way turns round at its largest value as at a string, not as under gravity."""
    top = int(np.argmax(way))
    near, far = (max(round(x / step), 1) for x in SHARP_S)
    if near == far or top < far or top + far >= time.size:
        return False
    rise = (way[top - near] - way[top - far]) / ((far - near) * step)
    fall = (way[top + near] - way[top + far]) / ((far - near) * step)
    return bool(min(rise, fall) > SHARP_M_PER_S)


def encoder_travel(ratios: Mapping[int, Array], without: Sequence[tuple[int, str]] = ()) -> list[SessionFinding]:
    """Encoders whose travel does not fit the action's stops.

    Parameters
    ----------
    ratios : dict
        Trial → `travel_ratios`.
    without : sequence
        (trial, channel) that are wired wrong.
    """
    blocked = {
        n: float(r[0]) for n, r in ratios.items() if _both(r) and not {(n, "key"), (n, "whippen")} & set(without)
    }
    out = [_not_reached(number, ratio) for number, ratio in blocked.items()]
    for i, name in enumerate(ENCODER_CHANNELS):
        counting = {n: r for n, r in ratios.items() if n not in blocked and (n, name) not in without}
        found = {n: float(r[i]) for n, r in counting.items() if np.isfinite(r[i])}
        gross = {n: r for n, r in found.items() if not 1 - SCALE_ONLY < r < 1 + SCALE_ONLY and r > 0.02}
        out += [_scale(number, name, ratio) for number, ratio in gross.items()]
        rest = np.array([r for n, r in found.items() if n not in gross])
        if rest.size < max(2, len(ratios) // 2):
            continue
        middle = float(np.median(rest))
        if abs(middle - 1) > STOPS_MAY and float(np.abs(rest - middle).max()) < AGREE * abs(middle - 1):
            out.append(_travel(name, middle))
    return out


def _both(ratio: Array) -> bool:
    """Whether key and whippen miss their stops alike: then the key did not go there."""
    key, whippen = (float(x) for x in ratio[:2])
    return abs(key - 1) > SCALE_ONLY and abs(whippen / key - 1) < SCALE_ONLY


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
