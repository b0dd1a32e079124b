"""What the page's scripts know of a session: every trial's curves, thinned, with marks and words.

Conventions: degrees with the thesis's signs and N; all curves at the same, unevenly spaced times; a curve is base 64
(the alphabet for addresses, without slashes) of 16-bit integers (little-endian) times its channel's scale, `LOST` where
there is no value. All of a session's curves together take about `LARGEST_BYTES` at most, so that a page of many trials
stays small; its files have every sample.
"""

from __future__ import annotations

import base64
import json
from typing import Any

import numpy as np

from validation.conventions import ENCODER_CHANNELS, Array
from validation.curves.signs import degrees
from validation.curves.table import force_on_base
from validation.curves.thinning import uneven_samples
from validation.curves.time_base import on_base
from validation.report.figures.overlays import limit_of_trial, trial_words
from validation.report.view import SessionView

LARGEST_BYTES = 1_200_000
BYTES_PER_VALUE = 8 / 3
FEWEST_SAMPLES, MOST_SAMPLES = 150, 1000
LOST, LARGEST = -32768, 32767


def page_data(view: SessionView) -> str:
    """JSON of a session's curves for the page."""
    first, base = view.first, view.first.base_s
    trials = list(first.traces)
    per_sample = len(trials) * (1 + len(ENCODER_CHANNELS) * (1 + len(view.results)))
    n = int(np.clip(LARGEST_BYTES / BYTES_PER_VALUE / per_sample, FEWEST_SAMPLES, MOST_SAMPLES))
    shown = first.traces[view.shown_trial()]
    leading = [on_base(base, shown["time_s"].to_numpy(), shown[f"{c}_measured_rad"]) for c in ENCODER_CHANNELS]
    at = base[uneven_samples(base, np.column_stack([*leading, force_on_base(base, shown)]), n)]
    channels: dict[str, Any] = {"force": {"m": [force_on_base(at, frame) for frame in first.traces.values()], "p": []}}
    for channel in ENCODER_CHANNELS:
        measured = [_rotation(frame, channel, "measured", at) for frame in first.traces.values()]
        predicted = [
            [_rotation(r.traces[t], channel, "predicted", at) if t in r.traces else np.full(at.size, np.nan)
             for t in trials]
            for r in view.results
        ]  # fmt: skip
        channels[channel] = {"m": measured, "p": predicted, "limit": [limit_of_trial(first, channel, at)]}
    content = {
        "t": base64.urlsafe_b64encode(np.asarray(at, dtype="<f8").tobytes()).decode("ascii"),
        "trials": trials,
        "shown": view.shown_trial(),
        "models": view.names,
        "channels": {name: _packed(curves) for name, curves in channels.items()},
        "marks": {t: [[m.label, round(m.time_s, 6), m.meaning] for m in first.marks(t)] for t in trials},
        "words": {c: {t: trial_words(view, c, t) for t in trials} for c in ENCODER_CHANNELS},
    }
    return json.dumps(content, separators=(",", ":"), ensure_ascii=False)


def _rotation(frame: Any, channel: str, kind: str, at: Array) -> Array:
    return degrees(channel, on_base(at, frame["time_s"].to_numpy(), frame[f"{channel}_{kind}_rad"].to_numpy()))


def _packed(curves: dict[str, Any]) -> dict[str, Any]:
    """Curves of one channel as text, with their common scale."""
    every = np.concatenate([np.ravel(np.asarray(part, dtype=float)) for part in curves.values() if len(part)])
    known = np.abs(every[np.isfinite(every)])
    scale = float(known.max()) / LARGEST if known.size and known.max() > 0 else 1.0

    def text(values: Any) -> str:
        whole = np.asarray(values, dtype=float)
        steps = np.where(np.isfinite(whole), np.round(np.nan_to_num(whole) / scale), LOST)
        return base64.urlsafe_b64encode(steps.astype("<i2").tobytes()).decode("ascii")

    out: dict[str, Any] = {"scale": scale, "m": text(curves["m"]), "p": [text(part) for part in curves["p"]]}
    if "limit" in curves and np.isfinite(curves["limit"]).any():
        out["limit"] = text(curves["limit"])
    return out
