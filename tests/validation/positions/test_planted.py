"""Strokes whose truth is known, seen by position sensors: compared by the one comparison, fitted by the one fit."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

import model
import validation
from rig.session import Session
from tests.validation.positions.planted import REGULATED, Specimen, record
from validation.measurement.position_sensors import ERROR_NAMES, PRIOR_U, TABLE, SensorCalibration

CURVE = {0.04: 0.02, 0.1: 0.03, 0.2: 0.03, 0.4: 0.02, 0.7: 0.01}
GAINED = Specimen(key_gain=-0.05, hammer_gain=0.06, hammer_curve=CURVE)
TRUE = {"key_scale": -0.05, "hammer_scale": 0.06} | {f"hammer_curve_{100 * at:02.0f}": x for at, x in CURVE.items()}
QUICK = {"budget": False, "explain": False, "keep_predictions": False}


def with_sensors(action: model.Action, errors: dict[str, float]) -> model.Action:
    """The action as a file holds it whose identification learnt these errors."""
    z = {name: errors.get(name, 0.0) / u for name, u in zip(ERROR_NAMES, PRIOR_U, strict=True)}
    table = SensorCalibration(tuple(z.values()), (0.1,) * len(z), {}).table()
    return replace(action, identification={TABLE: table})


@pytest.fixture(scope="module")
def planted(tmp_path_factory) -> Session:
    return record(tmp_path_factory.mktemp("planted"), GAINED, ("fast", "slide-off"))


def test_the_true_action_with_the_true_sensors_meets_every_stroke(planted) -> None:
    result = validation.compare(planted, with_sensors(REGULATED, TRUE), **QUICK)
    assert list(result.scores["channel"]) == ["hammer"] * 2
    assert result.scores["rmse_over_range"].max() < 0.03
    assert result.scores["null_rmse_rad"].gt(2.0 * result.scores["rmse_rad"]).all()
    assert "driven by its own measured motion of the key" in result.verdict
    by_ruler = validation.compare(planted, REGULATED, **QUICK)
    early = REGULATED.with_values({"contact04.second.x": REGULATED["contact04.second.x"] - 2e-3})
    for other in (by_ruler, validation.compare(planted, with_sensors(early, TRUE), **QUICK)):
        fast = other.scores["trial"] == 1
        assert (other.scores["rmse_rad"] > 1.5 * result.scores["rmse_rad"])[fast].all()


def test_the_fit_finds_a_screw_beside_the_errors_of_the_sensors(tmp_path: Path) -> None:
    moved = REGULATED.with_values({"contact04.second.x": REGULATED["contact04.second.x"] + 1e-3})
    session = record(tmp_path, replace(GAINED, action=moved), ("fast",))
    found = validation.identify(
        [session], ["contact04.second.x"], with_sensors(REGULATED, TRUE), fixed=("*",),
        priors={"contact04.second.x": 2e-3}, profiles=(), phases=40,
    )  # fmt: skip
    (check,) = found.estimates
    assert check.value - REGULATED["contact04.second.x"] == pytest.approx(1e-3, abs=3e-4)
    assert found.sensors is not None and found.sensors.sensors is not None
    assert set(found.sensors.sensors) == {f"{b} {w}" for b in ("key", "hammer") for w in ("sensor", "calibrated point")}
    validation.write_identified(found, tmp_path / "found.toml")
    written = model.load_action(tmp_path / "found.toml")
    result = validation.compare(session, written, **QUICK)
    assert result.scores["rmse_over_range"].max() < 0.04
    assert result.scores["rmse_rad"].iloc[0] < result.rivals["unfitted_rmse_rad"].iloc[0]
    assert any(line.startswith("Not a prediction") for line in result.verdict_lines)
    assert list(result.trials["fitted"]) == [True]
