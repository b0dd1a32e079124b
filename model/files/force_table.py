"""Read and check force tables: time in s, force in N, positive downwards on the key, linear between points."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.errors import InputError
from model.files.csv_columns import read_columns
from model.files.time_table import check_rows, two_columns

Array = NDArray[np.float64]

LARGEST_FORCE_N = 1000.0  # ten times the loudest stroke: beyond, a table is in another unit

# What a finger or a motor does to a key. A table beyond these limits is most often in another unit.
RISE = (0.1, 0.9)  # shares of the peak between which a rise time is taken, as usual
LONGEST_BLOW_S = 10.0  # pressed without a pause; a held bass note is damped or gone by then
LONGEST_RISE_S = 2.0  # from a tenth to nine tenths of the peak; the slowest audible stroke takes some 0.2 s
SHORTEST_BLOW_S = 2e-3  # a key needs 10 ms at 50 N to go down; in less no force of a hand moves it
PEAKS_N = (0.2, 300.0)  # an up weight is 0.2 N; the loudest strokes reach 50 to 100 N


def check_force_table(
    time_s: ArrayLike, force_n: ArrayLike, where: str = "force table", column: str = "force_n"
) -> tuple[Array, Array]:
    """Return increasing times (k,), s, and forces (k,), N, as arrays; `InputError` names ``where``, ``column`` and the
    first row that cannot be used.

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
    """Read times (k,), s, and forces (k,), N, from a CSV file with the columns ``time_s`` and ``column`` and no others
    (``torque_nm``: torques, N m).

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


def _first_crossing(times: Array, forces: Array, level: float) -> float:
    """Time (s) at which the force, linear between its points, first reaches ``level``, which it does."""
    k = int(np.argmax(forces >= level))
    if k == 0:
        return float(times[0])
    share = (level - forces[k - 1]) / (forces[k] - forces[k - 1])
    return float(times[k - 1] + share * (times[k] - times[k - 1]))


def _longest_stretch(times: Array, forces: Array, level: float) -> float:
    """Longest time (s) for which the force stays above ``level`` without a pause."""
    above = forces > level
    edges = np.diff(np.concatenate([[0], above.astype(np.int8), [0]]))
    starts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1

    def crossings(inner: NDArray[np.int64], outer: NDArray[np.int64]) -> Array:
        """Times between samples above the level and their neighbours below; the samples' own at the table's ends."""
        inside = outer == inner
        share = (forces[inner] - level) / np.where(inside, 1.0, forces[inner] - forces[outer])
        return np.asarray(times[inner] + np.where(inside, 0.0, share) * (times[outer] - times[inner]))

    until = crossings(ends, np.minimum(ends + 1, len(times) - 1))
    return float(np.max(until - crossings(starts, np.maximum(starts - 1, 0))))


def _blow_seconds(times: Array, forces: Array) -> tuple[float, float]:
    """Longest time, s, for which the force (n,), N, stays above a low share (`RISE`) of its peak, and how long, s, its
    last rise before the peak takes from that share to the high one."""
    peak = int(np.argmax(forces))
    most, until = float(forces[peak]), slice(0, peak + 1)
    low = np.flatnonzero(forces[until] <= RISE[0] * most)
    rising = slice(int(low[-1]) if len(low) else 0, peak + 1)
    reached = [_first_crossing(times[rising], forces[rising], share * most) for share in RISE]
    return _longest_stretch(times, forces, RISE[0] * most), reached[1] - reached[0]


def blow_implausibility(time_s: ArrayLike, force_n: ArrayLike, where: str = "force table") -> str:
    """Sentence on why a force table cannot be a blow on a key; empty where it can.

    Such a table is most often in another unit, as milliseconds under ``time_s``. It can be simulated all the same.

    Parameters
    ----------
    time_s, force_n : (k,) increasing times, s, and forces, N, positive downwards
    where : what to call the table

    Returns
    -------
    str

    Raises
    ------
    InputError : the table cannot be used, as by `check_force_table`

    Examples
    --------
    >>> import model
    >>> time_s, force_n = model.force_table("forte")
    >>> model.blow_implausibility(time_s, force_n)
    ''
    >>> print(model.blow_implausibility(1e3 * time_s, force_n, "ms.csv"))
    ms.csv: cannot be a blow: pressed for 289 s without a pause, blows up to 10 s; are its times in ms? give s
    """
    times, forces = check_force_table(time_s, force_n, where)
    most, least = float(forces.max()), float(forces.min())
    says = f"{where}: cannot be a blow: "
    if not most >= PEAKS_N[0]:
        if -least > PEAKS_N[0]:
            return f"{says}the force never presses (largest {most:.3g} N, smallest {least:.3g} N); down is positive"
        return f"{says}largest force {most:.3g} N, a key needs {PEAKS_N[0]:g} N or more; is the force in N?"
    if most > PEAKS_N[1]:
        return f"{says}largest force {most:.3g} N, blows up to {PEAKS_N[1]:g} N; is the force in N?"
    pressed, rise = _blow_seconds(times, forces)
    in_ms = "; are its times in ms? give s" if pressed <= 1e3 * LONGEST_BLOW_S else "; are its times in s?"
    if pressed > LONGEST_BLOW_S:
        return f"{says}pressed for {pressed:.3g} s without a pause, blows up to {LONGEST_BLOW_S:g} s{in_ms}"
    if rise > LONGEST_RISE_S:
        return f"{says}the force takes {rise:.3g} s to rise, blows up to {LONGEST_RISE_S:g} s{in_ms}"
    if pressed < SHORTEST_BLOW_S:
        shortest = 1e3 * SHORTEST_BLOW_S
        return f"{says}pressed for {1e3 * pressed:.3g} ms, blows from {shortest:g} ms; are its times in s?"
    return ""
