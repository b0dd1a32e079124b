"""The tidy curves in a file: netCDF-4 for xarray, NCO, MATLAB and `read_curves`; Parquet through the extra ``parquet``.

Conventions: dimensions trial, channel, time; the time base is a dimension scale, so that xarray opens it with
coordinates; 32-bit numbers, compressed (a relative step of 6e-8, a thousandth of an encoder's count); attributes
``units`` and ``long_name``.
"""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pandas as pd

from validation.conventions import BODIES, Array
from validation.curves.table import COLUMNS, VALUES, force_on_base, left_out_on_base, trial_curves
from validation.errors import ValidationInputError

SCHEMA = "piano-action-rig curves 1"
WORDS = {
    "measured_rad": "measured change of angle since rest, counter-clockwise",
    "predicted_rad": "predicted change of angle since rest, counter-clockwise",
    "null_rad": "change of angle since rest predicted by the null model",
    "u_rad": "standard uncertainty of the measured angle, of the film",
    "left_out": "1 where the sample is left out of the scores",
    "force_n": "force at the key front, corrected, positive downwards",
}


def curves_netcdf(
    base_s: Array, traces: Mapping[int, pd.DataFrame], films: Mapping[int, pd.DataFrame], about: Mapping[str, str]
) -> bytes:
    """The curves of a result as the bytes of a netCDF-4 file.

    Parameters
    ----------
    base_s : (n,) s
    traces, films : mapping of trial to DataFrame
    about : mapping
        Attributes of the file, as the names of session and model.
    """
    buffer = io.BytesIO()
    with h5py.File(buffer, "w", track_order=True) as file:
        file.attrs.update({"schema": SCHEMA, "Conventions": "CF-1.10", **about})
        scales = {
            "trial": np.array(list(traces), dtype=np.int32),
            "channel": np.array(BODIES, dtype=h5py.string_dtype()),
            "time": np.asarray(base_s, dtype=float),
        }
        for name, values in scales.items():
            file.create_dataset(name, data=values).make_scale(name)
        file["time"].attrs.update({"units": "s", "long_name": "time since the start trigger"})
        shape = (len(traces), len(BODIES), base_s.size)
        for name in (*VALUES, "left_out"):
            _make(file, name, ("trial", "channel", "time"), shape)
        _make(file, "force_n", ("trial", "time"), (shape[0], shape[2]))
        for i, (trial, frame) in enumerate(traces.items()):
            file["force_n"][i] = force_on_base(base_s, frame)
            for j, (channel, columns) in enumerate(trial_curves(base_s, frame, films.get(trial)).items()):
                for name, values in columns.items():
                    if np.isfinite(values).any():
                        file[name][i, j] = values
                file["left_out"][i, j] = left_out_on_base(base_s, frame, channel)
    return buffer.getvalue()


def _make(file: h5py.File, name: str, dimensions: tuple[str, ...], shape: tuple[int, ...]) -> None:
    chunk = (*[1] * (len(shape) - 1), shape[-1])
    options: dict[str, Any] = {"chunks": chunk, "compression": "gzip", "compression_opts": 1, "shuffle": True}
    data = file.create_dataset(name, shape, dtype=np.float32, fillvalue=np.nan, **options)
    unit = "N" if name.endswith("_n") else "rad" if name.endswith("_rad") else "1"
    data.attrs.update({"units": unit, "long_name": WORDS[name]})
    for i, dimension in enumerate(dimensions):
        data.dims[i].attach_scale(file[dimension])


def read_curves(path: str | Path) -> pd.DataFrame:
    """The tidy table of a curves file, as `validation.ValidationResult.curves` gives it.

    Parameters
    ----------
    path : path
        File written by `validation.ValidationResult.write_curves`, or ``curves.nc`` beside a report.

    Returns
    -------
    DataFrame
        trial, channel, time_s, measured_rad, predicted_rad, null_rad, u_rad, left_out, force_n.

    Raises
    ------
    ValidationInputError
        The file is missing, or is no curves file.

    Examples
    --------
    >>> import validation
    >>> result = validation.compare("sessions/example_forte", "hirschkorn2004", budget=False, suspect=False)
    >>> path = result.write_curves("curves.nc")
    >>> sorted(set(validation.read_curves("curves.nc")["channel"]))[:2]
    ['hammer', 'jack']
    """
    try:
        with h5py.File(path, "r") as file:
            if file.attrs.get("schema") != SCHEMA:
                raise ValidationInputError(f"{path}: found {file.attrs.get('schema')!r}, allowed {SCHEMA!r}")
            time, channels = file["time"][()], [name.decode() for name in file["channel"][()]]
            parts = []
            for i, trial in enumerate(file["trial"][()]):
                force = file["force_n"][i]
                for j, channel in enumerate(channels):
                    columns = {name: file[name][i, j] for name in VALUES}
                    if any(np.isfinite(values).any() for values in columns.values()):
                        rest = {"left_out": file["left_out"][i, j] > 0, "force_n": force}
                        head = {"trial": int(trial), "channel": channel, "time_s": time}
                        parts.append(pd.DataFrame({**head, **columns, **rest}))
    except (OSError, KeyError) as error:
        raise ValidationInputError(f"{path}: no curves file ({error}); allowed the curves.nc of a report") from error
    return pd.concat(parts, ignore_index=True) if parts else pd.DataFrame(columns=COLUMNS)


def write_curves(table: pd.DataFrame, netcdf: bytes, path: Path) -> Path:
    """Write curves to ``.nc``, ``.csv`` or ``.parquet``.

    Raises
    ------
    ValidationInputError
        Another ending, a folder that cannot be written, or Parquet without pyarrow.
    """
    try:
        if path.suffix == ".nc":
            path.write_bytes(netcdf)
        elif path.suffix == ".csv":
            table.to_csv(path, index=False, lineterminator="\n")
        elif path.suffix == ".parquet":
            table.to_parquet(path, index=False)
        else:
            raise ValidationInputError(f"{path}: ending {path.suffix!r} found, allowed .nc, .csv or .parquet")
    except ImportError as error:
        raise ValidationInputError(
            f"{path}: Parquet needs pyarrow; install it with  pip install piano-action-rig[parquet]  or write .nc"
        ) from error
    except OSError as error:
        raise ValidationInputError(f"{path}: cannot be written ({error.strerror or error})") from error
    return path
