"""What only a report shows: energies inside the action close, parts sum up, nothing is made that nobody asked for."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import model
from validation import compare as compare_session
from validation.prediction.model_under_test import ModelUnderTest
from validation.tables import inside as module
from validation.tables.inside import inside_rows
from validation.verdict.error_draws import OWN_DRAWS


@pytest.fixture(scope="module")
def inside(compared):
    return compared.tables["inside"]


def test_energies_inside_the_action_close_and_are_those_of_its_parts(inside):
    energy = inside[inside["kind"] == "energy"].set_index("part")["energy_j"]
    work = energy["work of the force on the key"]
    assert work > 0.05
    assert energy.drop("work of the force on the key").sum() == pytest.approx(work, rel=1e-9)
    assert abs(energy["not accounted for: error of the integration"]) < 1e-4 * work
    parts = inside[inside["kind"] == "contact"]
    assert parts["felt_j"].sum() == pytest.approx(energy["lost in felt"], rel=1e-3)
    assert parts["friction_j"].sum() == pytest.approx(energy["lost by friction of contacts"], rel=1e-3)
    joints = inside[inside["kind"] == "joint"]
    assert joints["energy_j"].sum() == pytest.approx(energy["lost by friction of joints"], rel=1e-3)


def test_forces_inside_the_action_have_a_place_a_time_and_an_uncertainty(inside, compared):
    parts = inside.set_index("part")
    front = parts.loc["02 key front"]
    assert front["largest_n"] > 20.0  # the spike of `forte_n`, 33 N, and the key's own inertia
    assert 0.0 < front["u_largest_n"] < 0.2 * front["largest_n"]
    assert 0.455 < front["at_s"] < 0.480 and front["largest_m"] > 0.0
    assert set(parts["draws"]) == {OWN_DRAWS} and set(parts["trial"]) <= set(compared.traces)
    assert set(parts["kind"]) == {"energy", "contact", "joint"}  # nothing gives, and the string is a bar
    assert parts.loc["work of the force on the key", "u_energy_j"] > 0.0


@dataclass(frozen=True)
class Pressed:
    force_n: np.ndarray


def test_what_the_uncertainties_come_from_is_in_the_key_of_what_is_stored(monkeypatch):
    trial = SimpleNamespace(
        number=1,
        seal="one",
        has_force=True,
        driven_by_key=False,
        time_s=np.arange(3.0),
        force=Pressed(np.array([0.0, 5.0])),
    )
    action, path = model.load_action("hirschkorn2004"), "contact04.friction.A"
    tested, runs = ModelUnderTest(action, rivals=()), []

    def made(tested, m, draws):
        runs.append(m.number)
        return [{"trial": m.number, "u_energy_j": float(np.std([draw.changed[path] for draw in draws]))}]

    monkeypatch.setattr(module, "_make_rows", made)

    def u(changed, m):
        return inside_rows(SimpleNamespace(trials=[m]), changed, is_drawn=True)[0]["u_energy_j"]

    q = action.quantities[path]
    wider = replace(action, quantities={**action.quantities, path: replace(q, u=3 * q.u)})
    assert u(replace(tested, action=wider), trial) > 1.5 * u(tested, trial) == 1.5 * u(tested, trial)
    u(tested, SimpleNamespace(**{**vars(trial), "number": 2}))  # the number seeds the noise of the force
    assert runs == [1, 1, 2]


def test_a_comparison_without_a_report_looks_at_nothing_inside(recorded, monkeypatch):
    monkeypatch.setattr(module, "inside_rows", lambda *_, **__: pytest.fail("made, though nobody asked"))
    result = compare_session(
        recorded[0], recorded[1].action, budget=False, explain=False, rivals=(), keep_predictions=False
    )
    assert "inside" not in result.tables


def test_a_faulty_trial_stands_for_no_other(monkeypatch):
    """Of the shipped session those with a sign flipped, encoders swapped, a shifted film, and the soft blow."""
    asked = []
    monkeypatch.setattr(module, "inside_rows", lambda sound, *_, **__: asked.extend(sound.trials) or [])
    shipped = Path(__file__).parents[3] / "sessions" / "planted_faults"
    options = {"budget": False, "explain": False, "rivals": (), "keep_predictions": False}
    compare_session(shipped, **options, further=True)
    numbers = {m.number for m in asked}
    assert 1 in numbers and not numbers & {2, 3, 4, 7}
