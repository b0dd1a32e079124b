"""Identification of a played session from end to end, its action file, and what is refused."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest

import model
from validation.errors import ValidationInputError
from validation.identification.exact_runs import ExactRuns
from validation.identification.identify import identify
from validation.identification.model_runs import Case, ModelRuns
from validation.identification.options import IdentifyOptions
from validation.identification.outcome.action_file import write_identified
from validation.identification.outcome.result import TOO_FEW
from validation.identification.sources import collect
from validation.identification.unknowns.priors import unknowns

EXAMPLE = Path(__file__).parents[3] / "sessions" / "example_forte"
# the specimen of the example, but for what is asked for
SPECIMEN = {
    "key.joint_friction.A": 0.0155, "contact01.friction.A": 0.155, "contact04.friction.A": 0.36,
    "contact07.friction.A": 0.165, "contact10.friction.A": 0.28, "contact01.normal.D": 2.05,
    "contact02.normal.D": 1.6, "contact03.normal.D": 3.2, "contact12.normal.D": 0.19,
}  # fmt: skip


@pytest.fixture(scope="module")
def found() -> object:
    """The hammer's friction, all else as the specimen has it."""
    start = model.load_action("hirschkorn2004", SPECIMEN)
    return identify([EXAMPLE], ["hammer.joint_friction"], start, fixed=("*",), hold_out_trials=(3,), phases=30)


def test_two_trials_give_an_interval_that_holds_the_truth_and_no_claim(found) -> None:  # type: ignore[no-untyped-def]
    (estimate,) = found.estimates
    assert estimate.low < 0.00111 < estimate.high
    assert estimate.verdict == TOO_FEW
    held = next(scores for name, scores in found.scores.items() if name.endswith("held out"))
    assert held["identified"]["hammer"] < held["before"]["hammer"] < held["null model"]["hammer"]


def test_the_file_is_an_action_with_uncertainty_and_provenance(found, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    target = tmp_path / "identified.toml"
    write_identified(found, target)
    action = model.load_action(target)
    quantity = action.quantities["hammer.joint_friction.A"]
    assert quantity.value == found.estimates[0].value and quantity.u == found.estimates[0].u
    table = tomllib.loads(target.read_text("utf-8"))["identification"]
    assert table["names"] == ["hammer.joint_friction.A"] and table["correlation"][0][0] == pytest.approx(1.0)
    assert len(table["provenance"]["trials_sha256"]) == 2
    assert table["parameters"]["hammer.joint_friction.A"]["verdict"] == found.estimates[0].verdict
    with pytest.raises(ValidationInputError, match="allowed .toml"):
        write_identified(found, tmp_path / "identified.json")


def test_differences_agree_with_central_ones() -> None:
    start = model.load_action("hirschkorn2004", SPECIMEN)
    free = unknowns(start, ["hammer.joint_friction", "contact02"], ["*"])
    trials = collect([EXAMPLE], start, IdentifyOptions(phases=20)).fitted[:1]
    runs = ModelRuns(start, free.moved, trials, 1e-8)
    (jacobian,) = runs.jacobian(np.zeros(len(free.moved)), [0, 1])
    for j, p in enumerate(free.asked):
        up, down = (runs.run([Case(p.values(start, s * 2e-3))])[0] for s in (1, -1))
        assert up is not None and down is not None
        central = (up[0] - down[0]) / 4e-3
        assert np.abs(jacobian[:, :, j] - central).max() < 0.05 * np.abs(central).max()


@pytest.mark.parametrize("specimen", [{}, SPECIMEN])
def test_derivatives_are_those_of_differences_whatever_the_tangent_does(specimen: dict[str, float]) -> None:
    start = model.load_action("hirschkorn2004", specimen)
    free = unknowns(start, ["hammer.joint_friction"], ["*"])
    trials = collect([EXAMPLE], start, IdentifyOptions(phases=20)).fitted[:1]
    (exact,) = ExactRuns(start, free.moved, trials).jacobian(np.zeros(len(free.moved)), [0])
    (difference,) = ModelRuns(start, free.moved, trials, 1e-8).jacobian(np.zeros(len(free.moved)), [0])
    assert np.abs(exact - difference).max() < 0.1 * np.abs(difference).max()


def test_sessions_that_cannot_be_used_together_are_refused() -> None:
    with pytest.raises(ValidationInputError, match="given twice"):
        identify([EXAMPLE, EXAMPLE], ["friction"])
    with pytest.raises(ValidationInputError, match="no usable trial to fit"):
        identify([EXAMPLE], ["friction"], hold_out_trials=(1, 2, 3))
    with pytest.raises(ValidationInputError, match="no session given"):
        identify([], ["friction"])
