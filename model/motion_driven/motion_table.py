"""Tables of a measured angle, of key, motor arm or finger: read, checked, lost angles left out."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from model.errors import InputError
from model.files.csv_columns import read_columns
from model.files.time_table import Array, check_rows, two_columns
from model.scene.selection import SceneChoice, load_scene

FEWEST, MOST = 20, 200_000  # samples
LARGEST_KEY_RAD = 3.0


def check_motion_table(time_s: ArrayLike, key_rad: ArrayLike, where: str = "key motion") -> tuple[Array, Array]:
    """Times and angles (n,) that can be used; lost ones (NaN) are left out. ``InputError`` names the first bad row."""
    times, angles = two_columns(time_s, key_rad, where)
    lost = np.isnan(angles)
    check_rows(times, angles, where, "key_rad", LARGEST_KEY_RAD, lost)
    times, angles = times[~lost], angles[~lost]
    if not FEWEST <= len(times) <= MOST:
        raise InputError(f"{where}: found {len(times)} rows with an angle, allowed {FEWEST} to {MOST}")
    return times, angles


def read_motion_table(path: str | Path, scene: SceneChoice | str | Path = "whole") -> tuple[Array, Array]:
    """Read the motion of a key from a CSV file with the columns ``time_s,key_rad``.

    Parameters
    ----------
    path : CSV file
    scene : what takes part; with a motor arm or a finger the second column is ``motor_rad`` or ``finger_rad``

    Returns
    -------
    tuple of ndarray
        Times (n,), s, and angles (n,), rad, without rows whose angle is NaN.

    Raises
    ------
    InputError : the file cannot be read or used; the message names file and row

    Examples
    --------
    >>> import model
    >>> time_s, key_rad = model.read_motion_table("key.csv")
    >>> bool(key_rad.min() < -0.04)  # pressed, the key turns clockwise
    True
    """
    angle = f"{load_scene(scene).moved}_rad"
    table = read_columns(path, ("time_s", angle), ())
    return check_motion_table(table.numbers("time_s"), table.numbers(angle), table.where)
