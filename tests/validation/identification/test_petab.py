"""Tables in the manner of PEtab: what is written is read back, and what cannot be read is refused by name."""

from __future__ import annotations

import re
from dataclasses import fields
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pandas as pd
import pytest

from tests.validation.identification import toy
from validation.errors import ValidationInputError
from validation.identification.estimates import Estimate
from validation.identification.fit import fit
from validation.identification.observations import ObservedTrial
from validation.identification.petab import is_petab, read_petab
from validation.identification.result import joint_posterior
from validation.identification.sources import IdentifyOptions, _refuse_same_stroke, collect
from validation.identification.write import write_petab
from validation.prediction.posterior import UNKNOWN_STROKE

TRUTH = np.array([0.8, -0.5, 0.3])


@pytest.fixture(scope="module")
def fitted() -> Any:
    """As much of an identification as the tables are made from."""
    p = toy.problem(toy.made(TRUTH, 2, np.random.default_rng(1)))
    sources = SimpleNamespace(seals={t.label: f"seal of {t.label}" for t in p.trials})
    return SimpleNamespace(details=SimpleNamespace(problem=p, fitted=fit(p), sources=sources))


@pytest.fixture()
def folder(fitted: Any, tmp_path: Path) -> Path:
    """The tables."""
    write_petab(fitted, tmp_path / "tables")
    return tmp_path / "tables"


def test_trials_and_parameters_come_back_as_they_were(fitted: Any, folder: Path) -> None:
    found = read_petab(folder)
    problem = fitted.details.problem
    for read, written in zip(found.trials, problem.trials, strict=True):
        for field in fields(ObservedTrial):
            np.testing.assert_array_equal(getattr(read, field.name), getattr(written, field.name), field.name)
    of_action = [p for p in problem.unknowns.moved if p.paths]
    for one, p in zip(found.parameters, of_action, strict=True):
        assert (one.name, one.u, one.estimate, one.asked) == (p.name, p.u, True, True)
        assert one.value == p.physical(problem.action, 0.0)


def test_they_can_be_fitted_as_they_are(fitted: Any, folder: Path) -> None:
    problem = fitted.details.problem
    sources = collect([folder], problem.action, IdentifyOptions())
    fit_again = toy.problem(list(sources.fitted))
    again = fit(fit_again)
    np.testing.assert_array_equal(again.z, fitted.details.fitted.z)
    known = [cast(Estimate, SimpleNamespace(z_u=u)) for u in np.sqrt(np.diag(again.covariance))]
    posterior = joint_posterior(fit_again, again, known, sources)
    assert not posterior.strokes and not posterior.black_boxes  # tables hold no measured strokes to compare with
    assert posterior.before == {path: fit_again.action[path] for path in sorted(posterior.moved)}
    assert sources.seals == fitted.details.sources.seals  # `validate` knows the strokes again


def test_tables_without_hashes_are_of_unknown_strokes_and_no_stroke_counts_twice(fitted: Any, folder: Path) -> None:
    with pytest.raises(ValidationInputError, match="is the same stroke as .*; give each stroke once"):
        _refuse_same_stroke([("a, trial 1", "seal"), ("b, trial 1", "other"), ("tables, trial 1", "seal")])
    table = pd.read_csv(folder / "trials.tsv", sep="\t").drop(columns="trial_sha256")
    table.to_csv(folder / "trials.tsv", sep="\t", index=False)
    seals = collect([folder], fitted.details.problem.action, IdentifyOptions()).seals
    assert len(set(seals.values())) == 2 and all(s.startswith(UNKNOWN_STROKE) for s in seals.values())


def test_the_tables_have_the_columns_of_petab(folder: Path) -> None:
    needed = {
        "parameters": ["parameterId", "parameterScale", "lowerBound", "upperBound", "nominalValue", "estimate"],
        "observables": ["observableId", "observableFormula", "noiseFormula"],
        "conditions": ["conditionId"],
        "measurements": ["observableId", "simulationConditionId", "measurement", "time", "noiseParameters"],
    }
    tables = {name: pd.read_csv(folder / f"{name}.tsv", sep="\t") for name in needed}
    for name, columns in needed.items():
        assert set(columns) <= set(tables[name]), name
    p, m = tables["parameters"], tables["measurements"]
    assert all(re.fullmatch(r"[A-Za-z_]\w*", one) for one in p["parameterId"])
    assert (p["lowerBound"] < p["nominalValue"]).all() and (p["nominalValue"] < p["upperBound"]).all()
    assert (m["noiseParameters"] > 0).all()
    assert set(m["observableId"]) == set(tables["observables"]["observableId"])
    assert set(m["simulationConditionId"]) == set(tables["conditions"]["conditionId"])
    assert "too small" in (folder / "README.txt").read_text("utf-8") and is_petab(folder)


def test_tables_of_others_need_no_table_of_ours(folder: Path) -> None:
    (folder / "trials.tsv").unlink()
    trial = read_petab(folder).trials[0]
    m = pd.read_csv(folder / "measurements.tsv", sep="\t", dtype=str)  # older pandas read digits less exactly
    assert trial.u_gain == 0.0 and trial.number == 1
    assert trial.u_white_rad[0] == min(map(float, m[m["observableId"] == "key_rad"]["noiseParameters"][: toy.M]))


@pytest.mark.parametrize(
    ("file", "change", "said"),
    [
        ("forces.tsv", None, "there is no such table"),
        ("measurements.tsv", lambda t: t.drop(columns="time"), "column time is missing"),
        ("measurements.tsv", lambda t: t[t["observableId"] != "hammer_rad"], "hammer_rad found at 0 times"),
        ("measurements.tsv", lambda t: t.assign(measurement="much"), "holds text"),
        (
            "measurements.tsv",
            lambda t: t[(t["time"] < 0.2) | (t["simulationConditionId"] == "session1_trial1")],
            "trial 2: found 20 times, toy 0, trial 1 has 24",
        ),
        ("measurements.tsv", lambda t: t.assign(measurement=np.nan), "value that is missing"),
        ("forces.tsv", lambda t: t[::-1], "increasing time"),
        ("parameters.tsv", lambda t: t.assign(objectivePriorParameters="0.1"), "allowed mean;standard deviation"),
    ],
)
def test_what_cannot_be_read_is_refused_by_name(folder: Path, file: str, change: Any, said: str) -> None:
    path = folder / file
    if change is None:
        path.unlink()
    else:
        change(pd.read_csv(path, sep="\t")).to_csv(path, sep="\t", index=False)
    with pytest.raises(ValidationInputError, match=said) as raised:
        read_petab(folder)
    assert file in str(raised.value) and "\n" not in str(raised.value)


def test_a_folder_that_cannot_be_written_is_refused_before_anything_is(fitted: Any, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(ValidationInputError, match="is a file"):
        write_petab(fitted, tmp_path / "file" / "tables")
