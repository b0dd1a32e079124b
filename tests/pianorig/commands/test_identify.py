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
from pianorig.commands import identify as command
from pianorig.errors import CommandInputError
from tests.command_line import run
from tests.validation.infer import toy
from validation.infer.budget import OUT_OF_BUDGET, End
from validation.infer.estimates import NOT_IDENTIFIABLE, Estimate
from validation.infer.fit import fit
from validation.infer.further import Prospect
from validation.prediction.posterior import make_posterior

WARNING = "intervals are provisional"
SESSIONS = Path(__file__).parents[3] / "sessions"


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
    end: Any
    details: Any
    sensors: Any = None


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
        problem=only,
        fitted=fitted,
        profiles=(),
        sources=SimpleNamespace(measured=(), sessions=(), seals={}),
        explained=("which part: none",),
        supported=None,
    )
    scores = {"fitted trials": {"before": {"key": 1e-3, "whippen": 1e-3, "hammer": 1e-3}}}
    return Found(
        model.load_action(),
        (estimate,),
        np.eye(1),
        (),
        (WARNING,),
        (0.0,),
        scores,
        {},
        provenance,
        posterior,
        fitted.end,
        details,
    )


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--out", "found.json"], "allowed .toml"),
        (["--plan", "next.csv"], "allowed .toml"),
        (["--plan", "none/next.toml"], "there is no folder"),
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
    alike = ["forte x 1.4: too strong", "double: too strong"]
    monkeypatch.setattr(command, "next_strokes", lambda identified: ([sensor], alike))
    monkeypatch.setattr(command, "check_plan", lambda sessions, motion_driven: None)
    assert run("identify", "session", "--parameters", "friction", "--plan", "next.toml") == 0
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 80
    said = " ".join(" ".join(lines).split())
    assert WARNING in said and "No value of 1 parameter is identified" in said and "None of its parts" not in said
    assert "0.90 key encoder known twice as well" in said and "not considered: forte x 1.4, double: too strong" in said
    assert "plan: none is written: no profile could be predicted within the limits" in said  # and all else is kept
    assert {"identified.toml", "identified.html"} == {p.name for p in tmp_path.iterdir()}
    monkeypatch.setattr("validation.infer.write.render_identification", lambda *given: "a page")
    assert run("identify", "session", "--parameters", "friction", "--json") == 0
    told = json.loads(capsys.readouterr().out)
    assert told["files"]["page"] == "identified.html" and told["explained"] == ["which part: none"]


def test_ctrl_c_tells_and_writes_the_best_so_far(
    found: Found, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    end = End(OUT_OF_BUDGET, "stopped by Ctrl-C; key.joint_friction.A would still move by 2.0 u", True)
    monkeypatch.setattr(validation, "identify", lambda *given, **more: replace(found, end=end))
    monkeypatch.setattr("validation.infer.write.render_identification", lambda *given: "a page")
    assert run("identify", "session", "--parameters", "friction") == 130
    told = capsys.readouterr()
    assert f"end: {end}." in " ".join(told.out.split()) and "0.01400 ± " in told.out
    assert "the best so far is in identified.toml" in told.err
    assert (tmp_path / "identified.toml").is_file()


def test_the_budget_reaches_the_fit(found: Found, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("validation.infer.write.render_identification", lambda *given: "a page")
    given: list[object] = []

    def identify(*args: object, **more: object) -> Found:
        given.append(more["budget_s"])
        return found

    monkeypatch.setattr(validation, "identify", identify)
    assert run("identify", "session", "--parameters", "friction", "--budget", "7.5") == 0
    assert run("identify", "session", "--parameters", "friction", "--budget", "0") == 2
    assert given == [7.5]


def test_nothing_can_be_ranked_without_a_stroke_that_a_force_drives(found: Found) -> None:
    with pytest.raises(CommandInputError, match="no session with forces"):
        command.next_strokes(found)  # type: ignore[arg-type]
    ranked, refused, why = command.next_strokes_or_reason(found)  # type: ignore[arg-type]
    assert not ranked and not refused and why.startswith("no session with forces was fitted")


def test_a_plan_that_cannot_be_made_is_refused_before_any_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(validation, "identify", lambda *given, **more: pytest.fail("work was begun"))
    words = ["--parameters", "friction", "--plan", tmp_path / "next.toml", "--out", tmp_path / "found.toml"]
    assert run("identify", tmp_path, *words, "--motion-driven") == 2
    assert "--plan: ranks strokes by the force" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
