"""Reading the tables back: trials to fit, and parameters with their priors.

What a table of another tool does not say of a trial (`columns.TRIALS` is ours) is taken to be nothing: no error of
gain, delay or scale, sensor noise as its rows say.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from validation.conventions import ENCODER_CHANNELS
from validation.errors import ValidationInputError
from validation.identification.observations import ObservedTrial
from validation.identification.petab.columns import (
    CONDITION,
    CONDITIONS,
    FORCES,
    MEASUREMENT,
    MEASUREMENTS,
    OBSERVABLE_IDS,
    OF_CHANNEL,
    OF_TRIAL,
    PARAMETERS,
    PROBLEM,
    SEAL,
    TIME,
    TRIALS,
    own_name,
)

NEEDED = {
    PARAMETERS: ("parameterId", "parameterScale", "nominalValue", "estimate"),
    CONDITIONS: ("conditionId",),
    MEASUREMENTS: ("observableId", CONDITION, TIME, MEASUREMENT),
    FORCES: ("conditionId", TIME, "force_n"),
}


@dataclass(frozen=True)
class PetabParameter:
    """One row of the parameters.

    Attributes
    ----------
    name : as in `validation.identification.unknowns.naming`
    value : nominal
    u : standard deviation of its prior, relative where it is on a logarithm; NaN where none is normal
    estimate : whether it is to be estimated
    asked : whether it was asked for; as ``estimate`` where the table does not say
    """

    name: str
    value: float
    u: float
    estimate: bool
    asked: bool


@dataclass(frozen=True)
class PetabTables:
    """What a folder holds.

    Attributes
    ----------
    parameters, trials : tuples
    seals : of each trial the SHA-256 of the recorded trial; "" where the tables do not say
    """

    parameters: tuple[PetabParameter, ...]
    trials: tuple[ObservedTrial, ...]
    seals: tuple[str, ...]


def is_petab(folder: str | Path) -> bool:
    """Whether a folder holds a PEtab problem."""
    return (Path(folder) / PROBLEM).is_file()


def read_petab(folder: str | Path) -> PetabTables:
    """Read a folder of tables in the manner of PEtab 1.

    Parameters
    ----------
    folder : path
        With ``parameters.tsv``, ``conditions.tsv``, ``measurements.tsv`` and ``forces.tsv``.

    Returns
    -------
    PetabTables

    Raises
    ------
    ValidationInputError
        A table or column is missing, a number is none, or a condition has no force or not all three angles.

    Examples
    --------
    >>> import validation
    >>> found = validation.identify(["sessions/example_forte"], ["hammer.joint_friction"], fixed=("*",), profiles=())
    >>> _ = validation.write_petab(found, "tables")
    >>> [p.name for p in validation.read_petab("tables").parameters]
    ['hammer.joint_friction.A']
    """
    place = Path(folder)
    tables = {name: _table(place / name, needed) for name, needed in NEEDED.items()}
    about = _table(place / TRIALS, ("conditionId",)) if (place / TRIALS).is_file() else pd.DataFrame()
    known = {} if not len(about) else {str(row["conditionId"]): row for _, row in about.iterrows()}
    trials = [
        _trial(place, str(name), k, tables, known.get(str(name)))
        for k, name in enumerate(tables[CONDITIONS]["conditionId"])
    ]
    seals = tuple(_seal(known.get(str(name))) for name in tables[CONDITIONS]["conditionId"])
    return PetabTables(tuple(_parameter(row) for _, row in tables[PARAMETERS].iterrows()), tuple(trials), seals)


def _seal(about: pd.Series | None) -> str:
    found = "" if about is None else about.get(SEAL, "")
    return found if isinstance(found, str) else ""


def _table(path: Path, needed: tuple[str, ...]) -> pd.DataFrame:
    try:
        table = pd.read_csv(path, sep="\t", dtype=str).apply(_numbers)
    except FileNotFoundError:
        raise ValidationInputError(
            f"{path}: there is no such table; a PEtab folder needs {', '.join(NEEDED)}"
        ) from None
    except (OSError, ValueError) as error:
        raise ValidationInputError(f"{path}: cannot be read ({error}); allowed columns parted by tabs") from None
    missing = [name for name in needed if name not in table]
    if missing:
        raise ValidationInputError(f"{path}: column {missing[0]} is missing; found {', '.join(table.columns)}")
    for name in (TIME, MEASUREMENT, "force_n", "nominalValue"):
        if name in needed and not pd.api.types.is_numeric_dtype(table[name]):
            raise ValidationInputError(f"{path}: column {name} holds text; allowed numbers")
        if name in needed and not np.isfinite(table[name]).all():
            raise ValidationInputError(f"{path}: column {name} has a value that is missing; take the row out")
    return table


def _numbers(column: pd.Series) -> pd.Series:
    """The column as numbers, exact to the last digit; itself where it holds text."""
    try:
        return column.map(float)
    except ValueError:
        return column


def _trial(place: Path, name: str, k: int, tables: dict[str, pd.DataFrame], about: pd.Series | None) -> ObservedTrial:
    measured = tables[MEASUREMENTS][tables[MEASUREMENTS][CONDITION] == name]
    parts = [measured[measured["observableId"] == observable].sort_values(TIME) for observable in OBSERVABLE_IDS]
    for observable, part in zip(OBSERVABLE_IDS, parts, strict=True):
        if not len(part) or not np.array_equal(part[TIME], parts[0][TIME]):
            raise ValidationInputError(
                f"{place / MEASUREMENTS}: condition {name}: {observable} found at {len(part)} times, "
                f"{OBSERVABLE_IDS[0]} at {len(parts[0])}; allowed all three angles at the same times"
            )
    force = tables[FORCES][tables[FORCES]["conditionId"] == name]
    if len(force) < 2 or not np.all(np.diff(force[TIME]) > 0):
        raise ValidationInputError(
            f"{place / FORCES}: condition {name}: found {len(force)} rows, allowed from 2 in increasing time"
        )
    row: dict[str, float] = {} if about is None else about.to_dict()
    channels: dict[str, Any] = {
        key: np.array([float(row.get(f"{key}_{channel}", 0.0)) for channel in ENCODER_CHANNELS]) for key in OF_CHANNEL
    }
    if about is None and "noiseParameters" in measured:
        channels["u_white_rad"] = np.array([float(part["noiseParameters"].min()) for part in parts])
    alone: dict[str, Any] = {key: float(row.get(key, 0.0)) for key in OF_TRIAL if key not in ("session", "number")}
    if about is None:
        alone["preload_n"] = float(force["force_n"].iloc[0])
    return ObservedTrial(
        label=str(row.get("label", name)),
        session=int(row.get("session", 0)),
        number=int(row.get("number", k + 1)),
        force_time_s=force[TIME].to_numpy(dtype=float),
        force_n=force["force_n"].to_numpy(dtype=float),
        time_s=parts[0][TIME].to_numpy(dtype=float),
        change_rad=np.column_stack([part[MEASUREMENT].to_numpy(dtype=float) for part in parts]),
        **channels,
        **alone,
    )


def _parameter(row: pd.Series) -> PetabParameter:
    u = float("nan")
    if str(row.get("objectivePriorType", "")) in ("parameterScaleNormal", "normal"):
        try:
            u = float(str(row["objectivePriorParameters"]).split(";")[1])
        except (IndexError, ValueError):
            raise ValidationInputError(
                f"{PARAMETERS}: {row['parameterId']}: objectivePriorParameters found "
                f"{row['objectivePriorParameters']!r}, allowed mean;standard deviation"
            ) from None
        if str(row["objectivePriorType"]) == "normal" and row["parameterScale"] != "lin":
            u = float("nan")
    estimate = bool(int(row["estimate"]))
    return PetabParameter(
        own_name(str(row["parameterId"])),
        float(row["nominalValue"]),
        u,
        estimate,
        bool(int(row.get("asked", estimate))),
    )
