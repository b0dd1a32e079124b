"""How far a stroke lies from those that a set was fitted to: its domain, by the motion of the key and the force.

A stroke is described by seven properties and the phases it reaches. Along each property the set knows the range of its
strokes, widened by a fixed share of the property on both sides; the distance of a stroke is the largest of its ways out
of a range, in units of that widening, so that 1 is the limit. A phase that no fitted stroke reached has no distance.

Why so: three to ten strokes are fitted, often of one kind or each of another. Their covariance has no inverse, and
shrunk towards anything it says what the anything says; the scale of three strokes is off by a factor of two, and of
strokes of three kinds it says nothing of a kind's own scatter. Fixed widths hold for any number and lie far beyond what
strokes of one kind scatter by; the strokes' own distances, each from the others, stand beside
(docs/explanation/null_model.md).
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from validation.conventions import Array
from validation.events.crossings import find_runs
from validation.events.strikes import RELEASE, find_key_phases, find_key_strikes
from validation.measurement.position_sensors import SPEED_OVER_S
from validation.measurement.trial import MOST_NAMED, trials_in_words

STEP_S = 1e-3
"""Between the samples by which strokes are compared."""
DOWN = 0.8  # of the deepest place, above which the key counts as down: choice
BRIEF_S = 0.1
"""The key's time down counts as t / (t + this): whether a second or three, the hammer hangs in the back check."""
REPEATED = "repetition"
AGAIN = 0.5
"""A note is repeated where the key comes up to less than this share of its depth: about there the jack comes back."""
LOUDER = math.log(1.25)  # choice: a quarter more
FEATURES = {
    "speed": ("fastest way down of the key", "{}/s", LOUDER),
    "depth": ("deepest place of the key", "{}", math.log(1.12)),
    "hold": ("time the key is down", "s", 0.1),
    "release": ("fastest way up of the key", "{}/s", math.log(1.5)),
    "rate": ("strikes a second", "1/s", LOUDER),
    "return": ("how far down the key stays between strikes", "of its depth", 0.15),
    "force": ("largest force", "N", LOUDER),
}
"""Words, unit and widening of each property: of its logarithm (speed, depth, release, rate, force) or as it is."""
LOGARITHMIC = ("speed", "depth", "release", "rate", "force")
Features = Mapping[str, Any]
"""Properties by name, those that a stroke has, and its ``phases``: plain values that a file holds."""


def extract_features(time_s: Array, key: Array, unit: str, force_n: Array | None = None) -> dict[str, Any]:
    """Properties of a stroke by name: speed, release, depth, hold, rate, return and force, those that it has, phases
    and unit; ``key`` (n,): motion from rest, of either sign, in ``unit``, ``force_n`` (n,). Empty where the key is not
    known.

    Parameters
    ----------
    time_s, key : (n,), key from rest; its larger way from rest is down
    unit : of the key, ``m`` or ``rad``; strokes of one unit can be compared
    force_n : ndarray, shape (n,), optional, force on the key, N

    Returns
    -------
    dict
        ``speed`` and ``release`` (unit of the key a second), ``depth``, ``hold`` (s), ``rate`` (1/s), ``return`` (share
        of the depth), ``force`` (N), each where the stroke has it; ``phases``, which of
        strike, release and repetition it reaches (a hold is told by its time); ``unit``. Empty where the
        key is not known.
    """
    known = np.isfinite(key)
    if known.sum() < 2:
        return {}
    at_s = np.arange(float(time_s[0]), float(time_s[-1]), STEP_S)
    place = np.interp(at_s, time_s[known], key[known])
    place = place * np.sign(place[int(np.argmax(np.abs(place)))])
    reach, deepest = round(SPEED_OVER_S / STEP_S), float(place.max())
    if place.size <= reach or not deepest > 0.0:
        return {}
    speed, phase = (place[reach:] - place[:-reach]) / SPEED_OVER_S, find_key_phases(place, STEP_S)
    every = _select_notes(place, find_key_strikes(place, phase))
    down = find_runs(place > DOWN * deepest)
    out: dict[str, Any] = {"speed": float(speed.max()), "depth": deepest,
                           "hold": float((down[:, 1] - down[:, 0]).max()) * STEP_S}  # fmt: skip
    names = ["strike"] if every else []
    if np.any(phase == RELEASE):
        out["release"] = float(-speed.min())
        names.append("release")
    if len(every) > 1:
        out["rate"] = (len(every) - 1) / ((every[-1][0] - every[0][0]) * STEP_S)
        lowest = [place[end : start + 1].min() for (_, end), (start, _) in zip(every, every[1:], strict=False)]
        out["return"] = max(float(min(lowest)) / deepest, 0.0)
        names.append(REPEATED)
    if force_n is not None:
        out["force"] = float(np.nanmax(force_n))
    return {name: float(f"{value:.5g}") for name, value in out.items()} | {"phases": names, "unit": unit}


def _select_notes(key_depth: Array, strikes: Sequence[tuple[int, int]]) -> list[tuple[int, int]]:
    """Strikes, (first sample, end) each, that count as notes: one before which the key did not come up below half of
    its largest ``key_depth`` (n,) is joined to the one before."""
    out = list(strikes[:1])
    for start, end in strikes[1:]:
        if key_depth[out[-1][1] : start + 1].min() < AGAIN * key_depth.max():
            out.append((start, end))
        else:
            out[-1] = (out[-1][0], end)
    return out


@dataclass(frozen=True)
class DomainPosition:
    """Position of a stroke in the training domain: distance (infinite for a new phase), and the reason as text.

    ``out`` has the way out of each property's range, in units of its widening, negative inside.
    """

    distance: float
    why: str
    out: Mapping[str, float]

    @property
    def outside(self) -> bool:
        """Whether it lies beyond what was fitted."""
        return self.distance > 1.0


def locate_stroke(stroke: Features, fitted: Sequence[Features]) -> DomainPosition | None:
    """Position of a stroke, as of `extract_features`, in the domain of the ``fitted`` strokes: distance (above 1
    outside, infinite for a new phase), reason, ways out; None where it or every fitted stroke of its unit lacks
    properties."""
    fitted = [one for one in fitted if one and one["unit"] == stroke.get("unit")]
    if not stroke or not fitted:
        return None
    seen = {name for one in fitted for name in one["phases"]}
    new = [name for name in stroke["phases"] if name not in seen]
    if new:
        return DomainPosition(math.inf, f"{', '.join(new)}: no fitted stroke has it", {})
    out, words = {}, {}
    for name, (meaning, unit, width) in FEATURES.items():
        values = [_scale(name, one[name]) for one in fitted if name in one]
        if name not in stroke or not values:
            continue
        x, low, high = _scale(name, stroke[name]), min(values), max(values)
        out[name] = max(low - x, x - high) / width
        end = min if x < low else max
        beside = end(float(one[name]) for one in fitted if name in one)
        words[name] = (
            f"{meaning} {stroke[name]:.3g}, fitted {'from' if x < low else 'up to'} {beside:.3g} "
            f"{unit.format(stroke['unit'])}"
        )
    worst = max(out, key=lambda name: out[name])
    return DomainPosition(max(out[worst], 0.0), words[worst] if out[worst] > 0.0 else "", out)


def _scale(name: str, value: float) -> float:
    if name in LOGARITHMIC:
        return math.log(max(value, 1e-12))
    return value / (value + BRIEF_S) if name == "hold" else value


def describe_domain(action: str, places: pd.DataFrame, known: bool, lost: Collection[int] = ()) -> list[str]:
    """Sentences on which trials that were not fitted lie inside or outside of the training domain; ``places``: a row a
    trial, as of `_locate_trials`, ``known``: whether the action has its strokes, ``lost``: trials nearer to a rival,
    not called inside."""
    if not known:
        return [
            f"Domain: not known, {action} does not say what the strokes it was fitted to were like; identify it again."
        ]
    held = places[~places["fitted"]]
    outside, inside = held[held["outside"].eq(True)], held[held["outside"].eq(False) & ~held["trial"].isin(list(lost))]
    lines = []
    if len(outside):
        parts = [
            f"{row.trial} ({row.why_outside}{f'; distance {row.distance:.1f}' if np.isfinite(row.distance) else ''})"
            for row in outside.itertuples()
        ]
        lines.append(
            f"Domain: {trials_in_words(parts, MOST_NAMED)}: outside of what was fitted, where nothing says how well "
            "the model does."
        )
    if len(inside):
        lines.append(
            f"Domain: {trials_in_words(inside['trial'], MOST_NAMED)}: inside of what was fitted (distance at most "
            f"{inside['distance'].max():.1f}, 1 is the limit)."
        )
    return lines
