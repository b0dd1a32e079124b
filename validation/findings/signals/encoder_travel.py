"""Travel of the encoders: whatever the force, key and hammer go as far as their stops, and key and whippen move as
levers.

Conventions: ratios of largest angles, trial over prediction, which share stops and levers and not their timing.
*Lever*: whippen over key, in every stroke. *Stops*: key and whippen where the predicted key meets its felt; hammer
where both turn round sharply at the top. A lever that differs is a wrong scale, of the encoder whose travel misses the
stops; key and whippen alike are a key dip that is not the model's, or a key that is blocked. A wrong scale of the
hammer and another blow distance give the same ratio: between 5 % and 20 % the two are named together, beyond 20 % only
a scale is left. Detectable from 5 %; without faults the ratios are within 1 %.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from validation.conventions import ENCODER_CHANNELS, Array
from validation.events.definitions import Event
from validation.findings.finding import SessionFinding
from validation.measurement.geometry import ActionGeometry
from validation.measurement.trial import MeasuredTrial
from validation.prediction.trial_prediction import PredictedAngles

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


def encoder_travel(travels: Mapping[int, Travel], without: Sequence[tuple[int, str]] = ()) -> list[SessionFinding]:
    """Encoders whose travel does not fit the action's stops or levers.

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
