"""Guards of the ISO-style score: what could make it look better or worse than it is. They flag, they never alter.

Conventions: curves are the test (trial) and the prediction on one uniform time base; NaN is left out.
Source: traps of the algorithm, each measured on the pair at hand by scoring a changed copy of it:

- *offset*: an offset common to both curves widens the corridor and raises the magnitude score;
- *window*: quiet samples before or after the motion raise every average, and the phase score counts shifts against
  the whole window;
- *periodicity*: on a periodic curve the highest correlation may lie a whole period away, so that a small delay is
  charged as a large one; also when the highest correlation lies at the end of the search.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from validation.conventions import Array
from validation.scores.iso18571 import FEWEST_SAMPLES, iso_score

MATTERS = 0.01  # of an overall score from 0 to 1
QUIET_SHARE = 0.01  # of the test's range
MOST_QUIET = 0.25  # of the window
OFFSET_SHARE = 0.05  # of the test's range
LARGEST_SHIFT_SHARE = 0.19  # the search ends at 0.2
FALLS = 1e-3  # of a correlation, so that noise makes no peak


def guard_notes(time: Array, trial: Array, model: Array, scores: Mapping[str, float]) -> list[str]:
    """Guards raised by a pair of curves and its ISO-style score.

    Parameters
    ----------
    time, trial, model : (n,) arrays
    scores : mapping
        With ``iso_overall``, ``iso_phase`` and ``iso_shift_s`` of these curves.

    Returns
    -------
    list of str
        One line per guard, with the numbers.
    """
    both = np.isfinite(trial) & np.isfinite(model)
    t, c = np.asarray(trial, dtype=float)[both], np.asarray(model, dtype=float)[both]
    if t.size < FEWEST_SAMPLES or not np.isfinite(scores.get("iso_overall", np.nan)):
        return []
    step = float(np.median(np.diff(time)))
    extent = float(np.ptp(t))
    if extent == 0.0:
        return ["constant: the trial does not move, so phase and slope have no meaning"]
    notes = [
        _offset(t, c, step, extent, scores["iso_overall"]),
        _window(t, c, step, extent, scores["iso_overall"]),
        _periodicity(t, c, step, scores["iso_shift_s"]),
    ]
    return [note for note in notes if note]


def _offset(t: Array, c: Array, step: float, extent: float, overall: float) -> str:
    """The largest magnitude of the test against its range tells whether it stands on an offset."""
    lift = float(np.abs(t).max()) - extent
    if lift <= OFFSET_SHARE * extent:
        return ""
    zero = float(t[0])
    without = iso_score(t - zero, c - zero, step).overall
    if abs(without - overall) < MATTERS:
        return ""
    return f"offset: both curves stand on {zero:.3g} rad; zeroed at the start the overall score is {without:.3f}"


def _window(t: Array, c: Array, step: float, extent: float, overall: float) -> str:
    """Quiet ends of the window: both curves where they begin, or where they end."""
    band = QUIET_SHARE * extent
    begin = _still(t, c, band)
    end = t.size - _still(t[::-1], c[::-1], band)
    quiet = 1 - max(end - begin, 0) / t.size
    if quiet <= MOST_QUIET or end - begin < FEWEST_SAMPLES:
        return ""
    without = iso_score(t[begin:end], c[begin:end], step).overall
    if abs(without - overall) < MATTERS:
        return ""
    return f"window: {100 * quiet:.0f} % of it is quiet; without that the overall score is {without:.3f}"


def _still(t: Array, c: Array, band: float) -> int:
    moved = np.flatnonzero((np.abs(t - t[0]) > band) | (np.abs(c - c[0]) > band))
    return int(moved[0]) if moved.size else t.size


def _periodicity(t: Array, c: Array, step: float, shift_s: float) -> str:
    """A correlation that falls and rises again between no shift and the shift found has more than one peak."""
    shift = round(shift_s / step)
    if shift == 0:
        return ""
    if abs(shift) >= LARGEST_SHIFT_SHARE * t.size:
        return f"periodicity: the shift of {1e3 * shift_s:.2f} ms lies at the end of the search; it may be larger still"
    nearest = _nearest_peak(t, c)
    if abs(shift) <= 1.5 * abs(nearest) + 2:
        return ""
    return (
        f"periodicity: the curves fit best {1e3 * shift_s:.2f} ms apart, but also {1e3 * nearest * step:.2f} ms apart; "
        "the phase score may count a wrong period"
    )


def _nearest_peak(t: Array, c: Array) -> int:
    """Shift at which one arrives by climbing the correlation from no shift, in samples; positive: c is late."""

    def correlation(m: int) -> float:
        a, b = (t[: t.size - m], c[m:]) if m >= 0 else (t[-m:], c[:m])
        return float(np.corrcoef(a, b)[0, 1]) if np.ptp(a) > 0 and np.ptp(b) > 0 else 0.0

    side = 1 if correlation(1) >= correlation(-1) else -1
    best, at = correlation(0), 0
    for m in range(1, int(0.2 * t.size) + 1):
        r = correlation(side * m)
        if r < best - FALLS:
            break
        if r > best:
            best, at = r, m
    return side * at
