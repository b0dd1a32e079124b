"""One trial as an HDF5 file that netCDF-4 tools open: ``/daq`` on the sample clock, ``/camera`` on the frame clock.

Written once and sealed when a trial ends (before: `rig.session.journal_writer`). Every dataset carries its
unit and the SHA-256 of its bytes; the root carries the SHA-256 of all content, which identifies the trial in derived
results. HDF5's own bookkeeping, such as the attributes of dimension scales, is not in it: it covers only what is
written through :class:`Content`, in the order of names, whatever the order of writing. A truncated or altered file is
refused.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from rig import platform_calls
from rig.errors import RigInputError, refuse
from rig.session.converter_codes import NO_CODE, force_codes
from rig.session.info import NO_FORCE, ChannelInfo, EncoderInfo, ForceInfo
from rig.session.seal import CONTENT, array_sha256, file_state, open_sealed, write_sealed
from rig.session.trial_data import CameraInfo, TrialData


class Content:
    """What was written to one file, as digests."""

    def __init__(self) -> None:
        self._attributes: dict[str, dict[str, str]] = {}
        self._arrays: dict[str, str] = {}

    def describe(self, node: h5py.Group | h5py.Dataset, **attributes: Any) -> None:
        target, hashed = node.attrs, self._attributes.setdefault(_name(node), {})
        for key, value in attributes.items():
            target[key] = value
            hashed[key] = array_sha256(np.asarray(value))

    def dataset(self, group: h5py.Group, name: str, values: NDArray[Any], /, **attributes: Any) -> h5py.Dataset:
        dataset = group.create_dataset(name, data=values)
        self._arrays[_name(dataset)] = array_sha256(values)
        self.describe(dataset, **attributes)
        return dataset

    def quantity(self, group: h5py.Group, name: str, values: NDArray[Any], units: str, long_name: str) -> h5py.Dataset:
        dataset = self.dataset(group, name, values, units=units, long_name=long_name)
        self.close(dataset, self._arrays[_name(dataset)])
        return dataset

    def close(self, dataset: h5py.Dataset, sha256: str) -> None:
        """Take the digest of an array that is complete."""
        self._arrays[_name(dataset)] = sha256
        self.describe(dataset, sha256=sha256)

    def sha256(self) -> str:
        """Return the SHA-256 over all attributes and arrays written through this object, the same as `content_sha256`
        of the file."""
        digest = hashlib.sha256()
        for name in sorted(self._attributes):  # the file itself, "/", comes first
            digest.update(name.encode() + b"\0")
            for key, hashed in sorted(self._attributes[name].items()):
                digest.update(f"{key}={hashed}\0".encode())
            digest.update(self._arrays.get(name, "").encode())
        return digest.hexdigest()


def _name(node: h5py.Group | h5py.Dataset) -> str:
    return node.name.lstrip("/") or "/"


SCHEMA = "piano-action-rig trial 1"
LATER = ("device_scaling",)
"""Attributes of the force that older files do not have."""
STATUSES = ("complete", "not at rest", "interrupted", "fault", "defect", "incomplete")


def write_trial(path: Path, data: TrialData) -> str:
    """Write and seal one trial; return its seal (SHA-256). An existing file is never replaced."""
    return write_trial_parts(path, data, data.n_valid, (data,))


def write_trial_parts(path: Path, about: TrialData, n_samples: int, parts: Iterable[TrialData]) -> str:
    """Write and seal a new trial file, its arrays from successive ``parts`` of ``n_samples`` in all, everything else
    from ``about``; return the SHA-256 of its content. RigInputError where ``path`` exists; the file is read-only
    afterwards."""
    if path.exists():
        raise RigInputError(f"{path}: exists already; a sealed trial is never replaced")
    _check_shapes(path, about)
    content = Content()
    with write_sealed(path) as file:
        content.describe(
            file,
            schema=SCHEMA,
            Conventions="SI units; time zero is the AI start trigger",
            trial=about.number,
            started_utc=about.started_utc,
            simulated=int(about.simulated),
            blow_start_s=about.blow_start_s,
            condition=about.condition,
            plan_entry=about.plan_entry,
        )
        _write_daq(content, file.create_group("daq", track_order=True), about, n_samples, parts)
        if about.provenance:
            content.describe(file.create_group("provenance", track_order=True), **about.provenance)
        if about.camera is not None:
            _write_camera(content, file.create_group("camera", track_order=True), about.camera)
        digest = content.sha256()
        file.attrs[CONTENT] = digest
    platform_calls.make_read_only(path)
    return digest


def read_trial(path: Path) -> TrialData:
    with open_sealed(path) as file:
        if file.attrs.get("schema") != SCHEMA:
            found = file.attrs.get("schema")
            raise RigInputError(f"{path}: schema {found!r}, expected {SCHEMA!r}; not a trial of this rig")
        return _read_open_trial(path, file, str(file.attrs[CONTENT]))


def trial_problem(path: Path) -> str:
    """Why `read_trial` refuses a file, in one line; empty where it reads it. A file found right is not read again until
    it changes."""
    try:
        state = file_state(path)
        if state in _stated_number:
            return ""
        number = read_trial(path).number
    except RigInputError as error:
        return str(error)
    except OSError as error:
        return f"{path}: cannot be read ({error.strerror or error})"
    _stated_number[state] = number
    return ""


_stated_number: dict[tuple[str, int, int, int], int] = {}
"""Number that a trial which can be read states itself, by path and state of its file."""


def copied_trial(path: Path, number: int) -> str:
    """Return the name of the trial beside a readable one that it is a copy of; empty for a trial of its own."""
    stated = _stated_number.get(file_state(path), number)
    original = path.with_name(f"trial_{stated:04d}.h5")
    if stated == number or not original.is_file() or trial_problem(original):
        return ""
    return original.name if read_status(original) == read_status(path) else ""


def read_status(path: Path) -> tuple[str, str]:
    """Return (status, SHA-256 of the content) of a trial without reading its arrays."""
    with open_sealed(path) as file:
        return str(file["daq"].attrs["status"]), str(file.attrs[CONTENT])


def read_condition(path: Path) -> str:
    with open_sealed(path) as file:
        return str(file.attrs.get("condition", ""))


def _check_shapes(path: Path, data: TrialData) -> None:
    """Raise RigInputError where the arrays of a trial differ in length, encoder counts are not integers, or the status
    is not allowed; ``path`` is for the message."""
    n = data.time_s.shape[0]
    shapes = {
        "force_n": (data.raw_force_n.shape, (n,)),
        "force_raw": (data.force_raw.shape, (n,)),
        "motor_command_v": (data.motor_command_v.shape, (n,)),
        "encoder_count": (data.encoder_count.shape, (n, len(data.encoders))),
    }
    values = data.channel_values
    shapes["channel_values"] = (values.shape if values is not None else (n, 0), (n, len(data.channels)))
    for name, (found, wanted) in shapes.items():
        if found != wanted:
            raise RigInputError(f"{path}: {name} has shape {found}, expected {wanted}")
    refuse(
        RigInputError,
        (
            not np.issubdtype(data.encoder_count.dtype, np.integer),
            f"{path}: encoder_count is {data.encoder_count.dtype}, expected integers",
        ),
        (data.status not in STATUSES, f"{path}: status {data.status!r}, allowed {', '.join(STATUSES)}"),
    )


Column = tuple[str, str, str, str, Callable[[TrialData], NDArray[Any]], dict[str, Any]]
"""A dataset on the sample clock: name, type, unit, what it is, its rows in a part of the trial, further attributes."""


def _list_columns(about: TrialData) -> list[Column]:
    """Columns of a trial's file, each as (name, stored type, unit, meaning, function from a part of the trial to its
    rows, attributes): the time first; force only where recorded."""
    info, encoders = about.force_info, about.encoders
    of_time = {"sample_rate_hz": about.sample_rate_hz}
    found: list[Column] = [("time", "<f8", "s", "time since the AI start trigger", lambda part: part.time_s, of_time)]
    if about.has_force:
        meaning = "force on the key, positive downwards, calibrated, not corrected for offset, delay or hum"
        of_reading = {"channel": info.channel}
        found += [
            ("force", "<f8", "N", meaning, lambda part: part.raw_force_n, _attributes(info)),
            ("force_raw", "<f8", info.electrical_unit, "electrical reading of the force channel",
             lambda part: part.force_raw, of_reading),
        ]  # fmt: skip
    of_counts = {
        "encoders_json": json.dumps([asdict(encoder) for encoder in encoders]),
        "counts_per_revolution": np.array([e.counts_per_revolution for e in encoders], dtype=np.int64),
        "sign": np.array([e.sign for e in encoders], dtype=np.int64),
    }
    meaning = "motor command held from each sample to the next"
    found += [
        ("motor_command", "<f8", "V", meaning, lambda part: part.motor_command_v, {}),
        ("encoder_count", "<i8", "1", "encoder counts since arming (X4)", lambda part: part.encoder_count, of_counts),
    ]
    for k, channel in enumerate(about.channels):
        rest = _attributes(channel)
        if (ruler := rest.pop("ruler")) is not None:
            rest["ruler_json"] = json.dumps(ruler)
        name, unit, quantity = (rest.pop(key) for key in ("name", "unit", "quantity"))
        found.append((name, "<f8", unit, quantity, partial(_further_channels, k), rest))
    if info.device_scaling:  # else the driver's scaling is not known
        meaning = "code of the converter behind the force, by the driver's scaling device_scaling"
        codes = {"no_code": NO_CODE}
        found.append(("force_code", "<i4", "1", meaning, lambda part: force_codes(part.force_raw, info), codes))
    return found


def _further_channels(k: int, part: TrialData) -> NDArray[np.float64]:
    assert part.channel_values is not None
    return part.channel_values[:, k]


def _write_daq(
    content: Content, group: h5py.Group, about: TrialData, n_samples: int, parts: Iterable[TrialData]
) -> None:
    """Write the recorded columns, ``n_samples`` rows in all, part after part into ``group``, each with its unit,
    meaning and SHA-256; ValueError for another number of rows."""
    content.describe(
        group, sample_rate_hz=about.sample_rate_hz, n_valid=n_samples, status=about.status, reason=about.reason
    )
    if about.channels:
        content.describe(group, channels_json=json.dumps([asdict(channel) for channel in about.channels]))
    names = np.array([encoder.name for encoder in about.encoders], dtype=h5py.string_dtype("utf-8"))
    encoder_axis = content.dataset(group, "encoder", names, long_name="body the encoder reads")
    encoder_axis.make_scale("encoder")
    made = []
    for name, dtype, units, long_name, rows_of, attributes in _list_columns(about):
        dataset = group.create_dataset(name, (n_samples, *rows_of(about).shape[1:]), dtype=dtype)
        content.describe(dataset, units=units, long_name=long_name, **attributes)
        made.append((dataset, rows_of, hashlib.sha256()))
    end = 0
    for part in parts:
        first, end = end, end + part.n_valid
        for dataset, rows_of, digest in made:
            rows = np.ascontiguousarray(rows_of(part), dtype=dataset.dtype)
            if rows.size:
                dataset[first:end] = rows
                digest.update(rows.tobytes())
    if end != n_samples:
        raise ValueError(f"{group.file.filename}: {end} rows, expected {n_samples}")
    time = made[0][0]
    time.make_scale("time")
    for dataset, _, digest in made:
        content.close(dataset, digest.hexdigest())
        if dataset != time:
            dataset.dims[0].attach_scale(time)
    group["encoder_count"].dims[1].attach_scale(encoder_axis)


def _attributes(info: ForceInfo | ChannelInfo) -> dict[str, Any]:
    plain = {key: np.array(value) if isinstance(value, tuple) else value for key, value in asdict(info).items()}
    return {key: value for key, value in plain.items() if not isinstance(value, np.ndarray) or value.size}


def _write_camera(content: Content, group: h5py.Group, camera: CameraInfo) -> None:
    """Write the camera's data, the middles of its exposures (s) and frame numbers from 0 into ``group`` through
    ``content``, which keeps their digests."""
    content.describe(group, **asdict(camera))
    time = content.quantity(
        group, "time", camera.frame_time_s, "s", "middle of each exposure since the AI start trigger"
    )
    time.make_scale("time")
    number = np.arange(camera.n_frames, dtype=np.int64)
    index = content.quantity(group, "frame", number, "1", "frame number in the film, from 0")
    index.dims[0].attach_scale(time)


def _unwrap_numpy(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return tuple(float(item) for item in value)
    return value.item() if isinstance(value, np.generic) else value


UNITS = {"time": "s", "force": "N", "motor_command": "V", "encoder_count": "1"}


def _read_open_trial(path: Path, file: h5py.File, sha256: str) -> TrialData:
    """Read the whole trial from an open file, whose digest is ``sha256``; forces are NaN where none was recorded;
    RigInputError where a column's unit is not the one trials are stored in."""
    daq = file["daq"]
    for name, expected in UNITS.items():
        if name == "force" and name not in daq:
            continue  # a trial of positions alone
        units = daq[name].attrs.get("units")
        if units != expected:
            raise RigInputError(
                f"{path}: daq/{name}: units {'missing' if units is None else repr(str(units))}, expected "
                f"{expected!r}; write the trial again in SI units"
            )
    info = NO_FORCE
    missing = np.full(daq["time"].shape, np.nan)
    if "force" in daq:
        force = daq["force"]
        stated = [field for field in ForceInfo.__dataclass_fields__ if field in force.attrs or field not in LATER]
        info = ForceInfo(**{field: _unwrap_numpy(force.attrs[field]) for field in stated})
    encoders = tuple(EncoderInfo(**entry) for entry in json.loads(daq["encoder_count"].attrs["encoders_json"]))
    channels = tuple(ChannelInfo.from_plain(entry) for entry in json.loads(daq.attrs.get("channels_json", "[]")))
    camera = None
    if "camera" in file:
        attributes = file["camera"].attrs
        camera = CameraInfo(**{field: _unwrap_numpy(attributes[field]) for field in CameraInfo.__dataclass_fields__})
    return TrialData(
        number=int(file.attrs["trial"]),
        status=str(daq.attrs["status"]),
        reason=str(daq.attrs["reason"]),
        started_utc=str(file.attrs["started_utc"]),
        simulated=bool(file.attrs["simulated"]),
        blow_start_s=float(file.attrs["blow_start_s"]),
        condition=str(file.attrs.get("condition", "")),
        plan_entry=int(file.attrs.get("plan_entry", 0)),
        sample_rate_hz=float(daq.attrs["sample_rate_hz"]),
        time_s=daq["time"][()],
        raw_force_n=daq["force"][()] if "force" in daq else missing,
        force_raw=daq["force_raw"][()] if "force" in daq else missing,
        motor_command_v=daq["motor_command"][()],
        encoder_count=daq["encoder_count"][()],
        encoders=encoders,
        force_info=info,
        camera=camera,
        sha256=sha256,
        channels=channels,
        provenance={key: str(value) for key, value in file["provenance"].attrs.items()} if "provenance" in file else {},
        channel_values=np.column_stack([daq[channel.name][()] for channel in channels]) if channels else None,
    )
