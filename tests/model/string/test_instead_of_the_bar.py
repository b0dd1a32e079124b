"""Bar and string under one hammer: closed forms of the bar, a string that hardly gives, the action's own hammer."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import model
from model.errors import InputError
from model.string import C4, Hammer, compare_with_bar, hammer_at_the_string, strike
from model.string.instead_of_the_bar import strike_bar
from tests.command_line import run

MASS, STIFFNESS = 0.009, 4e4


def test_a_linear_bar_is_half_a_swing() -> None:
    blow = strike_bar(Hammer(MASS, c=STIFFNESS), 2.0)
    assert blow.contact_s == pytest.approx(math.pi * math.sqrt(MASS / STIFFNESS), rel=1e-5)
    assert blow.peak_n == pytest.approx(2.0 * math.sqrt(MASS * STIFFNESS), rel=1e-3)
    assert blow.rebound == pytest.approx(1.0, rel=1e-6)


def test_a_string_that_hardly_gives_is_the_bar() -> None:
    hammer = Hammer(0.003, c=2e3, d=0.05)
    stiff = replace(C4, mass_kg=0.06, tension_n=9e3)
    bar, string = strike_bar(hammer, 1.0), strike(stiff, hammer, 1.0, tolerance=1e-2)
    soft = math.sqrt(0.003 * 2e3) / (2.0 * math.sqrt(stiff.tension_n * stiff.mass_kg / stiff.length_m))
    assert soft < 0.05  # impedance of hammer over that of string
    assert string.contact_time_s == pytest.approx(bar.contact_s, rel=4.0 * soft)
    assert string.peak_n == pytest.approx(bar.peak_n, rel=4.0 * soft)
    _, one, _ = compare_with_bar(hammer, [1.0], stiff)
    assert one.peak_n == pytest.approx(string.peak_n, rel=0.02)


def test_the_actions_own_hammer() -> None:
    action = model.load_action()
    hammer, speed = hammer_at_the_string(action, *model.force_table("forte"))
    seen = model.simulate(action, *model.force_table("forte"), contact_forces=True)
    blow = model.study.measure_blow(action, seen, model.force_table("forte")[1])
    assert speed == pytest.approx(blow.strike_m_per_s, rel=0.01)
    assert (hammer.a, hammer.d) == (action["contact12.normal.a"], action["contact12.normal.D"])
    time_s, force_n = model.force_table("forte")
    with pytest.raises(InputError, match="does not reach it"):
        hammer_at_the_string(action, time_s, 0.02 * force_n)


@pytest.mark.parametrize(
    ("given", "found"),
    [
        (model.load_action().with_laws({"contact12": "stulov"}), "stulov"),
        (model.load_scene("flexible-shank").on(model.load_action()), "shank"),
        (model.load_scene("giving-joints").on(model.load_action()), "hammer_pin"),
    ],
)
def test_a_hammer_that_is_no_mass_on_the_thesis_felt_is_refused(given: model.Action, found: str) -> None:
    with pytest.raises(InputError, match=f"hammer at the string: found {found}, allowed a stiff hammer"):
        hammer_at_the_string(given, *model.force_table("forte"))


def test_a_table_of_four_rows_is_the_blow_that_it_describes() -> None:
    """The motion was looked at where the table has rows: between them the hammer came and went unseen."""
    action = model.load_action("hirschkorn2004-regulated")
    fine = model.output_times(0.0, 0.3, 5000.0)
    corners = [0.0, 0.02, 0.075, 0.3], [0.0, 10.0, 9.0, 0.0]
    hammer, speed = hammer_at_the_string(action, *corners)
    same, as_fast = hammer_at_the_string(action, fine, np.interp(fine, *corners))
    assert 3.0 < speed < 4.0
    assert (speed, hammer.mass_kg) == (pytest.approx(as_fast, rel=1e-5), pytest.approx(same.mass_kg, rel=1e-5))
    given = model.SceneChoice(effects=("key_pin",)).on(action)
    assert hammer_at_the_string(given, *corners)[1] == pytest.approx(speed, rel=0.02)


def test_a_hammer_without_string_or_force_is_refused() -> None:
    action = model.load_action()
    with pytest.raises(InputError, match="found a scene without contact12, allowed one in which the hammer meets it"):
        hammer_at_the_string(action.with_values({"contact12": 0}), *model.force_table("forte"))
    with pytest.raises(InputError, match="driven by torque_nm, allowed one with all bodies driven by force_n"):
        hammer_at_the_string(model.load_scene("motor-arm").on(action), *model.force_table("forte"))


@pytest.mark.slow
def test_study_string(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("study", "string", "--out", str(tmp_path / "s"), "--json") == 0
    facts = json.loads(capsys.readouterr().out)
    assert [blow["against"] for blow in facts["blows"][:3]] == ["bar", "string", "choir"]
    assert facts["blows"][0]["slope_db_per_octave"] is None
    assert (tmp_path / "s" / "string.csv").read_text().startswith("against,speed_m_per_s")
    assert run("study", "string", "--variant", "dry: --scale damping=0.1") == 2
    assert "has its own variants" in capsys.readouterr().err
