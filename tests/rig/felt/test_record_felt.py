"""A felt pressed on the virtual bench is found again within the stated uncertainty: several felts and compliances."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

import rig
from model.calibration import damping_factor, fit_felt, read_curve
from rig.configuration.rig_file_edit import change_table
from rig.simulated.backend import DEFAULT_BENCH

LONG_BLOCKS = {"block_s": 0.1}
"""A fifth of the calls."""
GAIN_ERROR, PRELOAD_N = 0.004, 0.06
"""Of the load cell, and what the arm's spring really presses with: within 1.4 of what the rig file states."""


def long_blocks() -> rig.Rig:
    return rig.parse_rig(change_table(rig.load_rig("virtual").text, "recording", LONG_BLOCKS))


@dataclass(frozen=True)
class Bench:
    """A bench whose felt and compliance are planted, and the rig file that misjudges it by ``off`` u."""

    address: str
    rig: rig.Rig
    abcd: np.ndarray


def planted(folder: Path, contact: str, stiffness: float, off: float, seed: int, u: float = 0.05) -> Bench:
    text = DEFAULT_BENCH.read_text("utf-8")
    for old, new in (
        ("contact_c = 2.0e5 ", f"contact_c = {stiffness:.1f} "),
        ("gain_error = 0.002", f"gain_error = {GAIN_ERROR}"),
        ("preload_n = 0.05 ", f"preload_n = {PRELOAD_N} "),
    ):
        assert old in text
        text = text.replace(old, new)
    bench = folder / "bench.toml"
    bench.write_text(text, encoding="utf-8")
    compliance = 1.0 / stiffness
    values = {"compliance_m_per_n": compliance * (1 + off * u), "u_compliance_m_per_n": compliance * u}
    rig_text = change_table(rig.load_rig("virtual").text, "felt", values)
    rig_text = change_table(rig_text, "recording", LONG_BLOCKS)
    address = f"sim://?felt={contact}&bench={bench.as_posix()}&seed={seed}"
    opened = rig.simulated.load_plant(bench, seed, 5000.0).action
    return Bench(address, rig.parse_rig(rig_text), np.array([opened[f"{contact}.normal.{k}"] for k in "abcD"]))


def test_the_felt_is_recovered_within_its_uncertainty(tmp_path: Path) -> None:
    contact, speed = "contact07", 0.006
    bench = planted(tmp_path, contact, 1.5e5, -0.7, seed=9)
    order = rig.FeltOrder(contact, (speed,), (20.0,), rest_s=0.0)
    done = rig.record_felt(tmp_path / "s", order, rig_config=bench.rig, backend=bench.address)
    assert [trial.status for trial in done.session.trials] == ["complete", "complete"]
    assert done.session.info.kind == "felt"
    (press,) = done.presses
    assert press.curve.speed_m_per_s == pytest.approx(speed, rel=0.1) and abs(press.curve.swing) < 0.05
    fit = fit_felt(read_curve(press.file))
    found = damping_factor(fit, press.curve.speed_m_per_s, press.curve.u_speed_m_per_s)
    assert np.all(np.abs(fit.abc - bench.abcd[:3]) < 3.0 * fit.u_abc), (fit.abc - bench.abcd[:3]) / fit.u_abc
    assert abs(found.d - bench.abcd[3]) < 3.0 * found.u_d
    # the uncertainty says something: the force at 0.9 of the depth is known to some percent
    x = 0.9 * press.curve.deepest_m
    row = np.array([x**3, x**2, x])
    truth = float(row @ bench.abcd[:3])
    u = float(np.sqrt(row @ fit.covariance @ row))
    assert u < 0.05 * truth and abs(float(row @ fit.abc) - truth) < 3.0 * u
    assert "compliance" in fit.off and fit.law_fits


def test_the_block_gives_the_compliance_and_a_rig_file_with_it(tmp_path: Path) -> None:
    text = DEFAULT_BENCH.read_text("utf-8").replace("contact_c = 2.0e5 ", "contact_c = 1.1e5 ")
    (tmp_path / "bench.toml").write_text(text, encoding="utf-8")
    address = f"sim://?felt=block&bench={(tmp_path / 'bench.toml').as_posix()}"
    order = rig.FeltOrder("block", peaks_n=(30.0,), rest_s=0.0)
    done = rig.record_felt(tmp_path / "s", order, rig_config=long_blocks(), backend=address)
    found = done.compliance
    assert found is not None and not done.presses
    truth = 1.0 / 1.1e5 + 1e-9
    assert abs(found.m_per_n - truth) < 3.0 * found.u_m_per_n < 0.03 * truth
    setup = rig.parse_rig(done.rig_text).config.felt
    assert setup is not None and setup.compliance_m_per_n == pytest.approx(found.m_per_n, rel=1e-4)
    assert setup.u_compliance_m_per_n == pytest.approx(found.u_m_per_n, rel=1e-4)


def test_a_felt_too_hard_for_the_speed_says_how_fast_it_may_be(tmp_path: Path) -> None:
    order = rig.FeltOrder("contact10", (0.05,), (20.0,))
    with pytest.raises(rig.RigInputError, match=r"needs .* N/s, allowed 1800 N/s .*; press at 0\.0\d+ m/s at most"):
        rig.record_felt(tmp_path / "s", order, rig_config=long_blocks(), backend="sim://?felt=contact10")
    assert [trial.status for trial in rig.Session.open(tmp_path / "s").trials] == ["complete"]


def test_force_and_depth_have_their_limits(tmp_path: Path) -> None:
    with pytest.raises(rig.RigInputError, match=r"peak force 60 N, allowed 1 to 50 N \(felt.force_limit_n\)"):
        rig.record_felt(tmp_path / "a", rig.FeltOrder("contact02", peaks_n=(60.0,)), backend="sim://?felt=contact02")
    assert not (tmp_path / "a").exists()
    shallow = rig.parse_rig(change_table(rig.load_rig("virtual").text, "felt", {"depth_limit_m": 2e-4}))
    with pytest.raises(rig.LimitExceeded, match=r"key encoder: -0\.00\d+ rad from rest .* allowed"):
        rig.record_felt(tmp_path / "b", rig.FeltOrder("contact02"), rig_config=shallow, backend="sim://?felt=contact02")
    assert [trial.status for trial in rig.Session.open(tmp_path / "b").trials] == ["fault"]


def test_what_ends_a_recording_takes_no_curve_with_it(tmp_path: Path) -> None:
    def stop(trial: rig.Trial) -> None:
        if trial.number == 2:
            raise KeyboardInterrupt

    order = rig.FeltOrder("contact02", (0.01, 0.02), (15.0,), rest_s=0.0)
    with pytest.raises(KeyboardInterrupt):
        rig.record_felt(
            tmp_path / "s", order, rig_config=long_blocks(), backend="sim://?felt=contact02", after_trial=stop
        )
    assert [file.name for file in (tmp_path / "s" / "derived" / "felt").iterdir()] == ["trial_0002.csv"]


def test_an_arm_that_is_not_on_the_felt_is_stopped_or_refused(tmp_path: Path) -> None:
    """The action is under the arm, not a felt: the key gives way beyond what a felt may."""
    with pytest.raises(rig.RigError, match=r"encoder|felt"):
        rig.record_felt(tmp_path / "s", rig.FeltOrder("contact02"), backend="sim://")


def test_a_rig_without_felt_is_refused_before_anything_moves(tmp_path: Path) -> None:
    text = rig.load_rig("virtual").text
    without = rig.parse_rig(text[: text.index("[felt]")])
    with pytest.raises(rig.RigInputError, match=r"has no table \[felt\]"):
        rig.record_felt(tmp_path / "s", rig.FeltOrder("contact02"), rig_config=without)
    assert not (tmp_path / "s").exists()
