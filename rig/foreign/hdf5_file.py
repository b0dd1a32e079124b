"""HDF5: a sealed trial of a session, or any file with one-dimensional datasets of numbers (``name``, ``group/name``).

A trial gives ``force_n`` (less its mean before the blow), ``motor_command_v`` and the angles in rad; its seal is
checked first. Other files carry no checksum: what the HDF5 library cannot read is refused. A dataset's attribute
``units`` is its unit.
"""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np

from rig.errors import RigInputError
from rig.foreign.channel_table import ChannelTable, Clock
from rig.session.trial_file import SCHEMA, read_trial


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
    columns, units = {}, {}

    def take(name: str, node: h5py.Group | h5py.Dataset) -> None:
        if isinstance(node, h5py.Dataset) and node.ndim == 1 and node.dtype.kind in "iuf" and node.size:
            columns[name] = np.asarray(node[()], dtype=np.float64)
            stated = node.attrs.get("units", b"")
            units[name] = stated.decode("utf-8", "replace") if isinstance(stated, bytes) else str(stated)

    file.visititems(take)
    if not columns:
        raise RigInputError(f"{path}: no one-dimensional dataset of numbers")
    return ChannelTable(str(path), columns, {name: unit for name, unit in units.items() if unit})
