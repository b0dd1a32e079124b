"""Motor profiles: the commanded force as key points in time, joined by lines or by a monotone cubic.

Conventions: time in s from the start of the profile, force at the key front in N, positive downwards; before the first
and after the last point the force is zero. All values are nominal: the force the key feels depends on arm and action.
The monotone cubic is scipy's PCHIP (Fritsch & Butland 1984): it never overshoots its points.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

from rig.arrays import ArrayRecord, as_numbers
from rig.atomic_write import sha256_of_bytes
from rig.configuration import toml_file
from rig.configuration.rig_file import Number, Table, Text
from rig.errors import RigInputError, refuse

FOLDER = Path(__file__).parents[1] / "profiles"
MAX_DURATION_S = 900.0  # of a profile and of a recording: a quarter of an hour


class _Point(Table):
    time_s: Number = Field(ge=0, le=MAX_DURATION_S)
    force_n: Number


class _File(Table):
    name: Text
    description: str = ""
    interpolation: Literal["linear", "pchip"] = "linear"
    points: list[_Point] = Field(min_length=2)


@dataclass(frozen=True, eq=False)
class Profile(ArrayRecord):
    """A motor profile.

    Attributes
    ----------
    time_s, force_n : ndarray, shape (m,)
        Key points, s (increasing) and N (first and last are zero).
    interpolation : str
        ``linear`` or ``pchip`` (monotone cubic).
    text, sha256 : str
        The TOML text it was read from, and its SHA-256.
    """

    name: str
    time_s: NDArray[np.float64]
    force_n: NDArray[np.float64]
    interpolation: Literal["linear", "pchip"] = "linear"
    description: str = ""
    source: str = ""
    text: str = ""
    sha256: str = ""

    @property
    def duration_s(self) -> float:
        """Time of the last key point, s."""
        return float(self.time_s[-1])

    @property
    def onset_s(self) -> float:
        """Time of the last key point before the force first leaves zero, s."""
        moving = np.flatnonzero(self.force_n)
        return float(self.time_s[max(int(moving[0]) - 1, 0)]) if moving.size else self.duration_s

    def force_at(self, time_s: ArrayLike) -> NDArray[np.float64]:
        """Nominal force at the key front, N, positive downwards, at times of any shape, s from the profile's start, of
        the same shape; zero outside the profile."""
        wanted = as_numbers(time_s, "times of a profile")
        if self.interpolation == "linear":
            return np.interp(wanted, self.time_s, self.force_n, left=0.0, right=0.0)
        from scipy.interpolate import PchipInterpolator  # start-up: costs 0.2 s, profiles joined by lines need none

        with np.errstate(all="ignore"):  # a slope near the smallest float: the mean is zero, as it should be
            force_n = PchipInterpolator(self.time_s, self.force_n, extrapolate=False)(wanted)
        return np.where((wanted < self.time_s[0]) | (wanted > self.time_s[-1]), 0.0, force_n)

    def sample(self, sample_rate_hz: float) -> NDArray[np.float64]:
        """Return the force on the sample clock, N, from time 0; the last sample is zero."""
        n = int(np.ceil(self.duration_s * sample_rate_hz - 1e-9)) + 1
        force = self.force_at(np.arange(n) / sample_rate_hz)
        force[-1] = 0.0
        return force

    def check_limits(self, force_limit_n: float, slew_limit_n_per_s: float, sample_rate_hz: float = 5000.0) -> None:
        """Raise RigInputError where the force exceeds ``force_limit_n`` in size, or changes faster than the slew rate
        when sampled at ``sample_rate_hz``, also between two samples.

        The message names the key point, its value and the limit.
        """
        where = self.source or self.name
        worst = int(np.argmax(np.abs(self.force_n)))
        if abs(self.force_n[worst]) > force_limit_n:
            raise RigInputError(
                f"{where}: points[{worst}].force_n = {self.force_n[worst]:g} N, allowed -{force_limit_n:g} to "
                f"{force_limit_n:g} N; lower it or raise motor.force_limit_n of the rig file"
            )
        sampled = self.sample(sample_rate_hz)
        slew = np.abs(np.diff(sampled)) * sample_rate_hz
        # between two samples a force within the limit moves by half a sample's change at most
        missed = np.abs(self.force_n - np.interp(self.time_s, np.arange(sampled.size) / sample_rate_hz, sampled))
        steepest, lost = int(np.argmax(slew)), int(np.argmax(missed))
        if 2 * sample_rate_hz * missed[lost] > slew_limit_n_per_s * (1 + 1e-9):
            raise RigInputError(f"{where}: {missed[lost]:.4g} N of points[{lost}] lie between two samples; spread them")
        if slew[steepest] > slew_limit_n_per_s * (1 + 1e-9):
            raise RigInputError(
                f"{where}: force changes by {slew[steepest]:.4g} N/s at {steepest / sample_rate_hz:.4g} s, allowed "
                f"{slew_limit_n_per_s:g} N/s; spread the key points or raise motor.slew_limit_n_per_s of the rig file"
            )


def built_in_profiles() -> tuple[str, ...]:
    return toml_file.built_in(FOLDER)


def load_profile(name: str | Path) -> Profile:
    """Load the built-in profile of this name, or the TOML file of this path; RigInputError for neither, or key points
    that are no usable profile.

    Parameters
    ----------
    name : str or path

    Returns
    -------
    Profile

    Raises
    ------
    RigInputError
        When the file is missing, not TOML, or its key points are not a usable profile.

    Examples
    --------
    >>> import rig
    >>> rig.load_profile("piano").name
    'piano'
    """
    path = toml_file.find_toml(name, FOLDER, "profile")
    return parse_profile(toml_file.read_text(path), str(path))


def parse_profile(text: str, where: str = "profile") -> Profile:
    r"""Build a profile from the text of a TOML file; RigInputError, which begins with ``where``, for text that is none
    or key points that are no usable profile.

    Parameters
    ----------
    text : str
    where : str
        What to call it in errors.

    Returns
    -------
    Profile

    Raises
    ------
    RigInputError
        When the text is not TOML, or its key points are not a usable profile.

    Examples
    --------
    >>> import rig
    >>> points = "[{ time_s = 0.0, force_n = 0.0 }, { time_s = 0.1, force_n = 2.0 }, { time_s = 0.5, force_n = 0.0 }]"
    >>> profile = rig.parse_profile(f'name = "push"\ninterpolation = "linear"\npoints = {points}')
    >>> float(profile.force_at(0.05))
    1.0
    """
    file = toml_file.check(_File, toml_file.parse_toml(text, where), where)
    _check_points(file.points, where)
    return Profile(
        name=file.name,
        time_s=np.array([point.time_s for point in file.points]),
        force_n=np.array([point.force_n for point in file.points]),
        interpolation=file.interpolation,
        description=file.description,
        source=where,
        text=text,
        sha256=sha256_of_bytes(text.encode("utf-8")),
    )


def _check_points(points: Sequence[_Point], where: str) -> None:
    """Raise RigInputError, which begins with ``where``, for key points whose times do not rise, or whose first or last
    force is not zero."""
    for i, (before, after) in enumerate(zip(points, points[1:], strict=False)):
        refuse(
            RigInputError,
            (
                after.time_s == before.time_s,
                f"{where}: points[{i}] and points[{i + 1}] are both at time_s = {after.time_s:g} s; move or remove one",
            ),
            (
                after.time_s < before.time_s,
                f"{where}: points[{i + 1}].time_s = {after.time_s:g} s, allowed above "
                f"points[{i}].time_s = {before.time_s:g} s",
            ),
        )
    for i, word in ((0, "start"), (len(points) - 1, "end")):
        if points[i].force_n != 0.0:
            raise RigInputError(
                f"{where}: points[{i}].force_n = {points[i].force_n:g} N, allowed 0: a profile must {word} at zero"
            )
