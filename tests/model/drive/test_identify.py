"""Drives identified from logs of known ones: planted values, what a log leaves open, refusals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import model
from model import build_scene
from tests.model.drive.driven_log import command_of, driven_log

ACTION = model.load_action("hirschkorn2004-regulated")
TRUTH = {
    "torque": {"resistance": 1.4, "inductance": 2e-3, "torque_constant": 0.45, "current_gain": 1.7, "loop_gain": 14.0},
    "voltage": {"resistance": 0.8, "inductance": 1.5e-3, "torque_constant": 0.7, "voltage_gain": 1.6},
}
SCENE = {"torque": model.SCENES["motor-drive"], "voltage": model.SCENES["motor-voltage"]}


def planted(mode: str, **more: float) -> model.Action:
    scene = SCENE[mode]
    values = {f"motor_drive.{k}": v for k, v in (TRUTH[mode] | more).items()}
    return ACTION.with_effects(dict(scene.values) | values | {"motor_arm.inertia": 2e-4})


def log_of(mode: str, current: bool = True, push_n: float = 22.0, seed: int = 0, **more: float) -> model.drive.DriveLog:
    scene, action = replace(SCENE[mode], values=()), planted(mode, **more)
    return driven_log(action, scene, command_of(action, scene, seed + 1, push_n), seed=seed, current=current)


def test_planted_numbers_are_found_within_their_uncertainty_and_what_is_open_is_named() -> None:
    found = model.drive.identify_drive(log_of("torque"), model.drive.DriveOptions())
    wanted = TRUTH["torque"] | {"inertia": 2e-4}
    wanted["resistance_and_loop_gain"] = wanted["resistance"] + wanted["loop_gain"]
    seen = [e for e in (*found.drive, found["inertia"]) if e.determined]
    assert {"inductance", "torque_constant", "inertia"} < {e.name for e in seen}
    for e in seen:
        assert abs(e.value - wanted[e.name]) < 3.0 * e.u, e
        assert e.u < 0.15 * e.value, e
    assert not found["supply"].determined and "supply" in found["supply"].why
    assert not found["current_limit"].determined
    assert not found["resistance"].determined and not found["loop_gain"].determined
    assert found["resistance_and_loop_gain"].determined


def test_what_a_log_without_the_current_leaves_open_is_named() -> None:
    found = model.drive.identify_drive(replace(log_of("torque"), current_a=None), model.drive.DriveOptions())
    for name in ("inductance", "torque_constant", "current_gain"):
        assert not found[name].determined and np.isnan(found[name].value)
        assert "record the current" in found[name].why
    assert found["torque_per_volt"].determined and found["delay"].determined


def still(**rows: np.ndarray) -> model.drive.DriveLog:
    n = 300
    given = {"time_s": np.arange(n) / 5000.0, "command_v": np.sin(np.arange(n) / 9.0), "force_n": np.zeros(n)}
    return model.drive.DriveLog(**(given | {"arm_rad": np.zeros(n)} | rows))


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        ({"force_n": np.zeros(3)}, "force_n: found shape"),
        ({"arm_rad": np.full(300, np.nan)}, "not finite in row 1"),
        ({"command_v": np.ones(300)}, "same value throughout"),
        ({"time_s": np.arange(300) ** 1.1}, "equal ones"),
    ],
)
def test_logs_that_cannot_be_used_are_refused(rows: dict[str, np.ndarray], words: str) -> None:
    with pytest.raises(model.InputError, match=words) as caught:
        still(**rows)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"mode": "speed"}, "torque or voltage"),
        ({"length_m": 0.0}, "length of the arm"),
        ({"u_force": -1.0}, "u_force"),
        ({"known": {"voltage_gain": (1.0, 0.1)}}, "allowed resistance"),
        ({"known": {"resistance": (1.0, 0.0)}}, "both above 0"),
    ],
)
def test_options_that_cannot_be_are_refused(options: dict, words: str) -> None:
    with pytest.raises(model.InputError, match=words):
        model.drive.DriveOptions(**options)


def test_logs_of_something_else_are_refused() -> None:
    push = 12.0 * np.maximum(np.sin(np.arange(300) / 9.0), 0.0)
    noise = np.random.default_rng(1).normal(size=(2, 300))
    for rows, words in (
        ({}, "do not rise with the command"),
        ({"force_n": -push}, "do not rise with the command"),
        (
            {"force_n": 30.0 * np.abs(noise[0]) + 0.01 * push, "arm_rad": 1e-3 * noise[1]},
            "with the command|unexplained",
        ),
    ):
        with pytest.raises(model.InputError, match=words):
            model.drive.identify_drive(still(**rows))


def test_a_log_is_read_as_it_was_written(tmp_path) -> None:
    log = still(current_a=np.arange(300.0))
    columns = ("time_s", "command_v", "force_n", "arm_rad", "current_a")
    rows = np.stack([getattr(log, name) for name in columns], axis=1).tolist()
    text = "\n".join([",".join(columns), *(",".join(map(repr, row)) for row in rows)])
    (tmp_path / "log.csv").write_text(text + "\n", "utf-8")
    again = model.drive.read_drive_log(tmp_path / "log.csv")
    for name in columns:
        np.testing.assert_array_equal(getattr(again, name), getattr(log, name))
    (tmp_path / "short.csv").write_text("time_s,command_v\n0,1\n", "utf-8")
    with pytest.raises(model.InputError, match="short.csv"):
        model.drive.read_drive_log(tmp_path / "short.csv")


def test_readings_balance_energy_and_agree_with_the_solution() -> None:
    time_s, force_n = model.force_table("forte")
    at = np.linspace(0.0, 0.7, 14001)
    run = model.simulate(
        ACTION, time_s, force_n / 12.0, scene="motor-drive", energy=True, contact_forces=True, output_time_s=at,
        tolerance=1e-7,
    )  # fmt: skip
    seen = model.drive.drive_readings(ACTION, run, time_s, force_n / 12.0)
    assert run.energy is not None

    def total(power: np.ndarray) -> float:
        return float(np.sum(0.5 * (power[1:] + power[:-1]) * np.diff(at)))

    assert total(seen.power_in_w) == pytest.approx(run.energy.work_in, rel=1e-4)
    assert total(seen.heat_w) == pytest.approx(run.energy.lost_in_drive, rel=1e-4)
    mechanical = seen.torque_nm * run.speed_rad_per_s[:, run.bodies.index("motor")]
    left = seen.stored_j[-1] - seen.stored_j[0]
    assert total(seen.power_in_w - seen.heat_w - mechanical) == pytest.approx(left, abs=1e-4 * run.energy.work_in)
    assert seen.force_n.max() == pytest.approx(run.columns()["motor_arm_normal_n"].max())
    assert build_scene(ACTION, model.SCENES["motor-drive"]).command is not None
    with pytest.raises(model.InputError, match="without the effect motor_drive"):
        model.drive.drive_readings(ACTION, model.simulate(ACTION, time_s, force_n), time_s, force_n)
