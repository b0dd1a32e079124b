"""A scale off its centre is found over the arc within its uncertainty, and trials recorded with it are right."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rig
from rig.calibration import Arc, fit_arc, read_plateaus, there_and_back, with_what_was_known
from rig.simulated.backend import DEFAULT_BENCH
from tests.command_line import run

ANGLES = (-0.04, -0.03, -0.02, -0.01, 0.0)
KEY = "cDAQ1Mod3/ctr0"


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
    references = there_and_back(ANGLES)
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
    arc = fit_arc(references, readings, 1e-6, KEY)
    assert abs(arc.gain - truth) < 3 * arc.u_gain < 1e-3
    assert len(readings) == 9 and arc.worst_rad < 2e-5


def test_a_trial_recorded_with_the_correction_reads_the_true_angle(tmp_path: Path, capsys: Any) -> None:
    address = off_centre(tmp_path, 0.03)
    out = tmp_path / "mine.toml"
    listed = ",".join(map(str, ANGLES))
    command = ("calibrate-encoder", "--body", "key", f"--angles={listed}", "--u-angle", "1e-6", "--backend", address)
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
        turned[str(name)] = np.abs(trial.angle_rad()[:n, 0] - key).max()
        info = trial.encoders[0]
    assert turned[str(out)] < 4e-5 < 2e-4 < turned["virtual"]
    assert info.arc_gain != 1.0 and info.u_eccentricity_rad < 5e-4
    assert run(*command, "--out", out) == 2


def test_coarse_references_spoil_no_scale_that_is_known_better() -> None:
    known = rig.load_rig("virtual")  # u_eccentricity_rad = 3.5e-5
    coarse = with_what_was_known(known, "key", Arc(1.0005, 4e-4, 0.0, (), ()))
    assert abs(coarse[0] - 1.0) < 1e-5 and coarse[1] < 3.5e-5
    contradicted = with_what_was_known(known, "key", Arc(1.01, 4e-4, 0.0, (), ()))
    assert contradicted == (1.01, 4e-4)


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

    assert run("calibrate-encoder", "--body", "key", *arguments, "--out", tmp_path / "a.toml") == 2
    assert re.search(said, capsys.readouterr().err)
    assert not (tmp_path / "a.toml").exists()
