"""One trial of the data set as a netCDF-4 file with CF-style attributes, written and read with h5py alone.

Two clocks, two dimensions: ``time`` of force, command and encoders, ``film_time`` of the angles from film. Time zero is
the start of the recording. Strings and numbers are attributes of the file, none of it tells what the specimen is.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import h5py
import numpy as np
from numpy.typing import NDArray

from validation.errors import ValidationInputError

if TYPE_CHECKING:
    import pandas as pd
import hashlib

Array = NDArray[np.float64]

CONVENTIONS = "CF-1.11"
CHANNELS = {
    "force": ("time", "N", "force of the motor's arm on the front of the key, positive downwards"),
    "motor_command": ("time", "V", "command of the motor, held from each sample to the next"),
    "key_angle": ("time", "rad", "angle of the key since the first sample, counter-clockwise"),
    "whippen_angle": ("time", "rad", "angle of the whippen since the first sample, counter-clockwise"),
    "hammer_angle": ("time", "rad", "angle of the hammer since the first sample, counter-clockwise"),
    "jack_angle": ("film_time", "rad", "angle of the jack relative to the whippen since rest, tracked on film"),
    "repetition_angle": (
        "film_time", "rad", "angle of the repetition lever relative to the whippen since rest, tracked on film"
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


SCHEMA = "piano-action-rig dataset 1"
INDEX = "dataset.json"


def read_index(folder: str | Path) -> dict[str, Any]:
    """Read what a data set holds.

    Parameters
    ----------
    folder : path

    Returns
    -------
    dict
        ``trials`` by split, ``window_s`` (initialisation), ``sample_rate_hz``, ``seal`` and so on.

    Raises
    ------
    ValidationInputError
        The folder is no data set.

    Examples
    --------
    >>> import validation
    >>> validation.dataset.read_index("dataset")["window_s"]
    0.2
    """
    file = Path(folder) / INDEX
    try:
        index = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ValidationInputError(
            f"{file}: cannot be read ({error}); name a folder that pianorig dataset make wrote"
        ) from None
    if not isinstance(index, dict) or index.get("schema") != SCHEMA:
        raise ValidationInputError(f"{file}: not a data set, its schema must be {SCHEMA!r}")
    return index


def trials_of(folder: str | Path, split: str = "open", part: str | None = None) -> list[DataTrial]:
    """Read the trials of a split, of one part (train or test) where given.

    Raises
    ------
    ValidationInputError
        The data set has no such split or part, or a trial cannot be read.
    """
    return [read_netcdf(Path(folder) / row["file"]) for row in _rows(folder, split, part)]


def _rows(folder: str | Path, split: str, part: str | None) -> list[dict[str, Any]]:
    splits = read_index(folder)["trials"]
    if split not in splits:
        raise ValidationInputError(f"{folder}: no split {split!r}; there are {', '.join(splits)}")
    if part not in (None, "train", "test"):
        raise ValidationInputError(f"{folder}: no part {part!r}; allowed train or test")
    return [row for row in splits[split] if part is None or row["part"] == part]


def load(
    folder: str | Path, split: str = "open", part: str | None = None, kind: Literal["pandas", "xarray"] = "pandas"
) -> Any:
    """Load trials of a data set.

    Parameters
    ----------
    folder : path
    split : str
        ``open`` or ``sealed``.
    part : str, optional
        ``train`` or ``test``; by default both.
    kind : str
        ``pandas``: one table, a row a sample of the force's clock, film angles interpolated onto it; ``xarray``: a
        dict of data sets by trial number, each channel on its own clock.

    Returns
    -------
    DataFrame, or dict of int to xarray.Dataset

    Raises
    ------
    ValidationInputError
        The folder is no data set, or has no such split or part.

    Examples
    --------
    >>> import validation
    >>> table = validation.dataset.load("dataset", part="train")
    >>> table.columns[:4].tolist()
    ['trial', 'condition', 'time', 'force']
    """
    if kind == "xarray":
        import xarray  # start-up: an optional package

        rows = _rows(folder, split, part)
        return {row["trial"]: xarray.load_dataset(Path(folder) / row["file"], engine="h5netcdf") for row in rows}
    return to_table(trials_of(folder, split, part))


def to_table(trials: list[DataTrial]) -> pd.DataFrame:
    """Trials as one table on the force's clock."""
    import pandas as pd  # start-up: 0.4 s

    parts = []
    for trial in trials:
        n = trial.time_s.size
        columns: dict[str, Any] = {
            "trial": np.full(n, trial.facts["trial"]),
            "condition": np.full(n, trial.facts["condition"]),
            "time": trial.time_s,
        }
        for name, (clock, _, _) in CHANNELS.items():
            values = trial.values[name]
            columns[name] = (
                values
                if clock == "time"
                else np.interp(trial.time_s, trial.film_time_s, values, left=np.nan, right=np.nan)
            )
        parts.append(pd.DataFrame(columns))
    return pd.concat(parts, ignore_index=True)


def salted_sha256(text: str, salt: str) -> str:
    """SHA-256 over salt and text, hexadecimal.

    The hash is over salt and text. Without the salt nobody can try likely truths against it; with both, published when
    the truth is opened, anybody can see that it is the one that was sealed.
    """
    return hashlib.sha256(f"{salt}\n{text}".encode()).hexdigest()


def truth_text(truth: dict[str, Any]) -> str:
    """A truth as the text that is hashed: JSON with sorted keys."""
    return json.dumps(truth, indent=1, sort_keys=True) + "\n"


def check_truth(folder: str | Path, truth_file: str | Path, split: str = "sealed") -> dict[str, Any]:
    """Read a truth that was opened and check it against the hash the data set was published with.

    Parameters
    ----------
    folder : path
        The data set.
    truth_file : path
        The truth: JSON with ``salt`` and ``truth``.
    split : str
        Which it is the truth of.

    Returns
    -------
    dict
        The truth: specimens and faults by trial.

    Raises
    ------
    ValidationInputError
        It cannot be read, or is not the truth that was sealed.

    Examples
    --------
    >>> import validation
    >>> truth = validation.dataset.check_truth("dataset", "dataset/truth_open.json", "open")
    >>> [specimen["name"] for specimen in truth["specimens"]]
    ['A', 'B']
    """
    sealed = read_index(folder)["seal"].get(split)
    if sealed is None:
        raise ValidationInputError(f"{folder}: no hash of a truth of {split!r} was published with it")
    try:
        opened = json.loads(Path(truth_file).read_text(encoding="utf-8"))
        salt, truth = opened["salt"], opened["truth"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ValidationInputError(f"{truth_file}: not a truth, JSON with salt and truth ({error})") from None
    found = salted_sha256(truth_text(truth), salt)
    if found != sealed:
        raise ValidationInputError(
            f"{truth_file}: its truth does not match the hash published with {folder}: found {found[:12]}…, published "
            f"{sealed[:12]}…; it was altered, or belongs to another data set"
        )
    return dict(truth)
