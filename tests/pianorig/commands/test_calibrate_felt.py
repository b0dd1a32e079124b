"""``pianorig calibrate felt`` as a user meets it."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import model
from model import force_table
from pianorig.errors import CommandInputError
from pianorig.workflows import read_driving_force
from tests.command_line import run


@pytest.fixture
def felt(tmp_path: Path) -> Path:
    """A loading experiment on the key-front felt of the built-in action, D = 1.5 s/m at 0.16 m/s."""
    action = model.load_action()
    a, b, c = (action[f"contact02.normal.{k}"] for k in "abc")
    x = np.concatenate([np.linspace(0, 1.2e-3, 60), np.linspace(1.2e-3, 0, 50)])
    swing = np.where(np.arange(110) < 60, 1 + 1.5 * 0.16, 1 - 1.5 * 0.16)
    f = (a * x**3 + b * x**2 + c * x) * swing + np.random.default_rng(9).normal(0.0, 0.1, 110)
    rows = "".join(f"{one!r},{two!r}\n" for one, two in zip(x.tolist(), f.tolist(), strict=True))
    (tmp_path / "felt.csv").write_text("displacement_m,force_n\n" + rows)
    return tmp_path / "felt.csv"


def test_curve_to_action_file(felt: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, figure = felt.with_name("mine.toml"), felt.with_name("felt.svg")
    arguments = [str(felt), "--contact", "contact02", "--speed", "0.16", "--out", str(out), "--figure", str(figure)]
    assert run("calibrate", "felt", *arguments, "--json") == 0
    facts = json.loads(capsys.readouterr().out)["felt"]
    before, after = model.load_action(), model.load_action(out)
    for k, u in zip("abc", facts["u_abc"], strict=True):
        path = f"contact02.normal.{k}"
        assert abs(after[path] - before[path]) < 3.0 * u
        assert after.quantities[path].u == pytest.approx(u) and after.quantities[path].basis == "measured"
    d = facts["D"]["--speed"]
    assert abs(after["contact02.normal.D"] - 1.5) < 3.0 * d["u"]
    assert after["contact01.normal.a"] == before["contact01.normal.a"]
    assert figure.read_text().startswith("<?xml")


def test_two_blows_give_the_ratio_of_the_dampings(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("thesis-forte", "piano"):
        time, force = force_table(name)
        rows = "".join(f"{t!r},{f!r}\n" for t, f in zip(time.tolist(), force.tolist(), strict=True))
        (tmp_path / f"{name}.csv").write_text("time_s,force_n\n" + rows)
    blows = [str(tmp_path / f"{name}.csv") for name in ("thesis-forte", "piano")]
    assert run("calibrate", "felt", "--force", blows[0], "--force", blows[1]) == 0
    lines = capsys.readouterr().out.splitlines()
    name, forte, piano, ratio = lines[2 + 11].split()
    assert name == "contact12" and float(forte) > 1.5 * float(piano)
    assert float(ratio) == pytest.approx(float(forte) / float(piano), rel=0.01)
    assert "four to five times" in lines[-1]
    motion = tmp_path / "moved.csv"
    assert run("simulate", "--force", blows[0], "--out", str(motion)) == 0
    capsys.readouterr()
    assert run("calibrate", "felt", "--motion", str(motion), "--json") == 0
    speeds = json.loads(capsys.readouterr().out)["blows"]["moved"]
    assert speeds["contact12"]["mean_normal_speed_m_per_s"] == pytest.approx(float(forte), rel=0.01)


def test_measured_numbers_go_into_the_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "mine.toml"
    friction = ["--friction", "0.45+-0.01", "0.33+-0.02", "--contact", "contact10"]
    pendulum = ["--pendulum", "0.01174+-1e-5", "0.1032+-2e-4", "0.7+-1e-3", "--body", "hammer"]
    rebound = ["--rebound", "2.35+-0.01", "1.85+-0.02"]
    assert run("calibrate", "felt", *friction, *pendulum, *rebound, "--out", str(out)) == 0
    done = model.load_action(out)
    assert (done["contact10.friction.A"], done.quantities["contact10.friction.A"].u) == (0.33, 0.02)
    assert done["contact12.normal.D"] == pytest.approx(0.1715, abs=1e-4)
    pivot = 0.01174 * 9.81 * 0.1032 * (0.7 / (2 * np.pi)) ** 2
    assert done["hammer.inertia"] == pytest.approx(pivot - 0.01174 * 0.1032**2, rel=1e-12)
    assert "pendulum 0.01174+-1e-5" in done.quantities["hammer.inertia"].source
    assert "rebound" not in done.quantities["hammer.inertia"].source


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], "nothing to calibrate"),
        (["absent.csv"], "absent.csv: cannot be read"),
        (["{felt}", "--contact", "contact14"], "--contact contact14: not found"),
        (["{felt}", "--speed", "fast"], "--speed 'fast': allowed a number"),
        (["{felt}", "--out", "mine.toml"], "nothing to write"),
        (["{felt}", "--figure", "f.jpeg"], "allowed .svg"),
        (["--figure", "f.svg", "--friction", "0.4", "0.3"], "--figure: draws a loading experiment"),
        (["--friction", "0.2", "0.3"], "mu_s / mu_k found 0.666"),
        (["--friction", "0.4+--1", "0.3"], "uncertainty found -1"),
        (["--friction", "0.4", "0.3", "--out", "mine.toml", "--contact", "contact01"], "without uncertainty"),
        (["--pendulum", "0.1", "0.2", "0.5"], "allowed above 0.8971 s"),
        (["--pendulum", "0.1", "0.2", "1.5", "--body", "arm"], "--body arm: not found"),
    ],
)
def test_bad_input_is_one_line(arguments: list[str], words: str, felt: Path, refused: Callable[..., None]) -> None:
    refused(words, "calibrate", "felt", *[a.replace("{felt}", str(felt)) for a in arguments])


def test_several_presses_give_each_law_its_held_out_error(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    action = model.load_action()
    law = model.felt.HuntCrossley(*(action[f"contact02.normal.{k}"] for k in "abc"), 0.7)
    rng = np.random.default_rng(6)
    paths = []
    for depth in (3e-4, 8e-4):
        for speed in (0.005, 0.08):
            time_s = np.linspace(0.0, 2.0 * depth / speed, 61)
            depth_m = depth - speed * np.abs(time_s - time_s[30])
            force_n = law.response(time_s, depth_m).force_n + rng.normal(0.0, 0.01, 61)
            rows = "".join(f"{t!r},{x!r},{f!r}\n" for t, x, f in np.column_stack([time_s, depth_m, force_n]).tolist())
            paths.append(tmp_path / f"{depth}_{speed}.csv")
            paths[-1].write_text("time_s,displacement_m,force_n\n" + rows)
    out, figure = tmp_path / "mine.toml", tmp_path / "laws.svg"
    named = [str(path) for path in paths]
    arguments = ["--contact", "contact02", "--out", str(out), "--figure", str(figure), "--json"]
    assert run("calibrate", "felt", str(tmp_path / "*_0.0*.csv"), *arguments) == 0
    facts = json.loads(capsys.readouterr().out)["felt_laws"]
    errors = {law: np.mean(list(one["held_out_error"].values())) for law, one in facts["laws"].items()}
    assert set(errors) == set(model.felt.LAWS) and min(errors, key=errors.__getitem__) == "hunt-crossley"
    d, u = (facts["laws"]["hunt-crossley"][k]["D"] for k in ("values", "u"))
    assert abs(d - 0.7) < 5.0 * u and u < 0.05
    assert model.load_action(out)["contact02.normal.D"] == pytest.approx(d)
    assert figure.read_text().startswith("<?xml")
    assert run("calibrate", "felt", *named, "--speed", "0.1") == 2
    assert "D of one curve" in capsys.readouterr().err
    assert run("calibrate", "felt", *named[:2]) == 2
    assert "found 2 presses, allowed 3 or more" in capsys.readouterr().err
    assert run("calibrate", "felt", str(tmp_path / "none*.csv"), "--contact", "contact02") == 2
    assert "none*.csv: cannot be read" in capsys.readouterr().err


def test_a_blow_of_a_trial_starts_at_rest_under_the_arms_preload(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    starts = []

    def simulate(*given: object, initial: model.RestState) -> None:
        starts.append(initial.angle_rad)
        raise CommandInputError("seen")

    monkeypatch.setattr(model, "simulate", simulate)
    action, trial = model.load_action(), Path(__file__).parents[3] / "sessions" / "example_forte" / "trial_0001.h5"
    assert run("calibrate", "felt", "--force", trial) == 2 and "seen" in capsys.readouterr().err
    loaded = model.rest_state(action, force_n=read_driving_force(trial).preload_n)
    np.testing.assert_array_equal(starts[0], loaded.angle_rad)
    assert np.abs(loaded.angle_rad - model.rest_state(action).angle_rad).max() > 1e-6
