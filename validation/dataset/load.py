"""The two-line loader: a folder of the data set as one table, or as xarray data sets."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from validation.dataset.files import CHANNELS, DataTrial, read_netcdf
from validation.errors import ValidationInputError

if TYPE_CHECKING:
    import pandas as pd

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
        The data set has no such split, or a trial cannot be read.
    """
    index = read_index(folder)
    splits = index["trials"]
    if split not in splits:
        raise ValidationInputError(f"{folder}: no split {split!r}; there are {', '.join(splits)}")
    chosen = [row for row in splits[split] if part is None or row["part"] == part]
    return [read_netcdf(Path(folder) / row["file"]) for row in chosen]


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
        The folder is no data set, or has no such split.

    Examples
    --------
    >>> import validation
    >>> table = validation.dataset.load("dataset", part="train")
    >>> table.columns[:4].tolist()
    ['trial', 'condition', 'time', 'force']
    """
    if kind == "xarray":
        import xarray  # start-up: an optional package

        index = read_index(folder)
        if split not in index["trials"]:
            raise ValidationInputError(f"{folder}: no split {split!r}; there are {', '.join(index['trials'])}")
        rows = [row for row in index["trials"][split] if part is None or row["part"] == part]
        return {row["trial"]: xarray.load_dataset(Path(folder) / row["file"], engine="h5netcdf") for row in rows}
    return to_table(trials_of(folder, split, part))


def to_table(trials: list[DataTrial]) -> pd.DataFrame:
    """Trials as one table on the force's clock."""
    import numpy as np  # start-up: pandas and numpy together cost 0.5 s
    import pandas as pd  # start-up: see above

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
