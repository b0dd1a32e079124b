"""Errors that all points of a loading experiment share, as columns of its file.

A column ``common_<name>_m`` or ``common_<name>_n`` says by how much displacement or force of each point would move if
the error ``<name>`` were one standard uncertainty. The two columns of one name are one error.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from model.errors import InputError

PREFIX = "common_"
CommonErrors = dict[str, NDArray[np.float64]]
"""By name, (2, n): change of displacement, m, and of force, N, of each point."""
_COLUMN = re.compile(PREFIX + r"(?P<name>[a-z][a-z0-9_]*)_[mn]")


def common_names(columns: Sequence[str], where: str) -> dict[str, tuple[str, str]]:
    """Names of the common errors among a file's columns, each with its column of displacement and of force.

    Raises
    ------
    InputError : a column with the prefix that says neither m nor n
    """
    found: dict[str, tuple[str, str]] = {}
    for column in columns:
        if not column.startswith(PREFIX):
            continue
        match = _COLUMN.fullmatch(column)
        if match is None:
            raise InputError(f"{where}: column found {column}; allowed {PREFIX}<name>_m and {PREFIX}<name>_n")
        name = match["name"]
        found[name] = (f"{PREFIX}{name}_m", f"{PREFIX}{name}_n")
    return found
