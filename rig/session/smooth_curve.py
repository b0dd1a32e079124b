"""A smooth rising curve through points whose heights were read with errors, as smooth as the points themselves ask.

In: places on an axis, rising, and heights. Out: `SmoothCurve`. The curve is a cubic smoothing spline (Reinsch) over a
stretched axis; how far the axis is stretched and how smooth the spline is are those with the least error of the inner
points when each is left out. First and last point are kept: what lies beyond them is not known.

A curve through all points keeps their errors, and neighbours off by opposite amounts bend its slope by a fifth: a
speed read through it goes up and down at the same places in every stroke.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline, PchipInterpolator

Array = NDArray[np.float64]

STRETCHES = (1e-3, 3e-3, 1e-2, 3e-2, 0.1, 0.3, 1.0, 10.0)
"""The axis is stretched as log(x + c), x from 0 to 1: sensors of light and of magnetism fall off like that."""
STIFFNESSES = tuple(10.0 ** (0.5 * k) for k in range(-14, 1))
KEPT = 1e6
"""Weight of the first and last point."""
GRID = 513


@dataclass(frozen=True)
class SmoothCurve:
    """A fitted curve.

    Attributes
    ----------
    places, height : (p,) points, heights as fitted
    stretch : what the axis is stretched by; 0 for the monotone curve through all points, where no smooth one rises
    smoother : (p, p) heights as fitted are this matrix times heights as read
    scatter : standard deviation of a point's error, by leaving out each inner one
    """

    places: Array
    height: Array
    stretch: float
    smoother: Array
    scatter: float

    def value(self, x: Array) -> Array:
        """Heights at places, held at the ends."""
        held = np.clip(x, self.places[0], self.places[-1])
        return np.asarray(self._spline(self.height)(self._axis(held)))

    def slope(self, x: Array) -> Array:
        """Change of height per change of place, inside the ends."""
        held = np.clip(x, self.places[0], self.places[-1])
        return np.asarray(self._spline(self.height).derivative()(self._axis(held)) * self._stretching(held))

    def moved(self, away: Array, x: Array) -> Array:
        """Heights at places if the points had been read so much higher (p,)."""
        held = np.clip(x, self.places[0], self.places[-1])
        return np.asarray(self._spline(self.height + self.smoother @ away)(self._axis(held)))

    def _spline(self, height: Array) -> CubicSpline | PchipInterpolator:
        axis = self._axis(self.places)
        return CubicSpline(axis, height, bc_type="natural") if self.stretch else PchipInterpolator(axis, height)

    def _axis(self, x: Array) -> Array:
        share = (x - self.places[0]) / (self.places[-1] - self.places[0])
        return share if not self.stretch else _stretched(share, self.stretch)

    def _stretching(self, x: Array) -> Array:
        span = self.places[-1] - self.places[0]
        if not self.stretch:
            return np.full(x.shape, 1.0 / span)
        share = (x - self.places[0]) / span
        return 1.0 / (span * (share + self.stretch) * np.log1p(1.0 / self.stretch))


def fit_smooth(places: Array, height: Array) -> SmoothCurve:
    """Fit the smoothest rising curve that its points support.

    Parameters
    ----------
    places : ndarray, shape (p,)
        Rising; p from 4.
    height : ndarray, shape (p,)
        Rising or falling with the places.

    Returns
    -------
    SmoothCurve
    """
    share = (places - places[0]) / (places[-1] - places[0])
    sense = np.sign(height[-1] - height[0])
    best, least = None, np.inf
    for stretch in STRETCHES:
        axis = _stretched(share, stretch)
        for stiffness in STIFFNESSES:
            smoother = _smoother(axis, stiffness)
            error, gain = _left_out(smoother, height)
            if error >= least:
                continue
            fitted = smoother @ height
            rising = CubicSpline(axis, fitted, bc_type="natural").derivative()(np.linspace(0.0, 1.0, GRID))
            if np.all(sense * rising > 0.0):
                best, least = SmoothCurve(places, fitted, stretch, smoother, error / gain), error
    return best or _through_all(places, height)


def _through_all(places: Array, height: Array) -> SmoothCurve:
    errors = [
        float(PchipInterpolator(np.delete(places, i), np.delete(height, i))(places[i]) - height[i])
        for i in range(1, places.size - 1)
    ]
    scatter = float(np.sqrt(np.mean(np.square(errors)) / 1.5))  # of a point against the mean of its two neighbours
    return SmoothCurve(places, height, 0.0, np.eye(places.size), scatter)


def _stretched(share: Array, by: float) -> Array:
    """From 0 to 1 as ``share`` is."""
    return np.asarray(np.log1p(share / by) / np.log1p(1.0 / by))


def _smoother(axis: Array, stiffness: float) -> Array:
    """Matrix (p, p) of the natural cubic smoothing spline, ends kept (Green and Silverman 1994, Section 2.3)."""
    n, step = axis.size, np.diff(axis)
    second, inner = np.zeros((n, n - 2)), np.zeros((n - 2, n - 2))
    for j in range(n - 2):
        second[j : j + 3, j] = 1.0 / step[j], -1.0 / step[j] - 1.0 / step[j + 1], 1.0 / step[j + 1]
        inner[j, j] = (step[j] + step[j + 1]) / 3.0
        if j + 1 < n - 2:
            inner[j, j + 1] = inner[j + 1, j] = step[j + 1] / 6.0
    weight = np.ones(n)
    weight[[0, -1]] = KEPT
    rough = second @ np.linalg.solve(inner, second.T)
    smoother = np.linalg.solve(np.diag(weight) + stiffness * rough, np.diag(weight))
    smoother[0], smoother[-1] = np.eye(n)[0], np.eye(n)[-1]
    return np.asarray(smoother)


def _left_out(smoother: Array, height: Array) -> tuple[float, float]:
    """Root mean square error of the inner points when each is left out, and that of it which a point's error of one
    makes."""
    inner = slice(1, -1)
    own = 1.0 - np.diag(smoother)[inner]
    error = (height - smoother @ height)[inner] / own
    others = (smoother[inner] - np.eye(height.size)[inner] * np.diag(smoother)[inner, None]) / own[:, None]
    gain = 1.0 + np.sum(others[:, inner] ** 2, axis=1).mean()
    return float(np.sqrt(np.mean(error**2))), float(np.sqrt(gain))
