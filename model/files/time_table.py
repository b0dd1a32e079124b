"""Checks of tables of one quantity over time, for force and motion tables."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.arrays import as_numbers
from model.errors import InputError

Array = NDArray[np.float64]

UNEVEN = 0.01  # of a step, up to which steps count as equal where something is differentiated
LARGEST_TIME_S = 1e6  # s: up to it a double still tells nanoseconds apart


def two_columns(time_s: ArrayLike, values: ArrayLike, where: str) -> tuple[Array, Array]:
    """Times and values (n,) as float arrays; ``InputError`` where they are not numbers or not equally many."""
    times, numbers = as_numbers(time_s, f"{where}: time_s"), as_numbers(values, where)
    if times.ndim != 1 or times.shape != numbers.shape:
        raise InputError(f"{where}: found shapes {times.shape} and {numbers.shape}, allowed two equal columns")
    return times, numbers


def check_rows(
    times: Array, values: Array, where: str, column: str, limit: float, lost: NDArray[np.bool_] | bool = False
) -> None:
    """Refuse values beyond ``limit``, values not finite (except where ``lost``), and times that do not increase."""
    for name, numbers, most, excused in (("time_s", times, LARGEST_TIME_S, False), (column, values, limit, lost)):
        bad = (np.abs(numbers) > most) | (~np.isfinite(numbers) & ~np.asarray(excused))
        if bad.any():
            row = int(np.argmax(bad))
            raise InputError(
                f"{where}: row {row + 1}: {name} found {numbers[row]:g}, allowed finite numbers up to {most:g}"
            )
    steps = np.diff(times)
    if (steps <= 0).any():
        row = int(np.argmax(steps <= 0)) + 1
        raise InputError(
            f"{where}: row {row + 1}: time {times[row]:g} s does not follow {times[row - 1]:g} s; times must increase"
        )
