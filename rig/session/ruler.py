"""Displacement from a position sensor that is not linear: a monotone curve through points read on a ruler.

In: readings of a sensor and the calibration's points (`RulerInfo`). Out: the displacement of the calibrated point, m,
with its uncertainty and a flag for every sample (`Position`). The curve is smooth and monotone and passes near the
points (`rig.session.smooth_curve`); readings that go back by no more than their own uncertainty are pooled with their
neighbours first. It is judged by leaving out each inner point in turn: what the others say of it tells how well the
ruler was read.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from rig.errors import RigInputError
from rig.session.ruler_info import RulerInfo
from rig.session.smooth_curve import SmoothCurve, fit_smooth

Array = NDArray[np.float64]

BELOW, ABOVE = 1, 2
"""Flags: the reading lies below the first point of the ruler, or above the last, by more than its noise."""
DRAWS, SEED = 64, 1
CHOICE = 0.4
"""What choosing the smoothness by the points themselves leaves open, of a point's uncertainty: so that six kinds of
sensors are covered as stated (a test)."""
CLIP_NOISE = 3.0
"""A reading is beyond the ruler's end if it is so many standard deviations of its noise past it."""
JUDGED_BAD = 2.0
"""The ruler was read worse than stated when the points scatter by more than this many times their uncertainty."""


@dataclass(frozen=True)
class RulerCurve:
    """A fitted calibration.

    Attributes
    ----------
    curve : displacement (m) over reading, near the points after pooling
    u_m : standard uncertainty of a point, m: as stated, or as the points scatter where that is more
    stated_m : standard uncertainty stated for a reading of the ruler, m
    """

    curve: SmoothCurve
    u_m: float
    stated_m: float

    @property
    def reading(self) -> Array:
        """Readings of the points (p,), rising."""
        return self.curve.places

    @property
    def displacement_m(self) -> Array:
        """Displacements (p,), m, on the curve."""
        return self.curve.height

    @property
    def scatter_m(self) -> float:
        """What the points scatter by about a smooth curve, m."""
        return self.curve.scatter

    @property
    def judgement(self) -> str:
        """One line: how well the points lie on a smooth monotone curve."""
        found = f"points scatter by {1e3 * self.scatter_m:.2f} mm, stated {1e3 * self.stated_m:.2f} mm"
        if self.scatter_m > JUDGED_BAD * self.stated_m:
            return f"{found}: the ruler was read worse than stated; {1e3 * self.u_m:.2f} mm is used"
        return f"{found}: as good as stated"

    def at(self, reading: Array) -> Array:
        """Displacement (m) at readings, held at the ends."""
        return self.curve.value(reading)

    def slope(self, reading: Array) -> Array:
        """Displacement per reading, m, at readings inside the ruler; 0 beyond it."""
        inside = (reading >= self.reading[0]) & (reading <= self.reading[-1])
        return np.where(inside, np.abs(self.curve.slope(reading)), 0.0)

    def drawn(self, random: np.random.Generator, reading: Array) -> Array:
        """Displacements (m) at readings by another calibration that the ruler's uncertainty allows."""
        return self.curve.moved(self.u_m * random.standard_normal(self.reading.size), reading)

    def draws(self, reading: Array, n: int = DRAWS) -> Array:
        """Displacements (n, m) by calibrations that the ruler's uncertainty allows, seeded."""
        random = np.random.default_rng(SEED)
        return np.array([self.drawn(random, reading) for _ in range(n)])

    def u_at(self, reading: Array) -> Array:
        """Standard uncertainty (m) of the calibration at readings: common to all samples there, not noise."""
        return np.interp(reading, *self._u_grid)

    @cached_property
    def _u_grid(self) -> tuple[Array, Array]:
        """Readings and the standard uncertainty there: drawn once for a ruler, not for each trial."""
        grid = np.linspace(0.0, 1.0, 257) ** 2 * (self.reading[-1] - self.reading[0]) + self.reading[0]
        return grid, np.hypot(self.draws(grid).std(axis=0), CHOICE * self.u_m)


@dataclass(frozen=True, eq=False)
class Position:
    """Displacement of a named point of a body, measured.

    Attributes
    ----------
    name : str
        Of the channel.
    ruler : RulerInfo
        Body, calibrated point and place of the sensor.
    time_s : ndarray, shape (n,)
    displacement_m : ndarray, shape (n,)
        Of the calibrated point, m; where ``flag`` is set the end of the ruler, beyond which nothing is known.
    u_calibration_m : ndarray, shape (n,)
        Standard uncertainty of the calibration, m: the same error wherever the reading is the same.
    u_noise_m : ndarray, shape (n,)
        Standard uncertainty of one sample's noise, m.
    flag : ndarray of uint8, shape (n,)
        0, `BELOW` or `ABOVE`.
    judgement : str
        How well the ruler's points lie on a smooth curve.
    """

    name: str
    ruler: RulerInfo
    time_s: Array
    displacement_m: Array
    u_calibration_m: Array
    u_noise_m: Array
    flag: NDArray[np.uint8]
    judgement: str

    @property
    def u_m(self) -> Array:
        """Standard uncertainty of a sample, m, shape (n,)."""
        return np.hypot(self.u_calibration_m, self.u_noise_m)

    @property
    def travel_m(self) -> float:
        """Length of the ruler, m."""
        return float(np.ptp(np.array(self.ruler.displacement_m)))


@lru_cache(maxsize=16)
def ruler_curve(ruler: RulerInfo, where: str = "ruler") -> RulerCurve:
    """Fit the monotone curve of a calibration.

    Parameters
    ----------
    ruler : RulerInfo
    where : str
        The channel, for messages.

    Returns
    -------
    RulerCurve

    Raises
    ------
    RigInputError
        When the readings go back by more than their uncertainty, or fewer than four points are left.
    """
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
    reading, displacement = _pooled(sense * reading, displacement)
    if reading.size < 4:
        raise RigInputError(f"{where}: {reading.size} ruler points with different readings, allowed from 4")
    if sense < 0:
        reading, displacement = -reading[::-1], displacement[::-1]
    curve = fit_smooth(reading, displacement)
    return RulerCurve(curve, max(curve.scatter, ruler.u_displacement_m), ruler.u_displacement_m)


def _pooled(reading: Array, displacement: Array) -> tuple[Array, Array]:
    """Points with rising readings: neighbours that do not rise are put at their common mean."""
    groups: list[list[int]] = []
    for i in range(reading.size):
        groups.append([i])
        while len(groups) > 1 and reading[groups[-1]].mean() <= reading[groups[-2]].mean():
            groups[-2:] = [groups[-2] + groups[-1]]
    return np.array([reading[g].mean() for g in groups]), np.array([displacement[g].mean() for g in groups])


def position_of(name: str, ruler: RulerInfo, time_s: Array, reading: Array, u_noise: float) -> Position:
    """Return the displacement that readings mean.

    Parameters
    ----------
    name : str
        Of the channel.
    ruler : RulerInfo
    time_s, reading : ndarray, shape (n,)
        Sample times, s, and readings in the unit of the ruler's points.
    u_noise : float
        Standard deviation of a reading's noise, same unit.

    Raises
    ------
    RigInputError
        When the calibration cannot be used.
    """
    curve = ruler_curve(ruler, name)
    beyond = max(CLIP_NOISE * u_noise, 2.0 * ruler.u_reading)
    flag = np.zeros(reading.size, dtype=np.uint8)
    rising = ruler.reading[-1] > ruler.reading[0]
    flag[reading < curve.reading[0] - beyond] = BELOW if rising else ABOVE
    flag[reading > curve.reading[-1] + beyond] = ABOVE if rising else BELOW
    return Position(
        name, ruler, time_s, curve.at(reading), curve.u_at(reading), curve.slope(reading) * u_noise, flag,
        curve.judgement,
    )  # fmt: skip
