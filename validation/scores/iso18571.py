"""ISO/TS 18571-style score of a predicted against a measured curve: corridor, phase, magnitude, slope, overall.

"Style", because the specification is meant for forces, moments and accelerations of vehicle safety; rotations are
outside its scope.
Conventions: test T is the measurement, CAE C the prediction; scores from 0 to 1; angles must be changes since rest,
because an offset common to both curves raises corridor and magnitude; the shift is in samples of C against T.
Source: constants and rules of ISO/TS 18571:2024 as in public implementations; R = 0.4 Z + 0.2 (EP + EM + ES).
Ties of the warping path are broken up, left, diagonal; on signals with flat stretches scores are good to 1e-3 only.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from validation.conventions import Array

# constants of the specification
INNER, OUTER, CORRIDOR_POWER = 0.05, 0.5, 2
LARGEST_SHIFT = 0.2
LARGEST_MAGNITUDE_ERROR = 0.5
LARGEST_SLOPE_ERROR = 2.0
WARP_WINDOW = 0.1
WEIGHTS = (0.4, 0.2, 0.2, 0.2)
FEWEST_SAMPLES = 9


@dataclass(frozen=True)
class IsoScore:
    """Scores from 0 to 1; ``shift_samples`` > 0 when the prediction is late."""

    corridor: float
    phase: float
    magnitude: float
    slope: float
    overall: float
    shift_samples: int


def iso_score(test: Array, cae: Array, step_s: float) -> IsoScore:
    """ISO/TS 18571 ratings, 0 to 1 (1 is best), and shift in samples (positive: late) of a predicted curve ``cae``
    against the measured ``test``, each (n,), n ≥ 9, sampled every ``step_s`` s; raises ValueError where one is shorter
    or not finite."""
    t, c = np.ascontiguousarray(test, dtype=float), np.ascontiguousarray(cae, dtype=float)
    if t.ndim != 1 or t.shape != c.shape or t.size < FEWEST_SAMPLES:
        raise ValueError(
            f"curves have shapes {t.shape} and {c.shape}; two equal rows of at least {FEWEST_SAMPLES} are needed"
        )
    if not (np.isfinite(t).all() and np.isfinite(c).all()):
        raise ValueError("curves hold values that are not finite; cut the window to where both are known")
    z = corridor_score(t, c)
    shift = find_best_shift(t, c)
    n, m = t.size, abs(shift)
    reach = LARGEST_SHIFT * n
    ep = 1.0 if m == 0 else max((reach - m) / reach, 0.0)
    ts, cs = (t, c) if m == 0 else ((t[:-m], c[m:]) if shift > 0 else (t[m:], c[:-m]))
    em = _linear(_magnitude_error(ts, cs), LARGEST_MAGNITUDE_ERROR)
    es = _linear(_slope_error(ts, cs, step_s), LARGEST_SLOPE_ERROR)
    overall = float(np.dot(WEIGHTS, (z, ep, em, es)))
    return IsoScore(z, ep, em, es, overall, shift)


def corridor_score(t: Array, c: Array) -> float:
    """Mean corridor rating, 0 to 1, of a prediction ``c`` (n,) against the test ``t`` (n,): 1 where they differ by less
    than 5 % of the largest magnitude of ``t``, 0 beyond 50 %, quadratic between."""
    top = float(np.abs(t).max())
    inner, outer = INNER * top, OUTER * top
    error = np.abs(t - c)
    if top == 0.0:
        return float(np.mean(error == 0))
    between = ((outer - error) / (outer - inner)) ** CORRIDOR_POWER
    return float(np.mean(np.where(error < inner, 1.0, np.where(error > outer, 0.0, between))))


def _linear(error: float, largest: float) -> float:
    return max(0.0, (largest - error) / largest)


TIE = 1e-12
"""Correlations that differ by less are equal: rounding leaves 1e-15."""


def find_best_shift(t: Array, c: Array) -> int:
    """Shift of highest correlation of a prediction ``c`` (n,) with the test ``t`` (n,), in samples, a fifth of n at
    most, positive when ``c`` is later; of equal ones the smallest.

    Of equal ones a late shift comes before an early one. All correlations come from one Fourier transform, those that
    may be the highest then from the samples themselves.
    """
    shifts = np.arange(1, int(LARGEST_SHIFT * t.size) + 1)
    shifts = np.concatenate([[0], np.column_stack([shifts, -shifts]).ravel()])
    t, c = t - t.mean(), c - c.mean()
    late, early = np.maximum(shifts, 0), np.maximum(-shifts, 0)  # first samples of the parts of c and t
    count = t.size - np.abs(shifts)
    sums, spreads = [], []
    for x, first in ((t, early), (c, late)):
        total, squares = (np.concatenate([[0.0], np.cumsum(y)]) for y in (x, x * x))
        part = total[first + count] - total[first]
        sums.append(part)
        spreads.append((squares[first + count] - squares[first] - part * part / count) / (squares[-1] or 1.0))
    size = 1 << int(2 * t.size - 1).bit_length()
    products = np.fft.irfft(np.conj(np.fft.rfft(t, size)) * np.fft.rfft(c, size), size)[shifts]
    known = (spreads[0] > STILL) & (spreads[1] > STILL)
    scale = math.sqrt(float(t @ t) * float(c @ c) or 1.0) * np.sqrt(np.where(known, spreads[0] * spreads[1], 1.0))
    still = [
        float(np.array_equal(t[i : i + k], c[j : j + k]))
        for i, j, k in zip(early[~known], late[~known], count[~known], strict=True)
    ]
    r = np.empty(shifts.size)
    r[known] = ((products - sums[0] * sums[1] / count) / scale)[known]
    r[~known] = still
    wrong = np.where(known, FOURIER_ERROR * scale.max() / scale, 0.0)
    for k in np.flatnonzero((r + wrong >= (r - wrong).max()) & known):
        a, b = t[early[k] : early[k] + count[k]], c[late[k] : late[k] + count[k]]
        r[k] = (a @ b - sums[0][k] * sums[1][k] / count[k]) / scale[k]
    return int(shifts[np.argmax(r >= r.max() - TIE)])


STILL = 1e-13  # share of a curve's spread: a part with less does not move
FOURIER_ERROR = 1e-11
"""Error of a correlation by Fourier transform: some 1e-15 of the largest product, with room."""


def _slope_error(t: Array, c: Array, step_s: float) -> float:
    slopes = [_moving_average(np.gradient(x, step_s)) for x in (t, c)]
    return _ratio(float(np.abs(slopes[1] - slopes[0]).sum()), float(np.abs(slopes[0]).sum()))


def _ratio(difference: float, size: float) -> float:
    if size == 0.0:
        return 0.0 if difference == 0.0 else math.inf
    return difference / size


def _moving_average(x: Array) -> Array:
    """Nine-point mean, over one, three, five and seven points at the four samples next to either end."""
    total = np.concatenate([[0.0], np.cumsum(x)])
    i = np.arange(x.size)
    half = np.minimum(np.minimum(i, x.size - 1 - i), 4)
    return (total[i + half + 1] - total[i - half]) / (2 * half + 1)


def _magnitude_error(t: Array, c: Array) -> float:
    window = max(math.ceil(WARP_WINDOW * t.size) - 1, 0)
    c, t = (np.require(x, dtype=float, requirements=["C", "W"]) for x in (c, t))  # another kind is compiled anew
    difference, size = _warp(c, t, window)
    return _ratio(float(difference), float(size))


@njit(cache=True, nogil=True)
def _warp(a: Array, b: Array, window: int) -> tuple[float, float]:
    """Sums of |a − b| and of |b| along the warping path of least squared distance between ``a`` and ``b`` (n,), which
    deviates by ``window`` samples at most (dynamic time warping, equal steps).

    Cells are visited by diagonals i + j = s: those of one diagonal do not depend on each other, so that the compiler
    can take several at once. Costs are stored by i + 1. Cells that cost more than the path without warping lie on no
    cheapest path: they are left out, and whatever is left out has an infinite cost (Silva and Batista 2016, SIAM SDM).
    """
    n = a.size
    backwards = b[::-1].copy()
    # 0 up, 1 left, 2 diagonal, one diagonal behind the other: memory that no cell needs is never touched
    came_from = np.empty((2 * n - 1) * (window + 2), dtype=np.int8)
    first, start = np.zeros(2 * n - 1, dtype=np.int64), np.zeros(2 * n, dtype=np.int64)
    now, last, before = np.full(n + 2, np.inf), np.full(n + 2, np.inf), np.full(n + 2, np.inf)
    most = 0.0
    for k in range(n):
        most += (a[k] - b[k]) ** 2
    most *= 1.0 + 1e-9  # rounding
    now_low, now_high, last_low, last_high, before_low, before_high = n, -1, n, -1, -1, -1
    for s in range(2 * n - 1):
        now[now_low + 1 : now_high + 2] = np.inf
        low = max(0, s - n + 1, (s - window + 1) // 2, min(last_low, before_low + 1))
        high = min(n - 1, s, (s + window) // 2, max(last_high, before_high) + 1)
        first[s] = low
        cells = max(high - low + 1, 0)
        start[s + 1] = start[s] + cells
        origin = came_from[start[s] : start[s + 1]]
        cost = now[low + 1 : low + 1 + cells]
        up, left, diagonal = last[low : low + cells], last[low + 1 : low + 1 + cells], before[low : low + cells]
        row, column = a[low : low + cells], backwards[n - 1 - s + low : n - 1 - s + low + cells]
        for k in range(cells):
            d = row[k] - column[k]
            straight = min(up[k], left[k])
            origin[k] = 2 if diagonal[k] < straight else (1 if left[k] < up[k] else 0)
            cost[k] = min(straight, diagonal[k]) + d * d
        if s == 0:
            now[1] = (a[0] - b[0]) ** 2
        while low <= high and now[low + 1] > most:
            now[low + 1] = np.inf
            low += 1
        while high >= low and now[high + 1] > most:
            now[high + 1] = np.inf
            high -= 1
        if low > high:
            low, high = n, -1
        now_low, now_high, last_low, last_high, before_low, before_high = (
            before_low, before_high, low, high, last_low, last_high,
        )  # fmt: skip
        now, last, before = before, now, last
    i, j = n - 1, n - 1
    difference, size = abs(a[i] - b[j]), abs(b[j])
    while i > 0 or j > 0:
        step = came_from[start[i + j] + i - first[i + j]]
        if step != 1:
            i -= 1
        if step != 0:
            j -= 1
        difference += abs(a[i] - b[j])
        size += abs(b[j])
    return difference, size
