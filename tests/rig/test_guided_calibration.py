"""A scale off its centre is found over the arc within its uncertainty, and trials recorded with it are right.

Guided calibrations: the virtual cell's true gain and zero come out within the stated uncertainty, and are used.

Free swings give the friction of a joint within its uncertainty, whatever the level, the start, or where it hangs.
"""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import rig
from rig import InputError, load_rig, parse_rig
from rig.calibration.encoder_scale import Arc, combine_with_rig_file, fit_arc, order_up_and_down, read_plateaus
from rig.calibration.joint_friction import fit_joint_friction, read_swing
from rig.calibration.line_fit import fit_line
from rig.calibration.load_cell import (
    STANDARD_GRAVITY,
    calibrate_with_shunt,
    calibrate_with_weights,
    calibrate_zero,
)
from rig.configuration.rig_file_edit import change_table
from rig.simulated.backend import DEFAULT_BENCH
from rig.simulated.bench.swing_plant import SwingPlant
from tests.command_line import run

ANGLES = (-0.04, -0.03, -0.02, -0.01, 0.0)


def off_centre(folder: Path, eccentricity: float) -> str:
    """A bench whose key scale sits off its centre: an error of so many rad that comes back with each revolution."""
    text = DEFAULT_BENCH.read_text("utf-8")
    head, key, tail = text.partition("[encoders.key]")
    assert "eccentricity_rad = 5.0e-5" in tail
    bench = folder / "bench.toml"
    tail = tail.replace("eccentricity_rad = 5.0e-5", f"eccentricity_rad = {eccentricity}", 1)
    bench.write_text(head + key + tail, encoding="utf-8")
    return f"sim://?bench={bench.as_posix()}"


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_error_of_the_arc_is_found_within_its_uncertainty(tmp_path: Path, seed: int) -> None:
    config = rig.load_rig("virtual").config
    references = order_up_and_down(ANGLES)
    address = off_centre(tmp_path, 0.02)
    listed = ",".join(map(str, references))
    bench = rig.open_backend(f"{address}&seed={seed}&pose=key:{listed}", config)
    readings = read_plateaus(bench, config, "key", references)
    # what this seed's mounting does over this arc, without counts and line division
    sensors = bench.device.bench._encoders  # type: ignore[attr-defined]
    rest = float(bench.plant._rest[0])  # type: ignore[attr-defined]
    bench.close()
    x = rest + np.array(references)
    truth = 1.0 / (1.0 + np.polyfit(x, 0.02 * np.sin(x + sensors._centre_rad[0]), 1)[0])
    arc = fit_arc(references, readings, 1e-6, config.encoders[0])
    assert abs(arc.gain - truth) < 3 * arc.u_gain < 1e-3
    assert len(readings) == 9 and arc.worst_rad < 2e-5


def test_a_trial_recorded_with_the_correction_reads_the_true_angle(tmp_path: Path, capsys: Any) -> None:
    address = off_centre(tmp_path, 0.03)
    out = tmp_path / "mine.toml"
    listed = ",".join(map(str, ANGLES))
    command = ("calibrate", "encoder", "--body", "key", f"--angles={listed}", "--u-angle", "1e-6", "--backend", address)
    assert run(*command, "--out", out) == 0
    assert "key: angle = " in capsys.readouterr().out
    turned = {}
    for name in ("virtual", out):
        bench = rig.open_backend(address, rig.load_rig(name).config)
        session = rig.record(
            tmp_path / f"s_{Path(name).stem}", profile="forte", trials=1, rig_config=name, backend=bench
        )
        truth = bench.plant.truth()  # type: ignore[attr-defined]
        bench.close()
        trial = session.trial(1).read()
        n = min(trial.n_valid, truth.time_s.size)
        key = truth.angle_rad[:n, 0] - truth.angle_rad[0, 0]
        turned[str(name)] = np.abs(trial.angle_rad[:n, 0] - key).max()
        info = trial.encoders[0]
    assert turned[str(out)] < 4e-5 < 2e-4 < turned["virtual"]
    assert info.arc_gain != 1.0 and info.u_eccentricity_rad < 5e-4
    assert run(*command, "--out", out) == 2


def test_coarse_references_spoil_no_scale_that_is_known_better() -> None:
    known = rig.load_rig("virtual")  # u_eccentricity_rad = 3.5e-5
    coarse = combine_with_rig_file(known, "key", Arc(1.0005, 4e-4, 0.0, (), ()))
    assert abs(coarse[0] - 1.0) < 1e-5 and coarse[1] < 3.5e-5
    contradicted = combine_with_rig_file(known, "key", Arc(1.01, 4e-4, 0.0, (), ()))
    assert contradicted == (1.01, 4e-4)
    unstated = parse_rig(known.text.replace("u_eccentricity_rad = 3.5e-5", ""))
    assert combine_with_rig_file(unstated, "key", Arc(1.0005, 4e-4, 0.0, (), ())) == (1.0005, 4e-4)


def test_a_reference_is_off_alike_on_the_way_up_and_down() -> None:
    up, encoder = np.array(ANGLES), load_rig("virtual").config.encoders[0]
    references = order_up_and_down(ANGLES)
    u = fit_arc(references, references, 1e-3, encoder).u_gain
    random = np.random.default_rng(5)
    gains = []
    for _ in range(2000):
        true = up + 1e-3 * random.standard_normal(up.size)
        gains.append(np.polyfit(references, [*true, *true[-2::-1]], 1)[0])
    assert u == pytest.approx(np.std(gains), rel=0.05)


def test_a_rig_file_that_cannot_be_rewritten_is_told_before_anything_is_read(tmp_path: Path, capsys: Any) -> None:
    file, text = tmp_path / "rig.toml", load_rig("virtual").text
    file.write_text(re.sub(r"(?m)^electrical = .*$", '"electrical" = [0.0, 2.0]', text, count=1), encoding="utf-8")
    asked = ("calibrate", "force", "--weights", "1,2", "--rig", file, "--out", tmp_path / "new.toml")
    assert run(*asked, "--backend", "ni-grpc://nobody:1") == 2
    assert "as calibrated: not a TOML file" in (said := capsys.readouterr().err) and "keys of [force] as" in said


def test_keys_that_are_indented_and_arrays_over_lines_are_replaced() -> None:
    text = "[force]\n  electrical = [\n    0.0,\n    2.0,\n  ] # mV/V\n\tu_gain = 1\n"
    made = change_table(text, "force", {"electrical": (0.25, 3.0), "u_gain": 5.0})
    assert tomllib.loads(made) == {"force": {"electrical": [0.25, 3.0], "u_gain": 5.0}} and "# mV/V" in made


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--angles=0,0.01",), "allowed from three, each once, rising"),
        (("--angles=0,x,1",), "allowed numbers in rad"),
        (("--angles=0,0.02,0.01",), "allowed from three, each once, rising"),
        (("--angles=0,0.01,0.02", "--u-angle", "1"), "--u-angle 1: allowed 0 to 0.01 rad"),
        (("--angles=0,0.01,0.02", "--backend", "sim://?pose=key:0,-0.01,-0.02,-0.01,0"), "do not follow|reads -1.0"),
        (("--angles=0,0.01,0.02", "--backend", "sim://?pose=jack:0"), "pose = 'jack:0'"),
    ],
)
def test_what_is_no_calibration_is_refused(tmp_path: Path, capsys: Any, arguments: Any, said: str) -> None:

    assert run("calibrate", "encoder", "--body", "key", *arguments, "--out", tmp_path / "a.toml") == 2
    assert re.search(said, capsys.readouterr().err)
    assert not (tmp_path / "a.toml").exists()


MASSES = (0.2, 1.0, 2.0)
RIG = parse_rig(load_rig("virtual").text.replace("block_s = 0.02", "block_s = 0.1"))
"""Reads at rest in a fifth of the calls."""


def weighed(make_backend, rig, masses=MASSES, gravity=9.81, **force):
    backend = make_backend(load_rig("virtual").config, noise_n=0.02, **force)
    asked = []

    def ask(instruction: str, mass: float) -> None:
        asked.append(instruction)
        backend.device.bench.hung_n = 9.81 * mass

    return calibrate_with_weights(rig, backend, masses, ask, u_mass_kg=1e-6, gravity=gravity), backend, asked


@pytest.mark.parametrize(("gain", "offset_n"), [(0.03, 0.4), (-0.015, -0.2)])
def test_dead_weights_find_gain_and_zero(gain, offset_n, make_backend, assert_safe) -> None:
    stale = parse_rig(RIG.text.replace("u_preload_n = 0.01", "u_preload_n = 0.01\noffset_n = -0.8"))
    done, backend, asked = weighed(make_backend, stale, gain_error=gain, offset_n=offset_n)
    assert asked[0] == asked[-1] == "take everything off the load cell" and len(asked) == 7
    found = done.found
    assert abs(found["gain_against_rig_file"] - (1 + gain)) < 3 * found["u_slope_relative"] < 0.003
    assert found["zero_n"] == pytest.approx((offset_n + 0.05 * (1 + gain)) / (1 + gain), abs=0.01)
    config = parse_rig(done.rig_text).config
    per_n = (config.force.electrical[1] - config.force.electrical[0]) / (config.force.physical_n[1])
    assert per_n == pytest.approx((1 + gain) * 2.0 / 111.2, rel=1e-3)
    assert config.force.offset_n == 0.0
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
        calibrate_with_weights(RIG, backend, MASSES, lambda *asked: None, u_mass_kg=0.0, gravity=9.81)


def test_the_shunt_corrects_the_gain_and_null_the_zero(make_backend, edited_rig) -> None:
    backend = make_backend(load_rig("virtual").config, noise_n=0.02, offset_n=0.3)
    done = calibrate_with_shunt(RIG, backend)
    assert (
        done.found["gain"] == pytest.approx(1.0, abs=5e-4)
        and "shunt" in parse_rig(done.rig_text).config.force.calibration
    )
    with pytest.raises(InputError, match="expected 1.74"):
        calibrate_with_shunt(edited_rig(("bridge_resistance_ohm = 350.0", "bridge_resistance_ohm = 700.0")), backend)
    with pytest.raises(InputError, match="no bridge"):
        calibrate_with_shunt(load_rig("pcie6363"), backend)
    nulled = calibrate_zero(RIG, backend, lambda *asked: None)
    assert nulled.found["shift_n"] == pytest.approx(0.35, abs=0.01)
    config = parse_rig(nulled.rig_text).config.force
    assert config.offset_n == 0.0 and config.electrical[0] == pytest.approx(0.35 * 2 / 111.2, abs=2e-4)


def test_the_shunt_scales_the_unloaded_reading_with_the_line(edited_rig) -> None:
    rig = edited_rig(("u_preload_n = 0.01", "u_preload_n = 0.01\noffset_n = -0.8"))
    expected = 1e3 * 350.0 / (4 * rig.config.selftest.shunt_ohm + 700.0)
    backend = SimpleNamespace(shunt_step=lambda config: 1.02 * expected)
    force = parse_rig(calibrate_with_shunt(rig, backend).rig_text).config.force
    assert force.offset_n == pytest.approx(-0.8 / 1.02) and force.electrical[1] == pytest.approx(2.04)


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
    new = change_table(text, "force", {"u_gain_relative": 0.001, "offset_n": 0.5, "calibration": 'a "b" \\ c'})
    before, after = tomllib.loads(text), tomllib.loads(new)
    assert after["force"] == {**before["force"], "u_gain_relative": 0.001, "offset_n": 0.5, "calibration": 'a "b" \\ c'}
    assert {k: v for k, v in after.items() if k != "force"} == {k: v for k, v in before.items() if k != "force"}
    assert new.count("#") == text.count("#")
    hammer = tomllib.loads(change_table(text, "encoders", {"sign": 1}, named="hammer"))["encoders"]
    assert [e["sign"] for e in hammer] == [1, 1, 1]
    with pytest.raises(InputError, match=r"no table \[nothing\]"):
        change_table(text, "nothing", {})


def test_the_command_writes_a_rig_file_that_records(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "cal.toml"
    figure = tmp_path / "cal.svg"
    arguments = ("--gravity", "9.81", "--operator", "ana", "--out", out, "--figure", figure)
    assert run("calibrate", "force", "--weights", "0.5,1", *arguments) == 0
    assert "weight, N" in figure.read_text("utf-8")
    record = tomllib.loads((tmp_path / "cal.weights.toml").read_text())
    assert record["operator"] == "ana" and record["found"]["gain_against_rig_file"] == pytest.approx(1.002, abs=2e-3)
    assert run("record", "--rig", out, "--profile", "piano", "--trials", "1", "--out", tmp_path / "s") == 0
    capsys.readouterr()
    for wrong in (
        ("--shunt", "--null"),
        (),
        ("--weights", "a,b"),
        ("--null", "--gravity", "3"),
        ("--null", "--figure", "a.svg"),
    ):
        assert run("calibrate", "force", *wrong, "--out", tmp_path / "b.toml") == 2
    assert run("calibrate", "force", "--null", "--out", out) == 2
    assert "exists already" in capsys.readouterr().err


RATE_HZ = 5000.0


def swung(share: float, lifted: float, hanging: float, counts: int, viscous: float = 0.0) -> np.ndarray:
    """A pendulum of 1.5 Hz with dry friction, by small explicit steps, as an encoder reads it."""
    omega2, h, angle, speed = (2 * np.pi * 1.5) ** 2, 1e-4, lifted, 0.0
    seen = [angle] * 500
    for k in range(int(20 / h)):
        pull = -omega2 * np.sin(angle)
        if abs(speed) < 1e-5 and abs(pull) <= share * omega2:
            break
        sense = np.sign(speed) if speed else np.sign(pull)
        after = speed + h * (pull - sense * share * omega2 - viscous * speed)
        speed = 0.0 if speed and np.sign(after) != np.sign(speed) else after
        angle += h * speed
        if k % 2 == 0:
            seen.append(angle)
    read = np.asarray(seen + [angle] * 3000) + hanging
    return np.floor(read * counts / (2 * np.pi)) * 2 * np.pi / counts


@pytest.mark.parametrize(
    ("share", "lifted", "hanging", "counts"),
    [(0.02, 0.6, 0.0, 327680), (0.07, 1.0, 2.3, 163840), (0.12, -1.2, -0.7, 327680), (0.05, 0.9, 1.0, 20000)],
)
def test_the_friction_is_found_within_its_uncertainty(share: float, lifted: float, hanging: float, counts: int) -> None:
    found = fit_joint_friction(swung(share, lifted, hanging, counts), RATE_HZ, "hammer")
    assert abs(found.share - share) < 3 * found.u_share < 0.03 * share
    assert found.frequency_hz == pytest.approx(1.5, rel=2e-3)


def test_a_loss_that_grows_with_the_speed_widens_the_uncertainty() -> None:
    """The law is dry friction; what is not shows as half swings that disagree."""
    plain = fit_joint_friction(swung(0.05, 1.0, 0.0, 327680), RATE_HZ, "hammer")
    oiled = fit_joint_friction(swung(0.05, 1.0, 0.0, 327680, viscous=0.3), RATE_HZ, "hammer")
    assert oiled.share > plain.share and oiled.u_share > 10 * plain.u_share


def test_too_much_friction_is_said() -> None:
    with pytest.raises(rig.RigInputError, match="half swings of 0.1 rad or more, allowed from 3"):
        fit_joint_friction(swung(0.3, 0.8, 0.0, 327680), RATE_HZ, "key")


@pytest.mark.parametrize(("body", "seed"), [("hammer", 3), ("whippen", 4)])
def test_the_specimens_joint_is_found_on_the_bench(body: str, seed: int) -> None:
    config = rig.load_rig("virtual").config
    bench = rig.open_backend(f"sim://?swing={body}&seed={seed}", config)
    angle, rate_hz = read_swing(bench, config, body)
    found = fit_joint_friction(angle, rate_hz, body)
    plant = bench.plant  # type: ignore[attr-defined]
    assert isinstance(plant, SwingPlant)
    friction, weight = plant.truth()
    assert abs(found.share - friction / weight) < 3 * found.u_share < 0.005 * friction / weight
    bench.close()


def test_a_body_that_is_not_let_go_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rig.calibration.joint_friction.LONGEST_SWING_S", 6.0)
    config = rig.load_rig("virtual").config
    bench = rig.open_backend(f"sim://?bench={DEFAULT_BENCH.as_posix()}", config)
    with pytest.raises(rig.RigInputError, match="the hammer did not swing within 6 s"):
        read_swing(bench, config, "hammer")
    bench.close()
