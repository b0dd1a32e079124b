"""Guards of the ISO-style score: traps of the algorithm, each measured on the pair by scoring a changed copy of it.

Conventions: curves are the test (trial) and the prediction on one uniform time base; NaN is left out.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from validation.conventions import Array
from validation.scores.iso18571 import FEWEST_SAMPLES, LARGEST_SHIFT, iso_score

MATTERS = 0.01  # of an overall score from 0 to 1: the last digit that a table shows
QUIET_SHARE = 0.01  # of the test's range: above noise and rounding of an encoder, below any motion that counts
# choices: shares of the window and of the range below which the pair is not scored a second time
MOST_QUIET, OFFSET_SHARE = 0.25, 0.05
FALLS = 1e-3  # of a correlation, so that noise makes no peak


def list_guard_notes(time: Array, trial: Array, model: Array, scores: Mapping[str, float]) -> list[str]:
    """Sentences on what makes an ISO-style score doubtful (common offset, quiet ends, period, a trial that does not
    move), in a list; ``trial``, ``model``: (n,) rad, ``scores``: as of `compute_scores`. Empty where nothing does or
    there is no score.

    - *offset*: an offset common to both curves widens the corridor and raises the magnitude score;
    - *window*: quiet samples before or after the motion raise every average, and the phase score counts shifts against
      the whole window;
    - *periodicity*: on a periodic curve the highest correlation may lie a whole period away, so that a small delay is
      charged as a large one; also when the highest correlation lies at the end of the search.
    """
    both = np.isfinite(trial) & np.isfinite(model)
    t, c = np.asarray(trial, dtype=float)[both], np.asarray(model, dtype=float)[both]
    if t.size < FEWEST_SAMPLES or not np.isfinite(scores.get("iso_overall", np.nan)):
        return []
    step = float(np.median(np.diff(time)))
    extent = float(np.ptp(t))
    if extent == 0.0:
        return ["constant: the trial does not move, so phase and slope have no meaning"]
    notes = []
    for words, begin, end, zero in (_find_offset(t, extent), _find_quiet_ends(t, c, extent)):
        if words:
            without = iso_score(t[begin:end] - zero, c[begin:end] - zero, step).overall
            if abs(without - scores["iso_overall"]) >= MATTERS:
                notes.append(f"{words} the overall score is {without:.3f}")
    periodicity = _describe_periodicity(t, c, step, scores["iso_shift_s"])
    return [*notes, periodicity] if periodicity else notes


def _find_offset(t: Array, extent: float) -> tuple[str, int, int, float]:
    """Note that curves stand on an offset (else empty), and the range of samples and zero (rad) to score again."""
    zero = float(t[0])
    words = f"offset: both curves stand on {zero:.3g} rad; zeroed at the start"
    lifted = float(np.abs(t).max()) - extent > OFFSET_SHARE * extent
    return words if lifted else "", 0, t.size, zero


def _find_quiet_ends(t: Array, c: Array, extent: float) -> tuple[str, int, int, float]:
    """Note that test ``t`` and prediction ``c`` (n,) are quiet at the ends of the window for over a quarter of it (else
    empty), first sample and end of the rest, and zero, rad, to score it again with; ``extent``: range of ``t``."""
    band = QUIET_SHARE * extent
    begin, end = _find_still(t, c, band), t.size - _find_still(t[::-1], c[::-1], band)
    quiet = 1 - max(end - begin, 0) / t.size
    words = f"window: {100 * quiet:.0f} % of it is quiet; without that"
    return words if quiet > MOST_QUIET and end - begin >= FEWEST_SAMPLES else "", begin, end, 0.0


def _find_still(t: Array, c: Array, band: float) -> int:
    moved = np.flatnonzero((np.abs(t - t[0]) > band) | (np.abs(c - c[0]) > band))
    return int(moved[0]) if moved.size else t.size


def _describe_periodicity(t: Array, c: Array, step: float, shift_s: float) -> str:
    """Note that the correlation of test ``t`` and prediction ``c`` (n,) has a peak nearer than the shift ``shift_s``,
    s, of the best one, or that this lies at the end of the search; else empty. ``step``: between samples, s."""
    shift = round(shift_s / step)
    if shift == 0:
        return ""
    if abs(shift) >= int(LARGEST_SHIFT * t.size) - 1:  # the shift was rounded
        return f"periodicity: the shift of {1e3 * shift_s:.2f} ms lies at the end of the search; it may be larger still"
    nearest = _climb_to_peak(t, c)
    if abs(shift) <= 1.5 * abs(nearest) + 2:
        return ""
    return (
        f"periodicity: the curves fit best {1e3 * shift_s:.2f} ms apart, but also {1e3 * nearest * step:.2f} ms apart; "
        "the phase score may count a wrong period"
    )


def _climb_to_peak(t: Array, c: Array) -> int:
    """Shift, in samples, of the first peak reached by climbing the correlation of test ``t`` and prediction ``c`` (n,)
    from no shift; positive when ``c`` is late."""

    def correlation(m: int) -> float:
        a, b = (t[: t.size - m], c[m:]) if m >= 0 else (t[-m:], c[:m])
        return float(np.corrcoef(a, b)[0, 1]) if np.ptp(a) > 0 and np.ptp(b) > 0 else 0.0

    side = 1 if correlation(1) >= correlation(-1) else -1
    best, at = correlation(0), 0
    for m in range(1, int(LARGEST_SHIFT * t.size) + 1):
        r = correlation(side * m)
        if r < best - FALLS:
            break
        if r > best:
            best, at = r, m
    return side * at
