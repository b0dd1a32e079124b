"""HDF5: a sealed trial of a session, or any file with one-dimensional numeric datasets at its root.

A trial gives ``force_n`` (less its mean before the blow), ``motor_command_v`` and the angles in rad; its seal is
checked first. Other files carry no checksum: what the HDF5 library cannot read is refused.
"""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np

from rig.errors import InputError
from rig.foreign.channel_table import ChannelTable
from rig.session.trial_file import SCHEMA, read_trial


def read_hdf5(path: Path) -> ChannelTable:
    """Read the channels of a trial or of a plain HDF5 file.

    Raises
    ------
    InputError
        When the file cannot be read or holds no numbers at its root.
    """
    try:
        with h5py.File(path, "r") as file:
            if file.attrs.get("schema") != SCHEMA:
                columns = {
                    name: np.asarray(node[()], dtype=np.float64)
                    for name, node in file.items()
                    if isinstance(node, h5py.Dataset) and node.ndim == 1 and node.dtype.kind in "iuf"
                }
                return _checked(path, columns)
    except InputError:
        raise
    except (OSError, RuntimeError, ValueError, TypeError, KeyError) as error:
        raise InputError(f"{path}: not a readable HDF5 file ({' '.join(str(error).split())[:120]})") from None
    data = read_trial(path)
    before = data.time_s < data.blow_start_s
    baseline_n = float(data.force_n[before].mean()) if before.any() else 0.0
    angles = {f"{e.name}_rad": data.angle_rad()[:, i] for i, e in enumerate(data.encoders)}
    columns = {
        "time_s": data.time_s,
        "force_n": data.force_n - baseline_n,
        "motor_command_v": data.motor_command_v,
        **angles,
    }
    return ChannelTable(str(path), columns, {"time_s": "s", "force_n": "N"}, 1.0 / data.sample_rate_hz)


def _checked(path: Path, columns: dict[str, np.ndarray]) -> ChannelTable:
    sizes = {values.size for values in columns.values()}
    if len(sizes) != 1 or 0 in sizes:
        found = ", ".join(f"{name} ({values.size})" for name, values in columns.items()) or "none"
        raise InputError(f"{path}: datasets of numbers at the root: {found}; allowed some of one equal length")
    return ChannelTable(str(path), columns)
