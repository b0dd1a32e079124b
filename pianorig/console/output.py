"""Writing what commands give: column files (CSV or HDF5) that are whole or absent, and ``--json`` lines."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from model.files.atomic_write import whole_file
from pianorig.errors import InputError

if TYPE_CHECKING:
    import pandas as pd

    from model import Action


def check_writable(path: Path) -> None:
    """Refuse, before any work is done, a file that could not be written in the end."""
    folder = path.parent
    if not folder.is_dir():
        raise InputError(f"{path}: folder {folder} does not exist; create it or choose another --out")
    if path.is_dir():
        raise InputError(f"{path}: is a folder; --out names a file")
    try:
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as problem:
        raise InputError(f"{path}: cannot be written ({problem.strerror}); choose another --out") from None


def _write_csv(path: Path, columns: Mapping[str, NDArray[np.float64]]) -> None:
    rows = np.column_stack(list(columns.values())).tolist()
    with open(path, "w", encoding="utf-8", newline="\n") as file:
        file.write(",".join(columns) + "\n")
        # repr of a float is the shortest text that reads back to the same number
        file.writelines(",".join(map(repr, row)) + "\n" for row in rows)


def _write_h5(
    path: Path,
    columns: Mapping[str, NDArray[np.float64]],
    attributes: Mapping[str, Any],
    long_names: Mapping[str, str],
) -> None:
    import h5py

    with h5py.File(path, "w") as file:
        for key, value in attributes.items():
            file.attrs[key] = value
        for name, column in columns.items():
            data = file.create_dataset(name, data=column)
            data.attrs["units"] = _unit(name)
            if name in long_names:
                data.attrs["long_name"] = long_names[name]
            if name == "time_s":
                data.make_scale("time_s")
            else:
                data.dims[0].attach_scale(file["time_s"])


def _unit(name: str) -> str:
    for ending, unit in _UNITS:
        if name.endswith(ending):
            return unit
    return "1"


# by the ending of a column's name; a longer ending before the shorter one it ends with
_UNITS = (
    ("_rad_per_s2", "rad/s^2"),
    ("_rad_per_s", "rad/s"),
    ("_m_per_s2", "m/s^2"),
    ("_m_per_s", "m/s"),
    ("_rad", "rad"),
    ("_m", "m"),
    ("_n", "N"),
    ("_j", "J"),
    ("_s", "s"),
)


def run_attributes(action: Action, tolerance: float, method: str, scene: str) -> dict[str, Any]:
    """What a file of columns says about the run that it came from."""
    return {
        "action": action.name,
        "changed": ", ".join(f"{k}={v!r}" for k, v in action.changed.items()),
        "tolerance_rad": tolerance,
        "method": method,
        "scene": scene,
    }


def write_columns(
    path: Path,
    columns: Mapping[str, NDArray[np.float64]],
    attributes: Mapping[str, Any] | None = None,
    long_names: Mapping[str, str] | None = None,
) -> None:
    """Write columns of equal length to ``path`` (.csv, or .h5 with units and a time scale), whole or not at all.

    ``attributes`` of the file and ``long_names`` of columns go into .h5 only.

    Raises
    ------
    InputError : unknown ending, or the file cannot be written
    """
    if path.suffix not in (".csv", ".h5"):
        raise InputError(f"{path}: ending found {path.suffix!r}, allowed .csv or .h5")
    check_writable(path)
    with whole_file(path, "choose another --out") as part:
        if path.suffix == ".csv":
            _write_csv(part, columns)
        else:
            _write_h5(part, columns, attributes or {}, long_names or {})


def print_json(item: Mapping[str, Any]) -> None:
    """One JSON object on standard output; numbers of NumPy and paths become plain."""

    def plain(value: Any) -> Any:
        if isinstance(value, np.generic):
            return value.item()
        if isinstance(value, np.ndarray):
            return value.tolist()
        return str(value)

    print(json.dumps(item, default=plain))


def print_verdict(lines: Sequence[str]) -> None:
    """Headline of a comparison, then its details one below the other."""
    headline, *details = lines
    print(headline)
    for line in details:
        print(f"  - {line}")


def write_table(path: Path, table: pd.DataFrame) -> None:
    """Write a pandas table as CSV, whole or not at all."""
    check_writable(path)
    with whole_file(path, "choose another --out") as part:
        table.to_csv(part, index=False)
