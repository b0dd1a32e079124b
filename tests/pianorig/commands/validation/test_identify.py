"""``pianorig identify``: what cannot be written is refused before any work; what was found is printed and written."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import model
import validation
from pianorig import workflows
from pianorig.errors import CommandInputError
from tests.command_line import run
from tests.validation.identification import toy
from validation.identification.fit import fit
from validation.identification.further.shrink import Prospect
from validation.identification.outcome.result import NOT_IDENTIFIABLE, Estimate
from validation.prediction.posterior import make_posterior

WARNING = "intervals are provisional"


@dataclass(frozen=True)
class Found:
    """As much of an `Identification` as is printed and written."""

    action: Any
    estimates: tuple[Estimate, ...]
    correlation: Any
    undetermined: tuple[Any, ...]
    warnings: tuple[str, ...]
    starts: tuple[float, ...]
    scores: dict[str, Any]
    events: dict[str, Any]
    provenance: dict[str, Any]
    posterior: Any
    details: Any


@pytest.fixture(scope="module")
def found() -> Found:
    """A fit of the toy, as if it were of a session."""
    p = toy.problem(toy.made(np.array([0.5, 0.0, 0.0]), 2, np.random.default_rng(1)))
    fitted = fit(p)
    first = p.unknowns.asked[0]
    estimate = Estimate(
        name=first.name, unit="N*m", prior=0.0122, prior_u=0.3, basis="taken", z=0.5, z_u=0.1, value=0.014, u=4e-4,
        low=0.013, high=0.015, profiled=False, interval="two-sided", u_jackknife=float("nan"), u_form=0.0,
        verdict=NOT_IDENTIFIABLE,
    )  # fmt: skip
    only = replace(p, unknowns=replace(p.unknowns, asked=(first,)))
    posterior = make_posterior([(first.name, first.paths, first.u, True)], np.array([[0.01]]), {"try, trial 1": "seal"})
    provenance = {
        "created_utc": "2026-11-22T10:00:00Z", "trials_sha256": {"try, trial 1": "seal"},
        "paths": {first.name: list(first.paths)},
    }  # fmt: skip
    details = SimpleNamespace(
        problem=only, fitted=fitted, profiles=(), sources=SimpleNamespace(measured=(), sessions=())
    )
    scores = {"fitted trials": {"before": {"key": 1e-3, "whippen": 1e-3, "hammer": 1e-3}}}
    return Found(
        model.load_action(), (estimate,), np.eye(1), (), (WARNING,), (0.0,), scores, {}, provenance, posterior, details
    )


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--out", "found.json"], "allowed .toml"),
        (["--plan", "next.csv"], "allowed .toml"),
        (["--plan", "none/next.toml"], "there is no folder"),
        (["--petab", "file/tables"], "is a file"),
    ],
)
def test_what_cannot_be_written_is_refused_before_any_work(
    options: list[str], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").write_text("")
    monkeypatch.setattr(validation, "identify", lambda *given, **more: pytest.fail("work was begun"))
    assert run("identify", "session", "--parameters", "friction", *options) == 2
    error = capsys.readouterr().err.strip()
    assert said in error and "\n" not in error
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


def test_everything_that_was_asked_for_is_written_and_said(
    found: Found, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(validation, "identify", lambda *given, **more: found)
    sensor = Prospect("key encoder known twice as well", {found.estimates[0].name: 0.9})
    monkeypatch.setattr(workflows, "next_strokes", lambda identified: ([sensor], ["forte x 1.4: too strong"]))
    monkeypatch.setattr(workflows, "write_next", lambda found, ranked, plan: plan)
    assert run("identify", "session", "--parameters", "friction", "--plan", "next.toml", "--petab", "tables") == 0
    said = capsys.readouterr().out
    assert WARNING in said and "no value is called identified" in said and "None of its parts" not in said
    assert "0.90  key encoder known twice as well" in said and "not considered: forte x 1.4: too strong" in said
    assert {"identified.toml", "identified.html", "tables"} == {p.name for p in tmp_path.iterdir()}
    monkeypatch.setattr("validation.identification.page.write.render_identification", lambda *given: "a page")
    assert run("identify", "session", "--parameters", "friction", "--json") == 0
    assert json.loads(capsys.readouterr().out)["files"]["page"] == "identified.html"


def test_nothing_can_be_ranked_where_only_tables_were_fitted(found: Found) -> None:
    with pytest.raises(CommandInputError, match="no session was fitted"):
        workflows.next_strokes(found)  # type: ignore[arg-type]
