"""A table derived from a trial, as a sealed HDF5 file with the hashes of what it was made from.

One dataset per column in group ``/table``, dimension ``row``; netCDF-4 tools open it. Attributes are stored as JSON.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np

from rig.atomic_write import translate_os_error
from rig.errors import RigInputError
from rig.session.seal import CONTENT, content_sha256, open_sealed, write_sealed

if TYPE_CHECKING:
    import pandas as pd

SCHEMA = "piano-action-rig derived 1"


def write_table(path: Path, table: pd.DataFrame, attrs: Mapping[str, Any], parents_sha256: Mapping[str, str]) -> None:
    """Write a table of numbers, booleans or text as a sealed HDF5 file, replacing one that was there; ``attrs``: values
    by name, stored as JSON; ``parents_sha256``: SHA-256 of each file it was made from, by name. Its index is not
    stored."""
    names = [str(name) for name in table.columns]
    if len(set(names)) != len(names) or any(not name or "/" in name or name == "row" for name in names):
        raise RigInputError(f"{path}: column names {names} must be unique, not empty, not 'row' and without '/'")
    with translate_os_error(path.parent, "created"):
        path.parent.mkdir(parents=True, exist_ok=True)
    with write_sealed(path) as file:
        file.attrs["schema"] = SCHEMA
        file.attrs["attributes_json"] = json.dumps(dict(attrs), default=_encode_for_json)
        file.attrs["parents_json"] = json.dumps(dict(parents_sha256), sort_keys=True)
        group = file.create_group("table", track_order=True)
        group.attrs["columns_json"] = json.dumps(names)
        row = group.create_dataset("row", data=np.arange(len(table), dtype=np.int64))
        row.make_scale("row")
        for position, name in enumerate(names):
            _write_column(group, name, table.iloc[:, position].to_numpy()).dims[0].attach_scale(row)
        file.attrs[CONTENT] = content_sha256(file)


def _encode_for_json(value: object) -> Any:
    """Return a NumPy array or number as lists or a number, a path as text; RigInputError for any other type (a
    ``default`` of `json.dumps`)."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Path):
        return value.as_posix()
    raise RigInputError(
        f"attribute {value!r} of a derived table is a {type(value).__name__}; use numbers, text or lists"
    )


def _write_column(group: h5py.Group, name: str, values: np.ndarray) -> h5py.Dataset:
    """Write a table's column (n,) as the dataset ``name`` of ``group`` and return that: booleans as int8 with a mark,
    numbers as they are, anything else as text."""
    if values.dtype.kind == "b":
        dataset = group.create_dataset(name, data=values.astype(np.int8))
        dataset.attrs["dtype"] = "bool"
    elif values.dtype.kind in "iuf":
        dataset = group.create_dataset(name, data=values)
    else:
        text = np.array([str(value) for value in values], dtype=object)
        dataset = group.create_dataset(name, data=text, dtype=h5py.string_dtype("utf-8"))
    return dataset


def read_table(path: Path) -> tuple[pd.DataFrame, dict[str, Any]]:
    """Return the table in a sealed file, rows numbered from 0, and its attributes, among them ``parents_sha256``
    (SHA-256 by file name); RigInputError for another kind of file or a broken seal."""
    import pandas as pd  # start-up: pandas costs 0.4 s, opening a session does not need it

    with open_sealed(path) as file:
        if file.attrs.get("schema") != SCHEMA:
            raise RigInputError(f"{path}: schema {file.attrs.get('schema')!r}, expected {SCHEMA!r}")
        attrs = json.loads(file.attrs["attributes_json"])
        attrs["parents_sha256"] = json.loads(file.attrs["parents_json"])
        group = file["table"]
        columns = {name: _read_column(group[name]) for name in json.loads(group.attrs["columns_json"])}
        index = pd.RangeIndex(group["row"].shape[0])
    return pd.DataFrame(columns, index=index), attrs


def _read_column(dataset: h5py.Dataset) -> np.ndarray:
    if h5py.check_string_dtype(dataset.dtype) is not None:
        return np.asarray(dataset.asstr()[()], dtype=object)
    values = np.asarray(dataset[()])
    return values.astype(bool) if dataset.attrs.get("dtype") == "bool" else values
