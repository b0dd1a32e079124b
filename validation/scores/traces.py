"""Traces of each trial as tables: measured and predicted angles, forces, speeds.

Conventions: SI and rad; changes since rest; nothing is aligned; what cannot be stated is NaN. Speeds and the angles of
rivals are in single precision: they are shown and scored to three digits, and a session has hundreds of them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d

from validation.conventions import BODIES, ENCODER_CHANNELS, FILM_CHANNELS, Array
from validation.events.contact import REVERSAL_S
from validation.events.crossings import up_crossings
from validation.events.definitions import Event
from validation.events.key_lift import KeyLift, mark_lifted_samples
from validation.events.session_events import Window
from validation.measurement.trial import MeasuredTrial
from validation.prediction.predict_session import PredictedTrial

# of cubics through samples (Savitzky and Golay): choice; at 5 kHz 4 ms, near a contact as few as bend nothing
WINDOW, FEWEST, ORDER = 21, 5, 3
# events at which a body is struck or stopped, beside the hammer's leaving the string
CONTACTS = {
    "key": ("key_bottom",),
    "whippen": ("key_bottom", "string_impact"),
    "hammer": ("string_impact", "second_strike", "check_time", "landing"),
}


def find_contact_times(m: MeasuredTrial, events: dict[str, Event], channel: str) -> list[float]:
    """Times, s, increasing, at which the body of ``channel`` (key, whippen or hammer) is struck, stopped or leaves the
    string, so that its speed may jump; ``events``: the trial's, by name."""
    times = [events[name].value for name in CONTACTS[channel] if np.isfinite(events[name].value)]
    if channel == "hammer":
        leaves = up_crossings(m.time_s, m.motion.hammer_height_m, 0.0)
        struck = [events[name].value for name in ("string_impact", "second_strike")]
        times += [t for t in leaves if any(0 < t - at < REVERSAL_S for at in struck)]
    return sorted(times)


@cache
def _slope_weights(window: int) -> Array:
    """Row i gives the slope at sample i of a cubic through `window` samples, per sample, (window, window)."""
    at = np.linspace(-1.0, 1.0, window)
    order = min(ORDER, window - 2)
    design = np.vander(at, order + 1, increasing=True)
    slope = np.column_stack([k * at ** max(k - 1, 0) for k in range(order + 1)])
    return np.asarray(slope @ np.linalg.pinv(design) * 2 / (window - 1))


def _fit_slopes(values: Array, window: int) -> tuple[Array, Array]:
    """Slope (n,), per sample, of ``values`` (n,) by cubics fitted over ``window`` (odd, n at most) samples, one-sided
    at the ends, and the factor (n,) by which the noise of a sample enters it."""
    weights, half = _slope_weights(window), window // 2
    gain = np.linalg.norm(weights, axis=1)
    slope, factor = np.empty(values.size), np.full(values.size, gain[half])
    slope[half : values.size - half] = np.convolve(values, weights[half][::-1], mode="valid")
    slope[:half], factor[:half] = weights[:half] @ values[:window], gain[:half]
    slope[values.size - half :], factor[values.size - half :] = weights[half + 1 :] @ values[-window:], gain[half + 1 :]
    return slope, factor


def differentiate_between_contacts(
    time_s: Array, angle_rad: Array, contact_s: list[float], u_sample_rad: float
) -> tuple[Array, Array]:
    """Speed (n,), rad/s, of ``angle_rad`` (n,) and its standard uncertainty (n,), from samples on the same side of
    every contact at ``contact_s``, s, increasing; NaN where fewer than five lie between two.

    Conventions: rad/s, positive counter-clockwise, on the DAQ's sample times; NaN where fewer than five samples lie
    between two contacts. Source: a cubic fitted to 21 samples (Savitzky–Golay; shorter where a stretch is shorter),
    one-sided towards its ends. A symmetric window across a string contact is wrong by tens of per cent. The standard
    uncertainty holds the samples' own, propagated through the fit at each place, and the change of the speed when the
    window is halved: a measure of what the cubic leaves out. Where speeds change faster than a few samples it is large,
    and says so.

    Parameters
    ----------
    time_s, angle_rad : (n,), uniform
    u_sample_rad : standard uncertainty of one sample against its neighbours
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
        slope, factor = _fit_slopes(part, wide)
        bend = np.abs(slope - _fit_slopes(part, max((wide // 2) | 1, FEWEST))[0])
        if wide < WINDOW:  # a contact: all of it is one bend
            bend = np.maximum(bend, np.abs(slope - np.gradient(part)))
        speed[first:last] = slope / step
        # where the two agree by chance, their neighbours decide
        u[first:last] = np.hypot(factor * u_sample_rad, maximum_filter1d(bend, FEWEST)) / step
    return speed, u


def make_speed_table(m: MeasuredTrial, events: dict[str, Event]) -> pd.DataFrame:
    """Table of angular speeds of key, whippen and hammer at the trial's sample times: ``time_s`` and, for each,
    ``<channel>_rad_per_s`` and standard uncertainty ``<channel>_u_rad_per_s``; counter-clockwise is positive."""
    columns = {"time_s": m.time_s}
    for i, name in enumerate(ENCODER_CHANNELS):
        speed, u = differentiate_between_contacts(
            m.time_s, m.change_rad[:, i], find_contact_times(m, events, name), float(m.u_rad[i])
        )
        columns[f"{name}_rad_per_s"] = speed
        columns[f"{name}_u_rad_per_s"] = np.hypot(u, m.scale_relative_u[i] * speed)
    return pd.DataFrame(columns)


# how the columns of a rival begin
INFIX = {"null": "null", "raw_force": "raw"}


@dataclass(frozen=True)
class SessionTraces:
    """Traces of all trials on encoder and on film times, the window they are scored in, and their string impacts."""

    encoder: dict[int, pd.DataFrame]
    film: dict[int, pd.DataFrame]
    window: Window
    impact_s: Mapping[int, float]

    def select_source(self, source: str) -> dict[int, pd.DataFrame]:
        """Traces of a source, ``encoder`` or ``film``."""
        return self.encoder if source == "encoder" else self.film

    @property
    def base_s(self) -> Array:
        """Common time base: sample times of the first trial inside the window."""
        base = next(iter(self.encoder.values()))["time_s"].to_numpy()
        return np.asarray(base[self.window.mask(base)])


def make_trace_table(
    m: MeasuredTrial, p: PredictedTrial, lifts: Sequence[KeyLift], speeds: pd.DataFrame
) -> pd.DataFrame:
    """Table of one trial at the DAQ's sample times: raw and corrected force, measured, predicted and rivals' angles
    since rest, rad, ``speeds`` as of `make_speed_table`; samples inside ``lifts`` of the key are True in
    ``key_marked``."""
    columns: dict[str, NDArray[Any]] = {
        "time_s": m.time_s,
        "raw_force_n": m.raw_force_n,
        "force_time_s": m.force.time_s,
        "force_n": m.force.force_n,
        "u_force_n": m.force.u_force_n,
    }
    columns |= {f"{name}_measured_rad": m.change_rad[:, i] for i, name in enumerate(ENCODER_CHANNELS)}
    columns["key_marked"] = mark_lifted_samples(m.time_s, lifts)
    columns |= {f"{body}_predicted_rad": p.model.change_rad(body) for body in BODIES}
    for rival, q in p.rivals.items():
        columns |= {f"{body}_{INFIX[rival]}_rad": q.encoder[body] for body in ENCODER_CHANNELS}
    columns |= {str(name): speeds[name].to_numpy(np.float32) for name in speeds.columns if name != "time_s"}
    return pd.DataFrame(columns, copy=False)  # the arrays of trial and prediction themselves: of 200 trials 0.3 GB


def make_film_trace_table(m: MeasuredTrial, p: PredictedTrial) -> pd.DataFrame | None:
    """Table of one trial at the film's frame times: angles of jack and repetition lever relative to the whippen, their
    standard uncertainty, the predicted and the rivals' ones, rad since rest; None when not filmed."""
    if m.film is None:
        return None
    columns = {"time_s": m.film.time_s}
    for name in FILM_CHANNELS:
        predicted = p.model.change_at(name, m.film.time_s)
        # a frame clock that is off by u_time moves a turning body by its speed times that
        moved = np.nan_to_num(np.abs(np.gradient(predicted, m.film.time_s))) * m.film.u_time_s
        columns[f"{name}_measured_rad"] = m.film.change_rad[name]
        columns[f"{name}_u_rad"] = np.hypot(m.film.u_rad[name], moved)
        columns[f"{name}_predicted_rad"] = predicted
        for rival, q in p.rivals.items():
            columns[f"{name}_{INFIX[rival]}_rad"] = q.film[name]
    return pd.DataFrame(columns)


def select_scored_angles(frame: pd.DataFrame, channel: str) -> Array:
    """Measured angles of a channel, NaN where they are left out of the scores."""
    values = frame[f"{channel}_measured_rad"].to_numpy(dtype=float)
    flag = f"{channel}_marked"
    return np.where(frame[flag].to_numpy(dtype=bool), np.nan, values) if flag in frame else values
