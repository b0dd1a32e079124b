"""Guided calibrations: the virtual cell's true gain and zero come out within the stated uncertainty, and are used."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest

from rig.calibration import STANDARD_GRAVITY, changed, dead_weights, fit_line, null, shunt
from rig.configuration.rig_file import load_rig, parse_rig
from rig.errors import InputError
from tests.command_line import run

MASSES = (0.2, 1.0, 2.0)
RIG = parse_rig(load_rig("virtual").text.replace("block_s = 0.02", "block_s = 0.1"))
"""Reads at rest in a fifth of the calls."""


def weighed(make_backend, rig, masses=MASSES, gravity=9.81, **force):
    backend = make_backend(load_rig("virtual").config, noise_n=0.02, **force)
    asked = []

    def ask(instruction: str, mass: float) -> None:
        asked.append(instruction)
        backend.device.bench.hung_n = 9.81 * mass

    return dead_weights(rig, backend, masses, ask, u_mass_kg=1e-6, gravity=gravity), backend, asked


@pytest.mark.parametrize(("gain", "offset_n"), [(0.03, 0.4), (-0.015, -0.2)])
def test_dead_weights_find_gain_and_zero(gain, offset_n, make_backend, assert_safe) -> None:
    done, backend, asked = weighed(make_backend, RIG, gain_error=gain, offset_n=offset_n)
    assert asked[0] == asked[-1] == "take everything off the load cell" and len(asked) == 7
    found = done.found
    assert abs(found["gain_against_rig_file"] - (1 + gain)) < 3 * found["u_slope_relative"] < 0.003
    assert found["zero_n"] == pytest.approx((offset_n + 0.05 * (1 + gain)) / (1 + gain), abs=0.01)
    config = parse_rig(done.rig_text).config
    per_n = (config.force.electrical[1] - config.force.electrical[0]) / (config.force.physical_n[1])
    assert per_n == pytest.approx((1 + gain) * 2.0 / 111.2, rel=1e-3)
    assert config.force.u_gain_relative == found["u_slope_relative"] and "dead weights" in config.force.calibration
    assert_safe(backend)


def test_without_local_gravity_its_uncertainty_is_stated(make_backend) -> None:
    done, *_ = weighed(make_backend, RIG, gravity=None)
    assert done.found["gravity_m_per_s2"] == STANDARD_GRAVITY
    assert done.found["u_slope_relative"] > 0.015 / 9.81
    assert abs(done.found["gain_against_rig_file"] - 9.81 / STANDARD_GRAVITY) < 1e-3


@pytest.mark.parametrize(
    ("masses", "words"),
    [((0.5,), "from two"), ((0.5, 0.2), "rising"), ((0.0, 0.2), "above 0"), ((1.0, 20.0), "allowed 111.2 N")],
)
def test_weights_that_cannot_be_used_are_refused_before_anything_is_read(masses, words, make_backend) -> None:
    with pytest.raises(InputError, match=words):
        weighed(make_backend, RIG, masses)


def test_a_cell_that_does_not_follow_is_refused(make_backend) -> None:
    backend = make_backend(load_rig("virtual").config, noise_n=0.02)
    with pytest.raises(InputError, match="do not follow"):
        dead_weights(RIG, backend, MASSES, lambda *asked: None, u_mass_kg=0.0, gravity=9.81)


def test_the_shunt_corrects_the_gain_and_null_the_zero(make_backend, edited_rig) -> None:
    backend = make_backend(load_rig("virtual").config, noise_n=0.02, offset_n=0.3)
    done = shunt(RIG, backend)
    assert (
        done.found["gain"] == pytest.approx(1.0, abs=5e-4)
        and "shunt" in parse_rig(done.rig_text).config.force.calibration
    )
    with pytest.raises(InputError, match="expected 1.74"):
        shunt(edited_rig(("bridge_resistance_ohm = 350.0", "bridge_resistance_ohm = 700.0")), backend)
    with pytest.raises(InputError, match="no bridge"):
        shunt(load_rig("pcie6363"), backend)
    nulled = null(RIG, backend, lambda *asked: None)
    assert nulled.found["shift_n"] == pytest.approx(0.35, abs=0.01)
    config = parse_rig(nulled.rig_text).config.force
    assert config.offset_n == 0.0 and config.electrical[0] == pytest.approx(0.35 * 2 / 111.2, abs=2e-4)


def test_a_line_knows_its_uncertainty() -> None:
    random = np.random.default_rng(3)
    x = np.array([0, 1, 2, 5, 2, 1, 0.0])
    off = []
    for _ in range(400):
        fit = fit_line(x, 0.3 + 2 * x + 0.01 * random.standard_normal(7), "x")
        off.append((fit.slope - 2) / fit.u_slope)
    assert 0.9 < np.std(off) < 1.6  # Student's t with five degrees of freedom: 1.29
    with pytest.raises(InputError, match="3 readings at 3 values"):
        fit_line([0, 1, 2], [0, 1, 2], "x")


def test_values_change_and_everything_else_stays() -> None:
    text = load_rig("pcie6363").text
    new = changed(text, "force", {"u_gain_relative": 0.001, "offset_n": 0.5, "calibration": 'a "b" \\ c'})
    before, after = tomllib.loads(text), tomllib.loads(new)
    assert after["force"] == {**before["force"], "u_gain_relative": 0.001, "offset_n": 0.5, "calibration": 'a "b" \\ c'}
    assert {k: v for k, v in after.items() if k != "force"} == {k: v for k, v in before.items() if k != "force"}
    assert new.count("#") == text.count("#")
    hammer = tomllib.loads(changed(text, "encoders", {"sign": 1}, named="hammer"))["encoders"]
    assert [e["sign"] for e in hammer] == [1, 1, 1]
    with pytest.raises(InputError, match=r"no table \[nothing\]"):
        changed(text, "nothing", {})


def test_the_command_writes_a_rig_file_that_records(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "cal.toml"
    assert run("calibrate-force", "--weights", "0.5,1", "--gravity", "9.81", "--operator", "ana", "--out", out) == 0
    record = tomllib.loads((tmp_path / "cal.weights.toml").read_text())
    assert record["operator"] == "ana" and record["found"]["gain_against_rig_file"] == pytest.approx(1.002, abs=2e-3)
    assert run("record", "--rig", out, "--profile", "piano", "--trials", "1", "--out", tmp_path / "s") == 0
    capsys.readouterr()
    for wrong in (("--shunt", "--null"), (), ("--weights", "a,b"), ("--null", "--gravity", "3")):
        assert run("calibrate-force", *wrong, "--out", tmp_path / "b.toml") == 2
    assert run("calibrate-force", "--null", "--out", out) == 2
    assert "exists already" in capsys.readouterr().err
