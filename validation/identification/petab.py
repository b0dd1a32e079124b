"""Tables in the manner of PEtab 1: parameters, observables, conditions, measurements, for others to fit these data.

PEtab's model is SBML; ours is an action driven by a force table, so that the force of each condition is a table of its
own. Names are as PEtab allows them (letters, digits and underscores).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import model
from validation.conventions import ENCODER_CHANNELS, Array
from validation.errors import ValidationInputError
from validation.identification.fit import Fitted
from validation.identification.observations import ENCODERS, ObservedTrial
from validation.identification.problem import Problem
from validation.identification.unknowns import Parameter, Unknowns

PROBLEM = "problem.yaml"
PARAMETERS, OBSERVABLES, CONDITIONS, MEASUREMENTS = (
    "parameters.tsv",
    "observables.tsv",
    "conditions.tsv",
    "measurements.tsv",
)
FORCES, TRIALS = "forces.tsv", "trials.tsv"
OBSERVABLE_IDS = tuple(f"{channel}_rad" for channel in ENCODER_CHANNELS)
TIME, MEASUREMENT, CONDITION = "time", "measurement", "simulationConditionId"
OF_TRIAL = ("session", "number", "preload_n", "u_preload_n", "u_offset_n", "u_gain", "u_delay_s", "noise_n")
SEAL = "trial_sha256"
OF_CHANNEL = ("u_white_rad", "u_zero_rad", "u_steady_rad", "u_scale")
DOT = "__"


def petab_id(name: str) -> str:
    """``contact07.friction.A`` as ``contact07__friction__A``."""
    return name.replace(".", DOT)


def own_name(identifier: str) -> str:
    """The other way round."""
    return identifier.replace(DOT, ".")


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
    name : as in `validation.identification.unknowns`
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

    What a table of another tool does not say of a trial (`columns.TRIALS` is ours) is taken to be nothing: no error of
    gain, delay or scale, sensor noise as its rows say.

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
        A table or column is missing, a number is none, a condition has no force or not all three angles, or those of
        one session have different numbers of times.

    Examples
    --------
    >>> import validation
    >>> found = validation.identify(["sessions/example_forte"], ["hammer.joint_friction"], profiles=())
    >>> _ = validation.write_petab(found, "tables")
    >>> [p.name for p in validation.read_petab("tables").parameters if p.asked]
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
    lead = {t.session: t for t in trials[::-1]}
    for t in trials:
        if t.time_s.size != lead[t.session].time_s.size:
            raise ValidationInputError(
                f"{place / MEASUREMENTS}: {t.label}: found {t.time_s.size} times, {lead[t.session].label} has "
                f"{lead[t.session].time_s.size}; allowed as many in all conditions of one session ({TRIALS})"
            )
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


README = """Tables in the manner of PEtab 1, written by pianorig identify.

parameters.tsv    start values, bounds and priors of everything the fit moved; `asked` is 1 for what was asked for;
                  `paths` are the parameters of the action that move together (the value is then their common factor)
observables.tsv   key, whippen and hammer, rad since rest
conditions.tsv    one for each trial
measurements.tsv  angles at the phases that were compared, with the standard deviation of each by itself
forces.tsv        force on the key that drives each condition, N; the first value is the preload at rest
trials.tsv        what else is known of each trial: session, sensors' standard uncertainties, hash of the recorded trial

The model is no SBML: simulate it with `pianorig simulate` or `model.simulate` on forces.tsv.
Errors of neighbouring phases are NOT independent, nor are those of trials (gain, level and delay of the force, scale
of the encoders, what the model lacks): PEtab has no column for that. A fit that takes each row for itself finds
values, but standard uncertainties many times too small. Those of pianorig identify are in the action file it wrote.
"""


def petab_texts(problem: Problem, fitted: Fitted, seals: Mapping[str, str]) -> dict[str, str | bytes]:
    """Every file of the folder, name -> text.

    Parameters
    ----------
    problem, fitted : the identification
    seals : label -> SHA-256 of the recorded trial

    Raises
    ------
    ValidationInputError
        A trial is driven by its key, or has a film.
    """
    refuse_other_trials(problem.trials)
    tables = {
        PARAMETERS: parameter_table(problem.action, problem.unknowns),
        OBSERVABLES: observable_table(),
        **trial_tables(problem.trials, fitted, seals),
    }
    texts: dict[str, str | bytes] = {
        name: table.to_csv(sep="\t", index=False, lineterminator="\n") for name, table in tables.items()
    }
    texts[PROBLEM] = _problem_yaml()
    texts["README.txt"] = README
    return texts


def refuse_other_trials(trials: Sequence[ObservedTrial]) -> None:
    """Refuse trials that the tables have no columns for.

    Raises
    ------
    ValidationInputError
        One is driven by its key, or has a film.
    """
    for t in trials:
        if t.channels != ENCODERS:
            found = "the motion of the key drives it" if t.key is not None else "it has angles of a film"
            raise ValidationInputError(
                f"--petab: {t.label}: {found}; allowed trials that a force drives, encoders alone: leave out "
                "--motion-driven, --film or --petab"
            )


def parameter_table(action: model.Action, unknowns: Unknowns) -> pd.DataFrame:
    """Everything that moves: start, bounds and prior; on the natural logarithm where it moves by a factor."""
    rows = []
    for p in unknowns.moved:
        if not p.paths:  # an error of the force: what is known of it stands with the trials
            continue
        low, high = p.box(action)
        rows.append(
            {
                "parameterId": petab_id(p.name),
                "parameterName": p.name,
                "parameterScale": "log" if p.factor else "lin",
                "lowerBound": p.physical(action, low),
                "upperBound": p.physical(action, high),
                "nominalValue": p.physical(action, 0.0),
                "estimate": 1,
                "objectivePriorType": "parameterScaleNormal",
                "objectivePriorParameters": f"{_scaled(p, action)!r};{p.u!r}",
                "asked": int(p in unknowns.asked),
                "paths": " ".join(p.paths),
                "unit": p.unit(action),
                "priorBasis": p.basis,
            }
        )
    return pd.DataFrame(rows)


def _scaled(p: Parameter, action: model.Action) -> float:
    start = p.physical(action, 0.0)
    return float(np.log(start)) if p.factor else start


def observable_table() -> pd.DataFrame:
    """The three angles, with a noise of their own in each row of the measurements."""
    return pd.DataFrame(
        {
            "observableId": OBSERVABLE_IDS,
            "observableName": [f"{channel}, since rest" for channel in ENCODER_CHANNELS],
            "observableFormula": [f"{channel}_turn" for channel in ENCODER_CHANNELS],
            "noiseFormula": [f"noiseParameter1_{name}" for name in OBSERVABLE_IDS],
            "noiseDistribution": "normal",
        }
    )


def trial_tables(trials: Sequence[ObservedTrial], fitted: Fitted, seals: Mapping[str, str]) -> dict[str, pd.DataFrame]:
    """Conditions, measurements, forces, and what else is known of each trial."""
    measured, forces, about = [], [], []
    spread = [_standard_deviation(fitted, k) for k in range(len(trials))]
    ids = [f"session{t.session + 1}_trial{t.number}" for t in trials]
    for name, t, sigma in zip(ids, trials, spread, strict=True):
        for c, observable in enumerate(OBSERVABLE_IDS):
            measured.append(
                pd.DataFrame(
                    {
                        "observableId": observable,
                        CONDITION: name,
                        TIME: t.time_s,
                        MEASUREMENT: t.change_rad[:, c],
                        "noiseParameters": sigma[:, c],
                    }
                )
            )
        forces.append(pd.DataFrame({"conditionId": name, TIME: t.force_time_s, "force_n": t.force_n}))
        row: dict[str, object] = {"conditionId": name, "label": t.label, SEAL: seals.get(t.label, "")}
        row |= {key: getattr(t, key) for key in OF_TRIAL}
        for key in OF_CHANNEL:
            row |= {f"{key}_{channel}": x for channel, x in zip(ENCODER_CHANNELS, getattr(t, key), strict=True)}
        about.append(row)
    return {
        CONDITIONS: pd.DataFrame({"conditionId": ids, "conditionName": [t.label for t in trials]}),
        MEASUREMENTS: pd.concat(measured),
        FORCES: pd.concat(forces),
        TRIALS: pd.DataFrame(about),
    }


def _standard_deviation(fitted: Fitted, k: int) -> Array:
    """Of each angle of a trial by itself, (m, 3): sensor, force, scatter, own wandering and discrepancy together."""
    lower, _ = fitted.marginal.white[k]
    block = fitted.marginal.blocks[k]
    own = (lower**2).sum(axis=1)
    p = fitted.marginal.p
    shared = (fitted.marginal.design(block)[:, p:] ** 2).sum(axis=1)
    return np.sqrt(own + shared).reshape(len(ENCODERS), block.time_s.size).T


def _problem_yaml() -> str:
    lines = ["format_version: 1", f"parameter_file: {PARAMETERS}", "problems:", "  - sbml_files: []"]
    for key, name in (
        ("condition_files", CONDITIONS),
        ("measurement_files", MEASUREMENTS),
        ("observable_files", OBSERVABLES),
    ):
        lines += [f"    {key}:", f"      - {name}"]
    return "\n".join(lines) + "\n"
