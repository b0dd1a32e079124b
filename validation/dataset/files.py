"""One trial of the data set as a netCDF-4 file with CF-style attributes, written and read with h5py alone.

Two clocks, two dimensions: ``time`` of force, command and encoders, ``film_time`` of the angles from film. Time zero is
the start of the recording. Strings and numbers are attributes of the file, none of it tells what the specimen is.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from validation.errors import ValidationInputError

Array = NDArray[np.float64]

CONVENTIONS = "CF-1.11"
CHANNELS = {
    "force": ("time", "N", "force of the motor's arm on the front of the key, positive downwards"),
    "motor_command": ("time", "V", "command of the motor, held from each sample to the next"),
    "key_angle": ("time", "rad", "angle of the key since the first sample, counter-clockwise"),
    "whippen_angle": ("time", "rad", "angle of the whippen since the first sample, counter-clockwise"),
    "hammer_angle": ("time", "rad", "angle of the hammer since the first sample, counter-clockwise"),
    "jack_angle": ("film_time", "rad", "angle of the jack relative to the whippen since the first frame, from film"),
    "repetition_angle": (
        "film_time", "rad", "angle of the repetition lever relative to the whippen since the first frame, from film"
    ),
}  # fmt: skip
"""Dimension, unit and meaning of each variable."""
CLOCKS = {
    "time": "time since the start of the recording",
    "film_time": "middle of the exposure of each frame, on the clock of the force",
}


@dataclass(frozen=True, eq=False)
class DataTrial:
    """A trial: times (n,), (k,) s, channels by name, standard uncertainties by name, and facts.

    ``facts`` has at least ``trial``, ``specimen``, ``condition``, ``part`` (train or test).
    """

    time_s: Array
    film_time_s: Array
    values: dict[str, Array]
    u: dict[str, float]
    facts: dict[str, Any] = field(default_factory=dict)


def write_netcdf(path: Path, trial: DataTrial) -> None:
    """Write a trial."""
    with h5py.File(path, "w", track_order=True) as file:
        file.attrs["Conventions"] = CONVENTIONS
        for key, value in trial.facts.items():
            file.attrs[key] = value
        scales = {}
        for name, times in (("time", trial.time_s), ("film_time", trial.film_time_s)):
            scale = file.create_dataset(name, data=times, compression="gzip", shuffle=True)
            scale.make_scale(name)
            scale.attrs["units"] = "s"
            scale.attrs["long_name"] = CLOCKS[name]
            if name == "film_time":
                scale.attrs["standard_uncertainty"] = trial.u["film_time"]
            scales[name] = scale
        for name, (clock, unit, meaning) in CHANNELS.items():
            data = file.create_dataset(
                name, data=trial.values[name].astype("<f4"), compression="gzip", shuffle=True, fletcher32=True
            )
            data.attrs["units"] = unit
            data.attrs["long_name"] = meaning
            data.attrs["standard_uncertainty"] = trial.u[name]
            data.dims[0].attach_scale(scales[clock])


def read_netcdf(path: Path) -> DataTrial:
    """Read a trial.

    Raises
    ------
    ValidationInputError
        The file is missing, damaged or no trial of a data set.
    """
    try:
        with h5py.File(path, "r") as file:
            values = {name: np.asarray(file[name][()], dtype=np.float64) for name in CHANNELS}
            u = {name: float(file[name].attrs["standard_uncertainty"]) for name in CHANNELS}
            u["film_time"] = float(file["film_time"].attrs["standard_uncertainty"])
            facts = {key: value.item() if hasattr(value, "item") else value for key, value in file.attrs.items()}
            return DataTrial(file["time"][()], file["film_time"][()], values, u, facts)
    except (OSError, KeyError) as error:
        reason = str(error).splitlines()[0]
        raise ValidationInputError(f"{path}: not a trial of a data set ({reason}); fetch it again") from None
