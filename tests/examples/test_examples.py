"""Examples that take files or serve: what they answer. The others are run by `.ci/pages`."""

from __future__ import annotations

import contextlib
import io
import json
import runpy
import subprocess
import sys
from pathlib import Path

import grpc
import nidaqmx
import numpy as np
import pandas as pd
import pytest
import xarray as xr

import model

EXAMPLES = Path(__file__).parents[2] / "examples"


def test_data_set_scores_its_own_measurements_as_perfect(tmp_path: Path) -> None:
    """Rows scaled by 1.1 miss by a tenth of each angle; a fault that is planted changes what it says."""
    script = runpy.run_path(str(EXAMPLES / "dataset" / "make_dataset.py"))
    time_s = np.arange(0.0, 0.5, 1e-3)
    angles = {name: k * np.maximum(time_s - 0.3, 0.0) for k, name in enumerate(("key", "whippen", "hammer"), 1)}
    trial = xr.Dataset(
        {"force": ("time", time_s), **{f"{name}_angle": ("time", angle) for name, angle in angles.items()}},
        coords={"time": time_s},
    )
    trial.to_netcdf(tmp_path / "one.nc", engine="h5netcdf")
    pd.DataFrame([{"trial": 1, "part": "test", "file": "one.nc"}]).to_csv(tmp_path / "trials.csv", index=False)
    (tmp_path / "truth.json").write_text(json.dumps({"1": {"fault": ""}}))
    mine = trial.to_dataframe().reset_index().assign(trial=1)
    for factor, percent in ((1.0, 0.0), (1.1, 100 * 0.1 * np.sqrt(np.mean((angles["key"] / 0.199)[200:] ** 2)))):
        columns = [f"{name}_angle" for name in angles]
        mine.assign(**{name: factor * mine[name] for name in columns}).to_csv(tmp_path / "mine.csv", index=False)
        with contextlib.redirect_stdout(io.StringIO()) as said:
            script["score"](tmp_path, tmp_path / "mine.csv")
        assert f"score: {percent:.2f} %" in said.getvalue()
    changed = {name: script["plant_fault"](name, trial) for name in script["FAULTS"]}
    assert all(not one.identical(trial) for one in changed.values())
    assert float(changed["force gain"]["force"][-1]) == pytest.approx(1.15 * time_s[-1])


def test_a_program_of_ones_own_uses_the_served_bench() -> None:
    command = [sys.executable, str(EXAMPLES / "serve_sim.py"), "--rig", "pcie6363", "--port", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        said = server.stdout.readline()
        with grpc.insecure_channel(said.split()[-1]) as channel:
            options = nidaqmx.GrpcSessionOptions(channel, "mine")
            with nidaqmx.Task("mine", grpc_options=options) as task:
                task.ai_channels.add_ai_voltage_chan("Dev1/ai0:1")
                task.timing.cfg_samp_clk_timing(1000.0, samps_per_chan=50)
                assert np.array(task.read(nidaqmx.constants.READ_ALL_AVAILABLE)).shape == (2, 50)
                with pytest.raises(nidaqmx.DaqError, match="CreateAIThrmcplChan: rig.daq never asks for it"):
                    task.ai_channels.add_ai_thrmcpl_chan("Dev1/ai2")
        server.terminate()
    assert said.startswith("virtual bench on localhost:")


def test_laws_that_presses_rule_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Seven presses of a felt of the thesis's law; four rule nothing out; a cube without a loop is every law."""
    script = runpy.run_path(str(EXAMPLES / "felt_laws.py"))
    rng = np.random.default_rng(1)

    def write(law: model.felt.FeltLaw, count: int) -> list[str]:
        paths = []
        for k, depth in enumerate(np.linspace(3e-4, 9e-4, count)):
            time_s = np.linspace(0.0, 2.0 * depth / (speed := (0.005, 0.02, 0.08)[k % 3]), 101)
            depth_m = depth - speed * np.abs(time_s - time_s[50])
            force_n = law.response(time_s, depth_m).force_n + rng.normal(0.0, 0.02, 101)
            rows = np.column_stack([time_s, depth_m, force_n])
            paths.append(str(tmp_path / f"{count}_{k}.csv"))
            np.savetxt(paths[-1], rows, delimiter=",", header="time_s,displacement_m,force_n", comments="")
        return paths

    damped = model.felt.HuntCrossley(4.41e10, -1.02e7, 1.57e4, 0.7)
    script["main"](write(damped, 7))
    assert "ruled out: stulov, hysteresis; nearest: hunt-crossley" in capsys.readouterr().out
    script["main"](write(damped, 4))
    assert "4 presses rule nothing out" in capsys.readouterr().out
    alike = [model.felt.fit_law("hunt-crossley", [model.felt.read_pressing(path) for path in write(damped, 4)])] * 2
    assert set(script["compare_laws"](alike).values()) == {1.0}
