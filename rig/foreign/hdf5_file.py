"""HDF5: a sealed trial of a session, or any file with datasets of numbers (``name``, ``group/name``).

A trial gives ``force_n`` (less its mean before the blow), ``motor_command_v`` and the angles in rad, once its seal is
found right. Other files carry no checksum: what the HDF5 library cannot read is refused. A channel is a dataset of
one dimension longer than 1, or a column of a table of named columns. ``scale_factor`` and ``add_offset`` (CF),
``conversion`` and ``offset`` (NWB), ``_Unsigned``, ``_FillValue`` and ``missing_value`` of a dataset are applied; what
else its attributes, and those of its groups, may say of unit, scale and rate is in `stated_properties`. NWB's
``starting_time`` beside a dataset ``data`` is its clock.
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from rig.errors import RigInputError
from rig.foreign.channel_table import ChannelTable
from rig.foreign.sample_times import Clock
from rig.foreign.stated_properties import (
    find_clock,
    find_scale_doubt,
    find_scale_doubt_of_groups,
    find_unit,
    scale_numbers,
    text_of,
)
from rig.platform_calls import ending_by_keyboard
from rig.session.sealed_trial import SCHEMA, read_trial

FACTORS, OFFSETS, MISSING = ("scale_factor", "conversion"), ("add_offset", "offset"), ("_FillValue", "missing_value")


def read_hdf5(path: Path) -> ChannelTable:
    """Read a sealed trial (time, force corrected or else less its mean before the blow, command, angles; further
    channels where it has no force), or every dataset of numbers of another HDF5 file; RigInputError when it cannot be
    read."""
    try:
        # a damaged heap can keep the library busy without end
        with ending_by_keyboard(), h5py.File(path, "r") as file:
            if file.attrs.get("schema") != SCHEMA:
                return _read_plain_file(path, file)
    except RigInputError:
        raise
    except (OSError, RuntimeError, ValueError, TypeError, KeyError) as error:
        if "lock file" in str(error):
            raise RigInputError(f"{path}: another program has the file open; close it there") from None
        raise RigInputError(f"{path}: not a readable HDF5 file ({' '.join(str(error).split())[:120]})") from None
    data = read_trial(path)
    no_force = not data.has_force
    before = data.time_s < data.blow_start_s
    baseline_n = float(data.raw_force_n[before].mean()) if before.any() else 0.0
    angles = {f"{e.name}_rad": data.angle_rad[:, i] for i, e in enumerate(data.encoders)}
    further = {}
    if no_force and data.channel_values is not None:
        further = {info.name: data.channel_values[:, k] for k, info in enumerate(data.channels)}
    acted = np.empty(0) if no_force else data["force_n"]
    force = {} if no_force else {"force_n": acted if np.isfinite(acted).all() else data.raw_force_n - baseline_n}
    columns = {"time_s": data.time_s, **force, "motor_command_v": data.motor_command_v, **angles, **further}
    clock = Clock(1.0 / data.sample_rate_hz)
    units = {"time_s": "s", "force_n": "N", "motor_command_v": "V", **dict.fromkeys(angles, "rad")}
    return ChannelTable(str(path), columns, units, dict.fromkeys(columns, clock), started=data.started_utc)


def _read_plain_file(path: Path, file: h5py.File) -> ChannelTable:
    """Read every one-dimensional dataset of numbers, and every column of a table, as channels, scaled as their
    attributes say, with units and clocks; others are noted as unreadable."""
    found: list[tuple[str, str, h5py.Dataset, str]] = []
    outer: dict[str, dict[str, Any]] = {"/": _read_attributes(file)}

    def take(name: str, node: h5py.Group | h5py.Dataset | h5py.Datatype) -> None:
        if isinstance(node, h5py.Group):
            outer[node.name] = _read_attributes(node)
        elif isinstance(node, h5py.Dataset) and node.size and node.ndim and node.attrs.get("MATLAB_class") != b"char":
            columns = node.dtype.names or ("",)
            found.extend((name, column, node, column or name) for column in columns)

    file.visititems(take)
    for group, properties in outer.items():  # a number beside the datasets says of them what an attribute would
        scalars = ((name, node) for name, node in file[group].items() if isinstance(node, h5py.Dataset))
        properties |= {name: node[()] for name, node in scalars if node.size == 1 and node.dtype.kind in "iuf"}
    short = Counter(name for *_, name in found)
    columns, clocks, unreadable = {}, {}, {}
    units: dict[str, str] = {}
    doubts: dict[str, str] = {}
    for path_in_file, column, node, name in found:
        name = name if short[name] == 1 else f"{path_in_file}/{column}".strip("/")
        if reason := _reason_unusable(node, column, path.parent):
            unreadable[name] = f"{name} {reason}"
            continue
        raw = (node[column] if column else node[()]).reshape(-1)
        stated = _read_attributes(node, column)
        above = [outer[group] for group in _parent_groups(node.name)]
        columns[name], doubt = _apply_scale(raw, stated)
        unit, contradiction = find_unit(stated)
        are_unscaled = raw.dtype.kind in "iu" and not _scales(stated)
        doubt = doubt or contradiction or find_scale_doubt_of_groups(name, above, are_integers=are_unscaled)
        units |= {name: unit} if unit else {}
        doubts |= {name: f"{name}: {doubt}"} if doubt else {}
        start = node.parent.get("starting_time") if path_in_file.split("/")[-1] == "data" else None
        if isinstance(start, h5py.Dataset) and (rate := float(text_of(start.attrs.get("rate", 0.0)))) > 0:
            clocks[name] = Clock(1.0 / rate, float(start[()]), source="starting_time")
        elif clock := find_clock(stated, *above):
            clocks[name] = clock
    if not columns:
        more = f"; {next(iter(unreadable.values()))}" if unreadable else ""
        raise RigInputError(f"{path}: no one-dimensional dataset of numbers{more}")
    return ChannelTable(str(path), columns, units, clocks, unreadable, doubts)


def _reason_unusable(node: h5py.Dataset, column: str, folder: Path) -> str:
    """Why a dataset, or a ``column`` of it (empty: itself), is no channel of numbers; empty where it is one.
    ``folder``: the file's, in which parts of it may lie."""
    kind = node.dtype[column] if column else node.dtype
    if kind.subdtype is not None:
        return f"holds {kind.shape} numbers a row, allowed one"
    if kind.kind not in "iuf":
        return "holds no numbers"
    if max(node.shape) != node.size:
        return f"is a table of {node.shape} numbers, allowed one dimension longer than 1"
    if node.is_virtual:  # HDF5 would fill in zeros
        sources = [source.file_name for source in node.virtual_sources()]
        absent = [name for name in sources if name != "." and not (folder / name).exists()]
        return f"lies in the file {absent[0]}, which is not there" if absent else ""
    return ""


def _parent_groups(name: str) -> list[str]:
    parts = name.strip("/").split("/")[:-1]
    return ["/" + "/".join(parts[:k]) for k in range(len(parts), -1, -1)]


LARGEST_ATTRIBUTE = 10_000
"""Values of an attribute that are read; HDF5 itself allows 64 KB. A damaged size would take hours to read."""


def _read_attributes(node: h5py.Group | h5py.Dataset, column: str = "") -> dict[str, Any]:
    """Attributes of a group or dataset by name, without those of more than 10,000 values; where a ``column`` of a table
    is named, its own unit out of a list of units."""
    found = {}
    for key in node.attrs:
        if np.prod(node.attrs.get_id(key).shape or (1,)) > LARGEST_ATTRIBUTE:
            continue
        value = found[key] = node.attrs[key]
        if column and key.lower() in ("unit", "units"):
            cells = [text_of(cell) for cell in np.ravel(value)]
            cells = cells[0].split(",") if len(cells) == 1 else cells
            names = node.dtype.names
            # as many as columns, or one for all; else none of them is taken for the unit
            found[key] = cells[names.index(column) if len(cells) > 1 else 0] if len(cells) in (1, len(names)) else "?"
    return found


def _scales(stated: dict[str, Any]) -> dict[str, float]:
    return {key: value for key, value in scale_numbers(stated) if key in (*FACTORS, *OFFSETS)}


def _apply_scale(raw: NDArray[np.generic], stated: dict[str, Any]) -> tuple[NDArray[np.float64], str]:
    """Values (n,) scaled by the factor and offset that their attributes state, missing ones NaN; and in words what in
    them may be a scale but is not known (then not scaled), or empty."""
    if text_of(stated.get("_Unsigned", "")).lower() == "true" and raw.dtype.kind == "i":
        raw = raw.view(raw.dtype.str.replace("i", "u"))
    values = np.asarray(raw, dtype=np.float64)
    for key in MISSING:
        for missing in np.ravel(stated.get(key, ())):
            if isinstance(missing, np.number | int | float):
                # stated with more digits than the numbers have
                values = np.where(raw == np.asarray(missing).astype(raw.dtype), np.nan, values)
    scales = _scales(stated)
    factors = {scales[key] for key in FACTORS if key in scales}
    offsets = {scales[key] for key in OFFSETS if key in scales}
    if len(factors) > 1 or len(offsets) > 1:
        return values, f"the attributes {scales} contradict each other"
    if doubt := find_scale_doubt(stated, (*FACTORS, *OFFSETS), are_integers=raw.dtype.kind in "iu" and not scales):
        return values, doubt
    factor, offset = next(iter(factors), 1.0), next(iter(offsets), 0.0)
    return (values if factor == 1.0 and offset == 0.0 else values * factor + offset), ""
