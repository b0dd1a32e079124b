"""HDF5: a sealed trial of a session, or any file with datasets of numbers (``name``, ``group/name``).

A trial gives ``force_n`` (less its mean before the blow), ``motor_command_v`` and the angles in rad; its seal is
checked first. Other files carry no checksum: what the HDF5 library cannot read is refused. A channel is a dataset of
one dimension longer than 1, or a column of a table of named columns. A dataset's attribute ``units`` or ``unit`` is its
unit. ``scale_factor`` and ``add_offset`` (CF), ``conversion`` and ``offset`` (NWB), ``_FillValue`` and
``missing_value`` are applied; another number that looks like a scale is a doubt. NWB's ``starting_time`` beside a
dataset ``data`` is its clock.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from rig.errors import RigInputError
from rig.foreign.channel_table import ChannelTable, known
from rig.foreign.sample_times import Clock
from rig.session.sealed_trial import SCHEMA, read_trial

FACTORS, OFFSETS, MISSING = ("scale_factor", "conversion"), ("add_offset", "offset"), ("_FillValue", "missing_value")
_SCALE_NAMES = re.compile(
    r".*(scale|scaling|gain|slope|sensitivity|conversion|multipl|factor|calib|offset|intercept).*"
)
"""Names of attributes that change what a number means."""


def read_hdf5(path: Path) -> ChannelTable:
    """Read the channels of a trial or of a plain HDF5 file.

    Raises RigInputError when the file cannot be read or has no numbers.
    """
    try:
        with h5py.File(path, "r") as file:
            if file.attrs.get("schema") != SCHEMA:
                return _plain(path, file)
    except RigInputError:
        raise
    except (OSError, RuntimeError, ValueError, TypeError, KeyError) as error:
        if "lock file" in str(error):
            raise RigInputError(f"{path}: another program has the file open; close it there") from None
        raise RigInputError(f"{path}: not a readable HDF5 file ({' '.join(str(error).split())[:120]})") from None
    data = read_trial(path)
    no_force = not data.has_force
    before = data.time_s < data.blow_start_s
    baseline_n = float(data.force_n[before].mean()) if before.any() else 0.0
    angles = {f"{e.name}_rad": data.angle_rad()[:, i] for i, e in enumerate(data.encoders)}
    further = {}
    if no_force and data.channel_values is not None:
        further = {info.name: data.channel_values[:, k] for k, info in enumerate(data.channels)}
    force = {} if no_force else {"force_n": data.force_n - baseline_n}
    columns = {"time_s": data.time_s, **force, "motor_command_v": data.motor_command_v, **angles, **further}
    clock = Clock(1.0 / data.sample_rate_hz)
    units = {"time_s": "s", "force_n": "N", "motor_command_v": "V", **dict.fromkeys(angles, "rad")}
    return ChannelTable(str(path), columns, units, dict.fromkeys(columns, clock), started=data.started_utc)


def _plain(path: Path, file: h5py.File) -> ChannelTable:
    found: list[tuple[str, str, h5py.Dataset, str]] = []

    def take(name: str, node: h5py.Group | h5py.Dataset) -> None:
        if isinstance(node, h5py.Dataset) and node.size and node.ndim:
            columns = node.dtype.names or ("",)
            found.extend((name, column, node, column or name) for column in columns)

    file.visititems(take)
    short = Counter(name for *_, name in found)
    columns, clocks, unreadable = {}, {}, {}
    units: dict[str, str] = {}
    doubts: dict[str, str] = {}
    for path_in_file, column, node, name in found:
        name = name if short[name] == 1 else f"{path_in_file}/{column}"
        kind = node.dtype[column] if column else node.dtype
        if kind.kind not in "iuf":
            if kind.subdtype is not None:
                unreadable[name] = f"{name} holds {kind.shape} numbers a row, allowed one"
            continue
        if max(node.shape) != node.size:
            unreadable[name] = f"{name} is a table of {node.shape} numbers, allowed one dimension longer than 1"
            continue
        raw = (node[column] if column else node[()]).reshape(-1)
        columns[name], doubt = _apply_scale(raw, dict(_numbers(node)))
        stated, contradiction = _unit(node, column)
        units |= {name: stated} if stated else {}
        doubts |= {name: f"{name}: {doubt or contradiction}"} if doubt or contradiction else {}
        start = node.parent.get("starting_time") if path_in_file.split("/")[-1] == "data" else None
        if isinstance(start, h5py.Dataset) and (rate := dict(_numbers(start)).get("rate", 0.0)) > 0:
            clocks[name] = Clock(1.0 / rate, float(start[()]))
    if not columns:
        more = f"; {next(iter(unreadable.values()))}" if unreadable else ""
        raise RigInputError(f"{path}: no one-dimensional dataset of numbers{more}")
    return ChannelTable(str(path), columns, units, clocks, unreadable, doubts)


LARGEST_ATTRIBUTE = 10_000
"""Values of an attribute that are read; HDF5 itself allows 64 KB. A damaged size would take hours to read."""


def _small_attributes(node: h5py.Dataset) -> list[str]:
    """Return the names of the attributes that can be read at once."""
    return [key for key in node.attrs if np.prod(node.attrs.get_id(key).shape or (1,)) <= LARGEST_ATTRIBUTE]


def _numbers(node: h5py.Dataset) -> Iterator[tuple[str, float]]:
    """Yield the attributes of one number, also where it is written as text or as an array of one."""
    for key in _small_attributes(node):
        value = np.asarray(node.attrs[key])
        if value.size != 1 and _SCALE_NAMES.fullmatch(key.lower()) and value.dtype.kind in "iuf":
            yield key, np.nan  # one for each of something
        if value.size == 1:
            try:
                yield key, float(value.reshape(-1)[0])
            except (TypeError, ValueError):
                continue


def _apply_scale(raw: NDArray[np.generic], stated: dict[str, float]) -> tuple[NDArray[np.float64], str]:
    """Return the values with the scale the attributes state applied, and which of them is not known; else empty."""
    values = np.asarray(raw, dtype=np.float64)
    for key in MISSING:
        if key in stated:
            values = np.where(values == stated[key], np.nan, values)
    factors = {key: stated[key] for key in FACTORS if key in stated}
    offsets = {key: stated[key] for key in OFFSETS if key in stated}
    if len(set(factors.values())) > 1 or len(set(offsets.values())) > 1:
        return values, f"the attributes {factors | offsets} contradict each other"
    for key, value in stated.items():
        neutral = 0.0 if "offset" in key.lower() or "intercept" in key.lower() else 1.0
        if key not in (*FACTORS, *OFFSETS) and _SCALE_NAMES.fullmatch(key.lower()) and value != neutral:
            return values, (
                f"the attribute {key} = {value:g} may be a scale; name the channel in overrule_units of the mapping "
                "to take its numbers as they are"
            )
    factor, offset = next(iter(factors.values()), 1.0), next(iter(offsets.values()), 0.0)
    return (values if factor == 1.0 and offset == 0.0 else values * factor + offset), ""


def _unit(node: h5py.Dataset, column: str) -> tuple[str, str]:
    """Return the unit a dataset states for a column, and what is wrong with it; both empty where nothing is."""
    found = set()
    for key in _small_attributes(node):
        if key.lower() not in ("unit", "units"):
            continue
        cells = [c.decode("utf-8", "replace") if isinstance(c, bytes) else str(c) for c in np.ravel(node.attrs[key])]
        names = node.dtype.names or (column,)
        cells = cells[0].split(",") if len(cells) == 1 and len(names) > 1 else cells
        if len(cells) not in (1, len(names)):
            return "", f"{len(cells)} units for {len(names)} columns"
        unit = cells[names.index(column) if len(cells) > 1 else 0].strip()
        found |= {unit} if known(unit) else set()
    if len({known(unit) for unit in found}) > 1:
        return "", f"the attributes unit and units contradict each other: {sorted(found)}"
    return next(iter(found), ""), ""
