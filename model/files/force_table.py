"""Force tables: time in s, force in N, positive downwards on the key, linear between points; read and checked.

A table that cannot be used is refused with its row and what is allowed.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.errors import InputError
from model.files.csv_columns import read_columns
from model.files.time_table import check_rows, two_columns

Array = NDArray[np.float64]

LARGEST_FORCE_N = 1000.0


def check_force_table(
    time_s: ArrayLike, force_n: ArrayLike, where: str = "force table", column: str = "force_n"
) -> tuple[Array, Array]:
    """Check a force table and return it as arrays.

    Parameters
    ----------
    time_s, force_n : (k,) increasing times, s, and forces, N
    where : what to call the table in an error
    column : what to call the forces in an error

    Returns
    -------
    tuple of ndarray
        Times and forces, (k,) each.

    Raises
    ------
    InputError : fewer than two rows, or the first row that cannot be used, with its number

    Examples
    --------
    >>> import model
    >>> times, forces = model.check_force_table([0.0, 0.1], [0, 5])
    >>> forces.dtype.name
    'float64'
    """
    times, forces = two_columns(time_s, force_n, where)
    if len(times) < 2:
        raise InputError(f"{where}: found {len(times)} rows, allowed at least 2")
    check_rows(times, forces, where, column, LARGEST_FORCE_N)
    return times, forces


def read_force_table(path: str | Path, column: str = "force_n") -> tuple[Array, Array]:
    """Read a force table from a CSV file with the columns ``time_s,force_n``.

    Parameters
    ----------
    path : CSV file
    column : name of the second column; a motor's is ``torque_nm``

    Returns
    -------
    tuple of ndarray
        Times (k,), s, and forces (k,), N, or torques, N m.

    Raises
    ------
    InputError : the file cannot be read or used; the message names file and row

    Examples
    --------
    >>> import model
    >>> time_s, force_n = model.read_force_table("force.csv")
    >>> len(time_s) == len(force_n)
    True
    """
    table = read_columns(path, ("time_s", column), ())
    return check_force_table(table.numbers("time_s"), table.numbers(column), table.where, column)
