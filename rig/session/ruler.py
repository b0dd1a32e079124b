"""Displacement from a position sensor that is not linear: a monotone curve through points read on a ruler.

In: readings of a sensor and the calibration's points (`RulerInfo`). Out: the displacement of the calibrated point, m,
with its uncertainty and a flag for every sample (`Position`). Readings that go back by no more than their own
uncertainty are pooled with their neighbours first.

The curve is a cubic smoothing spline (Reinsch) over a stretched axis; how far the axis is stretched and how smooth the
spline is are those with the least error of the inner points when each is left out, which also tells how well the ruler
was read. First and last point are kept: what lies beyond them is not known. A curve through all points would keep their
errors, and neighbours off by opposite amounts bend its slope by a fifth: a speed read through it goes up and down at
the same places in every stroke.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline, PchipInterpolator
from scipy.optimize import isotonic_regression

from rig.errors import RigInputError
from rig.session.info import RulerInfo

Array = NDArray[np.float64]

STRETCHES = (1e-3, 3e-3, 1e-2, 3e-2, 0.1, 0.3, 1.0, 10.0)  # c of the axis log(x + c), x from 0 to 1
"""Sensors of light and of magnetism fall off like that; with 10 the axis is as good as straight."""
STIFFNESSES = tuple(np.logspace(-7.0, 0.0, 15).tolist())  # of the spline: through all points to a straight line
KEPT = 1e6  # weight of the first and last point against the others': they move by a millionth
GRID = 513  # places at which a curve is asked whether it rises: choice, many between two points


@dataclass(frozen=True)
class SmoothCurve:
    # places, height: (p,) points, heights as fitted
    places: Array
    height: Array
    # what the axis is stretched by; 0 for the monotone curve through all points, where no smooth one rises
    stretch: float
    smoother: Array  # (p, p) heights as fitted are this matrix times heights as read
    scatter: float  # standard deviation of a point's error, by leaving out each inner one

    def value(self, x: Array) -> Array:
        """Heights at places, held at the ends."""
        held = np.clip(x, self.places[0], self.places[-1])
        return np.asarray(self._spline(self.height)(self._axis(held)))

    def slope(self, x: Array) -> Array:
        """Change of height per change of place, inside the ends."""
        held = np.clip(x, self.places[0], self.places[-1])
        return np.asarray(self._spline(self.height).derivative()(self._axis(held)) * self._stretching(held))

    def shift_points(self, away: Array, x: Array) -> Array:
        """Heights at places if the points had been read so much higher (p,)."""
        held = np.clip(x, self.places[0], self.places[-1])
        return np.asarray(self._spline(self.height + self.smoother @ away)(self._axis(held)))

    def _spline(self, height: Array) -> CubicSpline | PchipInterpolator:
        axis = self._axis(self.places)
        return CubicSpline(axis, height, bc_type="natural") if self.stretch else PchipInterpolator(axis, height)

    def _axis(self, x: Array) -> Array:
        share = (x - self.places[0]) / (self.places[-1] - self.places[0])
        return share if not self.stretch else _stretch_axis(share, self.stretch)

    def _stretching(self, x: Array) -> Array:
        span = self.places[-1] - self.places[0]
        if not self.stretch:
            return np.full(x.shape, 1.0 / span)
        share = (x - self.places[0]) / span
        return 1.0 / (span * (share + self.stretch) * np.log1p(1.0 / self.stretch))


def fit_smooth(places: Array, height: Array) -> SmoothCurve:
    """Fit height, m, over a sensor's increasing readings ``places`` by a monotone smoothing spline whose stretch and
    stiffness predict left-out points best; through all points where none is monotone."""
    share = (places - places[0]) / (places[-1] - places[0])
    sense = np.sign(height[-1] - height[0])
    best, least = None, np.inf
    for stretch in STRETCHES:
        axis = _stretch_axis(share, stretch)
        for stiffness in STIFFNESSES:
            smoother = _smoother_matrix(axis, stiffness)
            error, gain = _leave_one_out_error(smoother, height)
            if error >= least:
                continue
            fitted = smoother @ height
            rising = CubicSpline(axis, fitted, bc_type="natural").derivative()(np.linspace(0.0, 1.0, GRID))
            if np.all(sense * rising > 0.0):
                best, least = SmoothCurve(places, fitted, stretch, smoother, error / gain), error
    return best or _monotone_interpolation(places, height)


def _monotone_interpolation(places: Array, height: Array) -> SmoothCurve:
    errors = [
        float(PchipInterpolator(np.delete(places, i), np.delete(height, i))(places[i]) - height[i])
        for i in range(1, places.size - 1)
    ]
    scatter = float(np.sqrt(np.mean(np.square(errors)) / 1.5))  # of a point against the mean of its two neighbours
    return SmoothCurve(places, height, 0.0, np.eye(places.size), scatter)


def _stretch_axis(share: Array, by: float) -> Array:
    return np.asarray(np.log1p(share / by) / np.log1p(1.0 / by))


def _smoother_matrix(axis: Array, stiffness: float) -> Array:
    """Matrix (p, p) that takes heights at the rising places ``axis`` (p,) to those of their natural cubic smoothing
    spline; ``stiffness`` 0: through all points; the first and last point are kept (Green and Silverman 1994, Section
    2.3)."""
    n, step = axis.size, np.diff(axis)
    second = np.diff(np.diff(np.eye(n)) / step)
    beside = np.diag(step[1:-1] / 6.0, 1)
    inner = np.diag((step[:-1] + step[1:]) / 3.0) + beside + beside.T
    weight = np.ones(n)
    weight[[0, -1]] = KEPT
    rough = second @ np.linalg.solve(inner, second.T)
    smoother = np.linalg.solve(np.diag(weight) + stiffness * rough, np.diag(weight))
    smoother[0], smoother[-1] = np.eye(n)[0], np.eye(n)[-1]
    return np.asarray(smoother)


def _leave_one_out_error(smoother: Array, height: Array) -> tuple[float, float]:
    """RMS of the errors with which a smoother (p, p) predicts each inner height from the others, m; and the same for
    independent errors of standard deviation one in the points, by which it is to be divided."""
    inner = slice(1, -1)
    free = 1.0 - np.diag(smoother)[inner]
    error = (height - smoother @ height)[inner] / free
    others = (smoother[inner] - np.eye(height.size)[inner] * np.diag(smoother)[inner, None]) / free[:, None]
    gain = 1.0 + np.sum(others[:, inner] ** 2, axis=1).mean()
    return float(np.sqrt(np.mean(error**2))), float(np.sqrt(gain))


BELOW, ABOVE = 1, 2
"""Flags: the reading lies below the first point of the ruler, or above the last, by more than its noise."""
SEED = 1
DRAWS = 64  # calibrations: their standard deviation is known to a tenth
CHOICE = 0.4  # of a point's u, for the choice of smoothness: six kinds of sensors are covered as stated (a test)
CLIP_NOISE = 3.0  # standard deviations of noise beyond the ruler's end, from which a reading is: 1 in 700 by chance
JUDGED_BAD = 2.0  # times their uncertainty, that points scatter where a ruler was read worse than stated
U_GRID = 257  # readings at which the uncertainty is drawn; denser where sensors are steep


@dataclass(frozen=True)
class RulerCurve(SmoothCurve):
    """A fitted calibration: places are readings, rising, near the points after pooling; heights displacements, m."""

    u_m: float  # standard uncertainty of a point, m: as stated, or as the points scatter where that is more
    stated_m: float  # standard uncertainty stated for a reading of the ruler, m

    @property
    def judgement(self) -> str:
        """One line: how well the points lie on a smooth monotone curve."""
        found = f"points scatter by {1e3 * self.scatter:.2f} mm, stated {1e3 * self.stated_m:.2f} mm"
        if self.scatter > JUDGED_BAD * self.stated_m:
            return f"{found}: the ruler was read worse than stated; {1e3 * self.u_m:.2f} mm is used"
        return f"{found}: as good as stated"

    def slope(self, x: Array) -> Array:
        """Displacement per reading, m, at readings inside the ruler; 0 beyond it."""
        inside = (x >= self.places[0]) & (x <= self.places[-1])
        return np.where(inside, np.abs(super().slope(x)), 0.0)

    def draw_calibration(self, random: np.random.Generator, reading: Array) -> Array:
        """Displacements (m) at readings by another calibration that the ruler's uncertainty allows."""
        return self.shift_points(self.u_m * random.standard_normal(self.places.size), reading)

    def draws(self, reading: Array, n: int = DRAWS) -> Array:
        """Displacements (n, m) by calibrations that the ruler's uncertainty allows, seeded."""
        random = np.random.default_rng(SEED)
        return np.array([self.draw_calibration(random, reading) for _ in range(n)])

    def u_at(self, reading: Array) -> Array:
        """Standard uncertainty (m) of the calibration at readings: common to all samples there, not noise."""
        return np.interp(reading, *self._u_grid)

    @cached_property
    def _u_grid(self) -> tuple[Array, Array]:
        """Readings and the standard uncertainty there: drawn once for a ruler, not for each trial."""
        grid = np.linspace(0.0, 1.0, U_GRID) ** 2 * (self.places[-1] - self.places[0]) + self.places[0]
        return grid, np.hypot(self.draws(grid).std(axis=0), CHOICE * self.u_m)


@dataclass(frozen=True, eq=False)
class Position:
    """Displacement of a named point of a body, measured."""

    name: str  # of the channel
    ruler: RulerInfo  # body, calibrated point and place of the sensor
    time_s: Array  # (n,)
    # (n,), of the calibrated point, m; where ``flag`` is set the end of the ruler, beyond which nothing is known
    displacement_m: Array
    # (n,), standard uncertainty of the calibration, m: the same error wherever the reading is the same
    u_calibration_m: Array
    u_noise_m: Array  # (n,), standard uncertainty of one sample's noise, m
    flag: NDArray[np.uint8]  # (n,), 0, `BELOW` or `ABOVE`
    judgement: str  # how well the ruler's points lie on a smooth curve

    @property
    def u_m(self) -> Array:
        """Standard uncertainty of a sample, m, shape (n,)."""
        return np.hypot(self.u_calibration_m, self.u_noise_m)

    @property
    def travel_m(self) -> float:
        return float(np.ptp(np.array(self.ruler.displacement_m)))


@lru_cache(maxsize=16)
def ruler_curve(ruler: RulerInfo, where: str = "ruler") -> RulerCurve:
    """Fit the monotone curve of displacement, m, over readings of a position sensor to its ruler points; RigInputError,
    which begins with ``where``, where they go back by more than their uncertainty, or fewer than four differ."""
    reading, displacement = np.array(ruler.reading), np.array(ruler.displacement_m)
    sense = 1.0 if reading[-1] > reading[0] else -1.0
    allowed = 2.0 * np.sqrt(2.0) * ruler.u_reading
    back = -sense * np.diff(reading)
    if back.max() > allowed:
        i = int(np.argmax(back))
        raise RigInputError(
            f"{where}: ruler points are not monotone: reading {reading[i + 1]:g} at {1e3 * displacement[i + 1]:.3f} mm "
            f"after {reading[i]:g} at {1e3 * displacement[i]:.3f} mm goes back by {back[i]:.3g}, allowed {allowed:.3g} "
            "(from u_reading); read these points again, or leave them out"
        )
    reading, displacement = _pool_neighbours(sense * reading, displacement)
    if reading.size < 4:
        raise RigInputError(f"{where}: {reading.size} ruler points with different readings, allowed from 4")
    if sense < 0:
        reading, displacement = -reading[::-1], displacement[::-1]
    curve = fit_smooth(reading, displacement)
    u_m = max(curve.scatter, ruler.u_displacement_m)
    return RulerCurve(**vars(curve), u_m=u_m, stated_m=ruler.u_displacement_m)


def _pool_neighbours(reading: Array, displacement: Array) -> tuple[Array, Array]:
    """Points with rising readings: neighbours that do not rise are put at their common mean."""
    rising, group = np.unique(isotonic_regression(reading).x, return_inverse=True)
    return rising, np.bincount(group, displacement) / np.bincount(group)


def position_of(name: str, ruler: RulerInfo, time_s: Array, reading: Array, u_noise: float) -> Position:
    """Displacement, m, of the ruler for readings (n,) at times (n,), with its uncertainties and a flag of each sample
    beyond the ruler's ends; ``u_noise``: standard deviation of a reading's noise, in the reading's unit."""
    curve = ruler_curve(ruler, name)
    beyond = max(CLIP_NOISE * u_noise, 2.0 * ruler.u_reading)
    flag = np.zeros(reading.size, dtype=np.uint8)
    rising = ruler.reading[-1] > ruler.reading[0]
    flag[reading < curve.places[0] - beyond] = BELOW if rising else ABOVE
    flag[reading > curve.places[-1] + beyond] = ABOVE if rising else BELOW
    return Position(
        name, ruler, time_s, curve.value(reading), curve.u_at(reading), curve.slope(reading) * u_noise, flag,
        curve.judgement,
    )  # fmt: skip
