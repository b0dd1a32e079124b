"""Every curve of a result in one tidy table on one time base.

Conventions: SI and rad; changes since rest, counter-clockwise; the base is the one of ``spread``, sample times of the
first trial inside the evaluation window; jack and repetition lever are read between the film's frames by straight
lines. What does not exist is NaN.
"""

from __future__ import annotations

import io
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pandas as pd
from numpy.typing import NDArray

from validation.conventions import BODIES, FILM_CHANNELS, Array
from validation.errors import ValidationInputError


def interpolate_to_base_times(base_s: Array, time_s: Array, values: Array) -> Array:
    """``values`` (n,) at increasing times ``time_s`` (n,), s, interpolated linearly to times ``base_s`` (n_base,), s:
    (n_base,), NaN outside the record; times that agree to 1 ns are taken as they are."""
    if time_s.size >= base_s.size:
        first = int(np.searchsorted(time_s, base_s[0] - 1e-9))
        part = slice(first, first + base_s.size)
        if part.stop <= time_s.size and np.allclose(time_s[part], base_s, atol=1e-9, rtol=0):
            return np.asarray(values[part], dtype=float)
    return np.asarray(np.interp(base_s, time_s, values, left=np.nan, right=np.nan), dtype=float)


VALUES = ("measured_rad", "predicted_rad", "null_rad", "u_rad")
COLUMNS = ["trial", "channel", "time_s", *VALUES, "left_out", "force_n"]


def trial_curves(base_s: Array, encoder: pd.DataFrame, film: pd.DataFrame | None) -> dict[str, dict[str, Array]]:
    """Curves (n,) of one trial, body → ``measured_rad``, ``predicted_rad``, ``null_rad``, ``u_rad`` → values at times
    ``base_s`` (n,), s, NaN where there is none; ``encoder``, ``film``: its traces, the latter None without film."""
    out = {}
    for channel in BODIES:
        frame = film if channel in FILM_CHANNELS else encoder
        nothing = np.full(base_s.size, np.nan)
        columns = {}
        for value in VALUES:
            name = f"{channel}_{value}"
            columns[value] = nothing
            if frame is not None and name in frame:
                columns[value] = interpolate_to_base_times(base_s, frame["time_s"].to_numpy(), frame[name].to_numpy())
        if film is None and channel in FILM_CHANNELS:  # predicted all the same
            predicted = encoder[f"{channel}_predicted_rad"].to_numpy()
            columns["predicted_rad"] = interpolate_to_base_times(base_s, encoder["time_s"].to_numpy(), predicted)
        out[channel] = columns
    return out


def force_on_base(base_s: Array, encoder: pd.DataFrame) -> Array:
    """Corrected force of one trial on the base, N."""
    return interpolate_to_base_times(base_s, encoder["force_time_s"].to_numpy(), encoder["force_n"].to_numpy())


def left_out_on_base(base_s: Array, encoder: pd.DataFrame, channel: str) -> Array:
    flag = f"{channel}_marked"
    if flag not in encoder:
        return np.zeros(base_s.size)
    return interpolate_to_base_times(base_s, encoder["time_s"].to_numpy(), encoder[flag].to_numpy(dtype=float))


def curve_table(
    base_s: Array,
    traces: Mapping[int, pd.DataFrame],
    films: Mapping[int, pd.DataFrame],
    trials: Iterable[int] | None = None,
) -> pd.DataFrame:
    """Table of curves, rad, with a row for each trial, channel and time of ``base_s`` (n,), s; ``traces``, ``films``:
    tables by trial number, ``trials``: only these numbers. Channels without any value have no rows.

    Parameters
    ----------
    base_s : (n,) s
    traces, films : mapping of trial to DataFrame, `validation.result.ValidationResult.traces` and ``film_traces``
    trials : only these

    Returns
    -------
    DataFrame
        trial, channel, time_s, measured_rad, predicted_rad, null_rad (null model), u_rad (of the film), left_out
        (of the scores), force_n (corrected, the same for all channels).
    """

    def parts() -> Iterator[tuple[int, str, dict[str, Array], NDArray[np.bool_], Array]]:
        for trial in traces if trials is None else trials:
            force = force_on_base(base_s, traces[trial])
            for channel, columns in trial_curves(base_s, traces[trial], films.get(trial)).items():
                left_out = np.nan_to_num(left_out_on_base(base_s, traces[trial], channel)) > 0
                yield trial, channel, columns, left_out, force

    table = _stack_curves(base_s, parts())
    if len(table):
        table["channel"] = pd.Categorical(table["channel"], categories=list(BODIES))
    return table


def _stack_curves(
    base_s: Array, parts: Iterable[tuple[int, str, dict[str, Array], NDArray[np.bool_], Array]]
) -> pd.DataFrame:
    """Table with one row a trial, channel and time, of the parts with a finite value; a part: trial, channel, columns
    by name (n,), mask of what is left out (n,), force (n,), N."""
    frames = [
        pd.DataFrame({"trial": trial, "channel": name, "time_s": base_s, **columns, "left_out": out, "force_n": force})
        for trial, name, columns, out, force in parts
        if any(np.isfinite(values).any() for values in columns.values())
    ]
    return pd.concat(frames, ignore_index=True) if frames else pd.DataFrame(columns=COLUMNS)


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
    """The curves of all trials at times ``base_s`` (n,), s, as the bytes of a netCDF-4 file; ``traces``, ``films``:
    tables by trial number, ``about``: attributes of the file, such as names of session and model.

    Conventions: dimensions trial, channel, time; the time base is a dimension scale, so that xarray opens it with
    coordinates; 32-bit numbers, compressed (a relative step of 6e-8, a thousandth of an encoder's count); attributes
    ``units`` and ``long_name``.

    Parameters
    ----------
    base_s : (n,) s
    traces, films : mapping of trial to DataFrame
    about : attributes of the file, as the names of session and model
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
            _create_dataset(file, name, ("trial", "channel", "time"), shape)
        _create_dataset(file, "force_n", ("trial", "time"), (shape[0], shape[2]))
        for i, (trial, frame) in enumerate(traces.items()):
            file["force_n"][i] = force_on_base(base_s, frame)
            for j, (channel, columns) in enumerate(trial_curves(base_s, frame, films.get(trial)).items()):
                for name, values in columns.items():
                    if np.isfinite(values).any():
                        file[name][i, j] = values
                file["left_out"][i, j] = left_out_on_base(base_s, frame, channel)
    return buffer.getvalue()


def _create_dataset(file: h5py.File, name: str, dimensions: tuple[str, ...], shape: tuple[int, ...]) -> None:
    """Create in ``file`` an empty 32-bit dataset of this ``shape``, compressed, NaN where not written, with unit, long
    name and the scales of its ``dimensions``, which must exist."""
    chunk = (*[1] * (len(shape) - 1), shape[-1])
    options: dict[str, Any] = {"chunks": chunk, "compression": "gzip", "compression_opts": 1, "shuffle": True}
    data = file.create_dataset(name, shape, dtype=np.float32, fillvalue=np.nan, **options)
    unit = "N" if name.endswith("_n") else "rad" if name.endswith("_rad") else "1"
    data.attrs.update({"units": unit, "long_name": WORDS[name]})
    for i, dimension in enumerate(dimensions):
        data.dims[i].attach_scale(file[dimension])


def read_curves(path: str | Path) -> pd.DataFrame:
    """Table of the curves in a netCDF file written with a report or by ``save``: trial, channel, time_s, measured,
    predicted and null model's angle and u, rad, left_out, force_n; raises an input error where the file is missing or
    no such file.

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
    >>> result = validation.compare("sessions/example_forte", "hirschkorn2004", budget=False, explain=False)
    >>> path = result.save("curves.nc")
    >>> sorted(set(validation.read_curves("curves.nc")["channel"]))[:2]
    ['hammer', 'jack']
    """
    try:
        with h5py.File(path, "r") as file:
            if file.attrs.get("schema") != SCHEMA:
                raise ValidationInputError(f"{path}: found {file.attrs.get('schema')!r}, allowed {SCHEMA!r}")
            time, channels = file["time"][()], [name.decode() for name in file["channel"][()]]
            parts = [
                (int(trial), channel, {name: file[name][i, j] for name in VALUES}, file["left_out"][i, j] > 0, force)
                for i, (trial, force) in enumerate(zip(file["trial"][()], file["force_n"][()], strict=True))
                for j, channel in enumerate(channels)
            ]
    except (OSError, KeyError) as error:
        raise ValidationInputError(f"{path}: no curves file ({error}); allowed the curves.nc of a report") from error
    return _stack_curves(time, parts)


def write_curves(table: pd.DataFrame, netcdf: bytes, path: Path) -> Path:
    """Write curves to ``path``, replacing a file that exists: ``netcdf`` as it is for ``.nc``, ``table`` for ``.csv``
    or ``.parquet``; returns the path. Raises an input error for another ending or where it cannot be written."""
    try:
        if path.suffix == ".nc":
            path.write_bytes(netcdf)
        elif path.suffix == ".csv":
            table.to_csv(path, index=False, lineterminator="\n")
        elif path.suffix == ".parquet":
            table.to_parquet(path, index=False)
        else:
            raise ValidationInputError(
                f"{path}: ending {path.suffix!r} found, allowed .nc, .csv or .parquet; "
                "a report is written by validation.write_report"
            )
    except ImportError as error:
        raise ValidationInputError(
            f"{path}: Parquet needs pyarrow; install it with  pip install piano-action-rig[parquet]  or write .nc"
        ) from error
    except OSError as error:
        raise ValidationInputError(f"{path}: cannot be written ({error.strerror or error})") from error
    return path
