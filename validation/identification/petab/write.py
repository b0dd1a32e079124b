"""The tables of an identification, as texts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

import model
from validation.conventions import ENCODER_CHANNELS, Array
from validation.errors import ValidationInputError
from validation.identification.fit import Fitted
from validation.identification.observations import ENCODERS, ObservedTrial
from validation.identification.petab.columns import (
    CONDITION,
    CONDITIONS,
    FORCES,
    MEASUREMENT,
    MEASUREMENTS,
    OBSERVABLE_IDS,
    OBSERVABLES,
    OF_CHANNEL,
    OF_TRIAL,
    PARAMETERS,
    PROBLEM,
    SEAL,
    TIME,
    TRIALS,
    petab_id,
)
from validation.identification.problem import Problem
from validation.identification.unknowns.priors import Parameter, Unknowns

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
