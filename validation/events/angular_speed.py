"""Angular speeds of the encoders' curves, differentiated on each side of a contact and never across it.

Conventions: rad/s, positive counter-clockwise, on the DAQ's sample times; NaN where fewer than five samples lie
between two contacts.
Source: a cubic fitted to 21 samples (Savitzky–Golay; shorter where a stretch is shorter), one-sided towards its ends.
A symmetric window across a string contact is wrong by tens of per cent. The standard uncertainty holds the samples'
own, propagated through the fit at each place, and the change of the speed when the window is halved: a measure of what
the cubic leaves out. Where speeds change faster than a few samples it is large, and says so.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pandas as pd
from scipy.ndimage import maximum_filter1d

from validation.cache.result_store import ResultStore
from validation.conventions import ENCODER_CHANNELS, Array
from validation.events.definitions import Event
from validation.events.level_crossings import up_crossings
from validation.measurement.trial import MeasuredTrial

STEP = "speeds"
WINDOW = 21
FEWEST = 5
ORDER = 3
NEIGHBOURS = 5
# events at which a body is struck or stopped, beside the hammer's leaving the string
CONTACTS = {
    "key": ("key_bottom",),
    "whippen": ("key_bottom", "string_impact"),
    "hammer": ("string_impact", "second_strike", "check_time", "landing"),
}
LEAVES_S = 6e-3


def contact_times(m: MeasuredTrial, events: dict[str, Event], channel: str) -> list[float]:
    """Times at which the speed of a channel may jump, s, increasing."""
    times = [events[name].value for name in CONTACTS[channel] if np.isfinite(events[name].value)]
    if channel == "hammer":
        leaves = up_crossings(m.time_s, m.motion.hammer_height_m, 0.0)
        struck = [events[name].value for name in ("string_impact", "second_strike")]
        times += [t for t in leaves if any(0 < t - at < LEAVES_S for at in struck)]
    return sorted(times)


@cache
def _fit(window: int) -> Array:
    """Row i gives the slope at sample i of a cubic through `window` samples, per sample, (window, window)."""
    at = np.linspace(-1.0, 1.0, window)
    order = min(ORDER, window - 2)
    design = np.vander(at, order + 1, increasing=True)
    slope = np.column_stack([k * at ** max(k - 1, 0) for k in range(order + 1)])
    return np.asarray(slope @ np.linalg.pinv(design) * 2 / (window - 1))


def _smooth(values: Array, window: int) -> tuple[Array, Array]:
    """Slope per sample of one stretch, and the factor by which the samples' noise enters it."""
    weights, half = _fit(window), window // 2
    gain = np.linalg.norm(weights, axis=1)
    slope, factor = np.empty(values.size), np.full(values.size, gain[half])
    slope[half : values.size - half] = np.convolve(values, weights[half][::-1], mode="valid")
    slope[:half], factor[:half] = weights[:half] @ values[:window], gain[:half]
    slope[values.size - half :], factor[values.size - half :] = weights[half + 1 :] @ values[-window:], gain[half + 1 :]
    return slope, factor


def split_speed(time_s: Array, angle_rad: Array, contact_s: list[float], u_sample_rad: float) -> tuple[Array, Array]:
    """Speed and its standard uncertainty, rad/s, from samples on the same side of every contact.

    Parameters
    ----------
    time_s, angle_rad : (n,) arrays
        Uniform.
    contact_s : list of float
    u_sample_rad : float
        Standard uncertainty of one sample against its neighbours.
    """
    speed, u = np.full(time_s.size, np.nan), np.full(time_s.size, np.nan)
    step = float(np.median(np.diff(time_s)))
    edges = np.searchsorted(time_s, contact_s)
    for first, last in zip([0, *edges], [*edges, time_s.size], strict=True):
        n = int(last - first)
        if n < FEWEST:
            continue
        part = angle_rad[first:last]
        wide = min(WINDOW, n - 1 + n % 2)
        slope, factor = _smooth(part, wide)
        bend = np.abs(slope - _smooth(part, max((wide // 2) | 1, FEWEST))[0])
        if wide < WINDOW:  # a contact: all of it is one bend
            bend = np.maximum(bend, np.abs(slope - np.gradient(part)))
        speed[first:last] = slope / step
        # where the two agree by chance, their neighbours decide
        u[first:last] = np.hypot(factor * u_sample_rad, maximum_filter1d(bend, NEIGHBOURS)) / step
    return speed, u


def speed_table(m: MeasuredTrial, events: dict[str, Event]) -> pd.DataFrame:
    """Speeds of key, whippen and hammer with their uncertainty: ``<channel>_rad_per_s``, ``<channel>_u_rad_per_s``."""
    columns = {"time_s": m.time_s}
    for i, name in enumerate(ENCODER_CHANNELS):
        speed, u = split_speed(m.time_s, m.change_rad[:, i], contact_times(m, events, name), float(m.u_rad[i]))
        columns[f"{name}_rad_per_s"] = speed
        columns[f"{name}_u_rad_per_s"] = np.hypot(u, m.scale_relative_u[i] * speed)
    return pd.DataFrame(columns)


def store_speeds(store: ResultStore, m: MeasuredTrial, table: pd.DataFrame) -> str:
    """Write the derived step ``speeds`` of one trial; the reason why it could not be written, or an empty text."""
    attributes = {"window": WINDOW, "order": ORDER, "unit": "rad/s"}
    failure = store.write_table(STEP, m.number, m.seal, table, attributes, versioned=False)
    return f"speeds not kept: {failure}" if failure else ""
