"""``simulate --force`` reads what ``import`` reads: the same motion from the same force in each format."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest

import model
from pianorig.workflows import read_driving_force
from tests.command_line import run

RATE_HZ = 5000
MAPPING = """schema = "piano-action-rig mapping 1"
simulated = false
mains_frequency_hz = 50.0
absent_encoders = ["key", "whippen", "hammer"]
[time]
channel = "t (ms)"
unit = "ms"
[force]
channel = "load"
unit = "V"
newtons_per_unit = 25.0
zero = 0.2
"""


def blow() -> tuple[np.ndarray, np.ndarray]:
    """The forte blow after a tenth of a second of rest, at the sample rate of a recording."""
    times, forces = model.force_table("forte")
    time_s = np.arange(int((0.1 + times[-1]) * RATE_HZ)) / RATE_HZ
    return time_s, np.interp(time_s - 0.1, times, forces)


def test_a_force_comes_from_each_format_and_by_a_mapping(tmp_path: Path, capsys) -> None:
    time_s, force_n = blow()
    csv, recorded, mapping = tmp_path / "a.csv", tmp_path / "lab.csv", tmp_path / "m.toml"
    np.savetxt(csv, np.column_stack([time_s, force_n]), delimiter=",", header="time_s,force_n", comments="")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["time_s"], file["force_n"] = time_s, np.int16(np.round(force_n * 1000))
        file["force_n"].attrs["scale_factor"] = 1e-3
    np.savetxt(
        recorded,
        np.column_stack([1e3 * time_s, force_n / 25.0 + 0.2]),
        delimiter=",",
        header="t (ms),load",
        comments="# ",
    )
    mapping.write_text(MAPPING)
    ends = []
    for words in ([csv], [tmp_path / "a.h5"], [recorded, "--mapping", mapping]):
        assert run("simulate", "--force", *words, "--out", tmp_path / "angles.csv", "--output-rate", "1000") == 0
        ends.append(np.loadtxt(tmp_path / "angles.csv", delimiter=",", skiprows=1, comments="#", usecols=(1, 2))[-1])
    np.testing.assert_allclose(ends[1:], [ends[0]] * 2, atol=2e-4)
    capsys.readouterr()
    assert run("simulate", "--mapping", mapping, "--key-motion", csv, "--out", tmp_path / "b.csv") == 2
    assert "--key-motion: found together with --mapping" in capsys.readouterr().err


def test_the_force_of_a_recording_is_corrected_and_that_of_a_table_is_not(tmp_path: Path) -> None:
    time_s, force_n = blow()
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["time_s"], file["force_n"] = time_s, force_n + 0.5
        file["force_n"].attrs["units"] = "N"
    np.testing.assert_allclose(read_driving_force(tmp_path / "a.h5").force_n, force_n + 0.5)
    mapping = tmp_path / "m.toml"
    plain = MAPPING.replace('"t (ms)"\nunit = "ms"', '"time_s"').replace('"load"\nunit = "V"', '"force_n"')
    mapping.write_text(plain.replace("newtons_per_unit = 25.0\nzero = 0.2\n", ""))
    corrected = read_driving_force(tmp_path / "a.h5", mapping=mapping)
    assert corrected.force_n.max() == pytest.approx(force_n.max(), abs=0.02)
    assert abs(corrected.force_n[:300]).max() < 0.02


def test_milliseconds_under_time_s_are_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table = tmp_path / "ms.csv"
    table.write_text("time_s,force_n\n0,0\n20,6\n90,6\n120,0\n")
    assert run("simulate", "--force", table, "--output-rate", "1", "--out", tmp_path / "angles.csv") == 0
    said = capsys.readouterr().out
    assert f"{table}: cannot be a blow: pressed for 115 s without a pause" in said and "are its times in ms?" in said
