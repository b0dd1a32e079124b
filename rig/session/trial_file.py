"""One trial as an HDF5 file that netCDF-4 tools open: ``/daq`` on the sample clock, ``/camera`` on the frame clock.

Written once and sealed when a trial ends. Every dataset carries its unit and the SHA-256 of its bytes; the root carries
the SHA-256 of all content, which identifies the trial in derived results. A truncated or altered file is refused.
"""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from rig.errors import RigInputError
from rig.session.hdf5_content import Content
from rig.session.sealed_hdf5 import open_sealed, write_sealed
from rig.session.trial_data import CameraInfo, ChannelInfo, EncoderInfo, ForceInfo, TrialData

SCHEMA = "piano-action-rig trial 1"
STATUSES = ("complete", "not at rest", "interrupted", "fault", "incomplete")


def write_trial(path: Path, data: TrialData) -> str:
    """Write and seal one trial; return its seal (SHA-256). An existing file is never replaced."""
    if path.exists():
        raise RigInputError(f"{path}: exists already; a sealed trial is never replaced")
    _check_shapes(path, data)
    content = Content()
    with write_sealed(path) as file:
        _write_root(content, file, data)
        _write_daq(content, file.create_group("daq", track_order=True), data)
        if data.camera is not None:
            _write_camera(content, file.create_group("camera", track_order=True), data.camera)
        digest = content.sha256()
        file.attrs["sha256"] = digest
    return digest


def read_trial(path: Path) -> TrialData:
    """Read one trial after checking its seal.

    Raises RigInputError when the file is missing, truncated, of another kind, or altered since it was sealed.
    """
    with open_sealed(path) as file:
        if file.attrs.get("schema") != SCHEMA:
            found = file.attrs.get("schema")
            raise RigInputError(f"{path}: schema {found!r}, expected {SCHEMA!r}; not a trial of this rig")
        return _read(file, str(file.attrs["sha256"]))


def read_status(path: Path) -> tuple[str, str]:
    """Return (status, SHA-256 of the content) of a trial without reading its arrays."""
    with open_sealed(path) as file:
        return str(file["daq"].attrs["status"]), str(file.attrs["sha256"])


def _check_shapes(path: Path, data: TrialData) -> None:
    n = data.time_s.shape[0]
    shapes = {
        "force_n": (data.force_n.shape, (n,)),
        "force_raw": (data.force_raw.shape, (n,)),
        "motor_command_v": (data.motor_command_v.shape, (n,)),
        "encoder_count": (data.encoder_count.shape, (n, len(data.encoders))),
    }
    values = data.channel_values
    shapes["channel_values"] = (values.shape if values is not None else (n, 0), (n, len(data.channels)))
    for name, (found, wanted) in shapes.items():
        if found != wanted:
            raise RigInputError(f"{path}: {name} has shape {found}, expected {wanted}")
    if not np.issubdtype(data.encoder_count.dtype, np.integer):
        raise RigInputError(f"{path}: encoder_count is {data.encoder_count.dtype}, expected integers")
    if data.status not in STATUSES:
        raise RigInputError(f"{path}: status {data.status!r}, allowed {', '.join(STATUSES)}")


def _write_root(content: Content, file: h5py.File, data: TrialData) -> None:
    content.describe(
        file,
        schema=SCHEMA,
        Conventions="SI units; time zero is the AI start trigger",
        trial=data.number,
        started_utc=data.started_utc,
        simulated=int(data.simulated),
        blow_start_s=data.blow_start_s,
        condition=data.condition,
        plan_entry=data.plan_entry,
    )


def _write_daq(content: Content, group: h5py.Group, data: TrialData) -> None:
    rate, info = data.sample_rate_hz, data.force_info
    content.describe(group, sample_rate_hz=rate, n_valid=data.n_valid, status=data.status, reason=data.reason)
    time = content.quantity(
        group, "time", data.time_s, "s", "time since the AI start trigger", sample_rate_hz=data.sample_rate_hz
    )
    time.make_scale("time")
    names = np.array([encoder.name for encoder in data.encoders], dtype=h5py.string_dtype("utf-8"))
    encoder_axis = content.dataset(group, "encoder", names, long_name="body the encoder reads")
    encoder_axis.make_scale("encoder")
    force = content.quantity(
        group,
        "force",
        data.force_n,
        "N",
        "force on the key, positive downwards, calibrated, not corrected for offset, delay or hum",
        **_attributes(info),
    )
    raw = content.quantity(
        group,
        "force_raw",
        data.force_raw,
        info.electrical_unit,
        "electrical reading of the force channel",
        channel=info.channel,
    )
    motor = content.quantity(
        group, "motor_command", data.motor_command_v, "V", "motor command held from each sample to the next"
    )
    count = content.quantity(
        group,
        "encoder_count",
        data.encoder_count.astype(np.int64),
        "1",
        "encoder counts since arming (X4)",
        encoders_json=json.dumps([asdict(encoder) for encoder in data.encoders]),
        counts_per_revolution=np.array([e.counts_per_revolution for e in data.encoders], dtype=np.int64),
        sign=np.array([e.sign for e in data.encoders], dtype=np.int64),
    )
    further = _write_channels(content, group, data)
    for dataset in (force, raw, motor, count, *further):
        dataset.dims[0].attach_scale(time)
    count.dims[1].attach_scale(encoder_axis)


def _write_channels(content: Content, group: h5py.Group, data: TrialData) -> list[h5py.Dataset]:
    """Write the further channels, one dataset each; nothing where there are none."""
    if data.channel_values is None:
        return []
    content.describe(group, channels_json=json.dumps([asdict(channel) for channel in data.channels]))
    made = []
    for channel, values in zip(data.channels, data.channel_values.T, strict=True):
        rest = _attributes(channel)
        made.append(content.quantity(group, rest.pop("name"), values, rest.pop("unit"), rest.pop("quantity"), **rest))
    return made


def _attributes(info: ForceInfo | ChannelInfo) -> dict[str, Any]:
    return {key: np.array(value) if isinstance(value, tuple) else value for key, value in asdict(info).items()}


def _write_camera(content: Content, group: h5py.Group, camera: CameraInfo) -> None:
    content.describe(group, **asdict(camera))
    time = content.quantity(
        group, "time", camera.frame_time_s, "s", "middle of each exposure since the AI start trigger"
    )
    time.make_scale("time")
    number = np.arange(camera.n_frames, dtype=np.int64)
    index = content.quantity(group, "frame", number, "1", "frame number in the film, from 0")
    index.dims[0].attach_scale(time)


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return tuple(float(item) for item in value)
    return value.item() if isinstance(value, np.generic) else value


UNITS = {"time": "s", "force": "N", "motor_command": "V", "encoder_count": "1"}


def _check_units(file: h5py.File) -> None:
    for name, expected in UNITS.items():
        found = file["daq"][name].attrs.get("units")
        if found != expected:
            raise RigInputError(
                f"{file.filename}: daq/{name}: units {'missing' if found is None else repr(str(found))}, expected "
                f"{expected!r}; write the trial again in SI units"
            )


def _read(file: h5py.File, sha256: str) -> TrialData:
    _check_units(file)
    daq = file["daq"]
    force = daq["force"]
    info = ForceInfo(**{field: _plain(force.attrs[field]) for field in ForceInfo.__dataclass_fields__})
    encoders = tuple(EncoderInfo(**entry) for entry in json.loads(daq["encoder_count"].attrs["encoders_json"]))
    channels = tuple(ChannelInfo.from_plain(entry) for entry in json.loads(daq.attrs.get("channels_json", "[]")))
    camera = None
    if "camera" in file:
        attributes = file["camera"].attrs
        camera = CameraInfo(**{field: _plain(attributes[field]) for field in CameraInfo.__dataclass_fields__})
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
        force_n=force[()],
        force_raw=daq["force_raw"][()],
        motor_command_v=daq["motor_command"][()],
        encoder_count=daq["encoder_count"][()],
        encoders=encoders,
        force_info=info,
        camera=camera,
        sha256=sha256,
        channels=channels,
        channel_values=np.column_stack([daq[channel.name][()] for channel in channels]) if channels else None,
    )
