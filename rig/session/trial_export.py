"""A sealed trial as a file of another program: CSV, MATLAB, TDMS or Parquet, each column with its unit and meaning."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.atomic_write import replace_when_complete, write_text
from rig.errors import RigInputError
from rig.session.trial_data import TrialData


@dataclass(frozen=True, eq=False)
class Column:
    """One column: name, unit (``1`` for counts), what it is, values (n,)."""

    name: str
    unit: str
    meaning: str
    values: NDArray[Any]


def list_columns(data: TrialData) -> list[Column]:
    """Columns to export, each with name, unit, meaning and values (n,): time, forces, command, counts and angles of
    each encoder, further channels, displacements with uncertainty and flag."""
    found = [
        Column("time_s", "s", "time since the AI start trigger", data.time_s),
        Column("motor_command_v", "V", "motor command, held from each sample to the next", data.motor_command_v),
    ]
    if data.has_force:
        unit = data.force_info.electrical_unit
        corrected = "force on the key as it acted, positive downwards; nan where it cannot be corrected"
        reading = "the same as it was read, not corrected for offset, delay or hum"
        found[1:1] = [
            Column("force_n", "N", corrected, data["force_n"]),
            Column("raw_force_n", "N", reading, data.raw_force_n),
            Column("force_raw", unit, "electrical reading of the force channel", data.force_raw),
        ]
    angle_rad = data.angle_rad
    for k, encoder in enumerate(data.encoders):
        body = encoder.name
        found.append(Column(f"{body}_count", "1", f"counts of the {body}'s encoder (X4)", data.encoder_count[:, k]))
        meaning = f"angle of the {body} since the first sample, counter-clockwise"
        found.append(Column(f"{body}_rad", "rad", meaning, angle_rad[:, k]))
    if data.channel_values is not None:
        for k, channel in enumerate(data.channels):
            found.append(Column(channel.name, channel.unit, channel.quantity, data.channel_values[:, k]))
    for name in data.position_names:
        at = data.position(name)
        meaning = f"displacement at: {at.ruler.calibrated_at}; sensor at: {at.ruler.sensor_at}"
        found.append(Column(f"{name}_m", "m", meaning, at.displacement_m))
        found.append(Column(f"{name}_u_m", "m", f"standard uncertainty of {name}_m", at.u_m))
        found.append(Column(f"{name}_flag", "1", "1: below the ruler, 2: above it, 0: on it", at.flag))
    return found


def trial_facts(data: TrialData) -> dict[str, str | int | float]:
    """What the file says of the trial but its arrays, by name: number, status, times, digest; descriptions of its
    channels as JSON text."""
    return {
        "trial": data.number,
        "status": data.status,
        "reason": data.reason,
        "started_utc": data.started_utc,
        "simulated": int(data.simulated),
        "sample_rate_hz": data.sample_rate_hz,
        "blow_start_s": data.blow_start_s,
        "condition": data.condition,
        "sha256_of_trial": data.sha256,
        "force_info": json.dumps(asdict(data.force_info)),
        "encoders": json.dumps([asdict(encoder) for encoder in data.encoders]),
        "channels": json.dumps([asdict(channel) for channel in data.channels]),
    }


def export_trial(data: TrialData, path: Path) -> list[Path]:
    """Write a trial as ``.csv`` (with ``…-metadata.json`` beside it), ``.mat``, ``.tdms`` or ``.parquet`` by the ending
    of ``path``, never over a file that exists; return the files written."""
    write = _WRITERS.get(path.suffix)
    if write is None:
        raise RigInputError(f"{path}: ending found {path.suffix!r}, allowed {', '.join(_WRITERS)}")
    beside = path.with_name(f"{path.name}-metadata.json")
    for file in (path, beside) if path.suffix == ".csv" else (path,):
        if file.exists():
            raise RigInputError(f"{file}: exists already; delete it, or export into another folder")
    write(path, list_columns(data), trial_facts(data))
    return [path, beside] if path.suffix == ".csv" else [path]


Facts = dict[str, str | int | float]


def write_csv(path: Path, table: list[Column], facts: Facts) -> None:
    """Write columns (n,) as CSV that reads back to the same numbers, and ``<path>-metadata.json`` (CSVW) with their
    units, meanings and ``facts``; existing files are replaced."""
    with replace_when_complete(path) as part, part.open("w", encoding="utf-8", newline="\n") as stream:
        stream.write(",".join(column.name for column in table) + "\n")
        for row in zip(*(column.values.tolist() for column in table), strict=True):
            stream.write(",".join(map(repr, row)) + "\n")
    beside = path.with_name(f"{path.name}-metadata.json")
    described = [
        {
            "name": column.name,
            "datatype": "integer" if column.values.dtype.kind == "i" else "double",
            "schema:unitText": column.unit,
            "dc:description": column.meaning,
        }
        for column in table
    ]
    metadata = {
        "@context": "http://www.w3.org/ns/csvw",
        "url": path.name,
        "tableSchema": {"columns": described},
        "notes": [facts],
    }
    write_text(beside, json.dumps(metadata, indent=1) + "\n")


def _write_mat(path: Path, table: list[Column], facts: Facts) -> None:
    """Write a MATLAB file (version 5): a variable (n, 1) for each column, and structs ``units``, ``meanings`` (text by
    column) and ``about`` (``facts``)."""
    from scipy.io import savemat  # start-up: 0.2 s that only a MATLAB file needs

    content = {
        **{column.name: column.values[:, None] for column in table},
        "units": {column.name: column.unit for column in table},
        "meanings": {column.name: column.meaning for column in table},
        "about": facts,
    }
    with replace_when_complete(path) as part, part.open("wb") as stream:
        savemat(stream, content, long_field_names=True, do_compression=True)


def _write_tdms(path: Path, table: list[Column], facts: Facts) -> None:
    """Write a TDMS file: a channel of the group ``daq`` for each column, with unit, meaning and sample interval;
    ``facts`` as properties of the file; RigInputError without npTDMS."""
    try:
        from nptdms import ChannelObject, GroupObject, RootObject, TdmsWriter  # start-up: an optional package
    except ImportError:
        raise RigInputError(f"{path}: writing TDMS needs npTDMS; pip install 'piano-action-rig[tdms]'") from None
    interval = {"wf_increment": 1.0 / float(facts["sample_rate_hz"]), "wf_start_offset": 0.0}
    channels = [
        ChannelObject(
            "daq",
            column.name,
            column.values,
            {"unit_string": column.unit, "NI_ChannelName": column.name, "description": column.meaning, **interval},
        )
        for column in table
    ]
    with replace_when_complete(path) as part, part.open("wb") as stream, TdmsWriter(stream) as writer:
        writer.write_segment([RootObject(facts), GroupObject("daq"), *channels])


def _write_parquet(path: Path, table: list[Column], facts: Facts) -> None:
    """Write a Parquet file: a column for each, with unit and meaning as its metadata, and ``facts`` as text in those of
    the table; RigInputError without pyarrow."""
    try:
        import pyarrow as arrow  # start-up: an optional package
        from pyarrow import parquet  # start-up: an optional package
    except ImportError:
        raise RigInputError(f"{path}: writing Parquet needs pyarrow; pip install 'piano-action-rig[parquet]'") from None
    fields = [
        arrow.field(c.name, arrow.from_numpy_dtype(c.values.dtype), metadata={"unit": c.unit, "meaning": c.meaning})
        for c in table
    ]
    schema = arrow.schema(fields, metadata={name: str(value) for name, value in facts.items()})
    with replace_when_complete(path) as part:
        parquet.write_table(arrow.table([np.ascontiguousarray(c.values) for c in table], schema=schema), part)


_WRITERS: dict[str, Callable[[Path, list[Column], Facts], None]] = {
    ".csv": write_csv,
    ".mat": _write_mat,
    ".tdms": _write_tdms,
    ".parquet": _write_parquet,
}
FORMATS = tuple(suffix[1:] for suffix in _WRITERS)
