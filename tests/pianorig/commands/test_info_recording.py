"""``pianorig info FILE``: the channels of a foreign recording, and a mapping that then imports."""

from __future__ import annotations

import json
from pathlib import Path

import h5py
import numpy as np
import pytest

from pianorig.workflows.foreign_file import find_steps_of_turn
from rig import Session
from tests.command_line import run

N, RATE_HZ = 700, 4000
TIME_S = np.arange(N) / RATE_HZ
PUSH = np.clip((TIME_S - 0.05) / 0.04, 0.0, 1.0)
CHANNELS = {"Zeit": TIME_S, "Kraft": 9.0 * PUSH, "Taste": np.round(-3100 * PUSH), "Hammer": 0.3 * PUSH**2}


def text(decimal: str, separator: str, names: str, above: str = "", thousands: str = "") -> str:
    def cell(value: float) -> str:
        plain = f"{value:,.5f}" if thousands else f"{value:.5f}"
        return plain.replace(",", "\0").replace(".", decimal).replace("\0", thousands)

    rows = "\n".join(separator.join(cell(v) for v in row) for row in zip(*CHANNELS.values(), strict=True))
    return f"{above}{names}\n{rows}\n"


@pytest.mark.parametrize(
    "written",
    [
        text(".", ",", "Zeit,Kraft,Taste,Hammer\ns,N,counts,rad"),
        text(",", ";", "Zeit;Kraft;Taste;Hammer\ns;N;counts;rad", thousands="\u202f"),
        text(",", "\t", "Zeit\tKraft\tTaste\tHammer\ns\tN\tcounts\trad", above="Versuch 3\nRate\t4000\n\n"),
        text(".", " ", "# Zeit Kraft Taste Hammer\n# s N counts rad"),
    ],
)
def test_a_proposed_mapping_of_a_text_file_imports(written: str, tmp_path: Path, capsys) -> None:
    recording, mapping = tmp_path / "a.csv", tmp_path / "m.toml"
    recording.write_text(written, encoding="utf-8")
    assert run("info", recording, "--propose", mapping) == 0
    said = capsys.readouterr().out
    assert "channel Kraft  unit N  samples 700  rate_hz 4000  from 0  to 9" in said and "CHECK" in said
    assert run("import", recording, "--mapping", mapping, "--out", tmp_path / "s") == 0
    assert "; no encoder of whippen: validate needs key, whippen and hammer" in capsys.readouterr().out
    data = Session.open(tmp_path / "s").trial(1).read()
    assert data.absent == ("whippen",) and data.sample_rate_hz == pytest.approx(RATE_HZ)
    np.testing.assert_allclose(data.raw_force_n, CHANNELS["Kraft"], atol=1e-5)
    np.testing.assert_array_equal(data.encoder_count[:, 0], CHANNELS["Taste"])
    np.testing.assert_allclose(data.angle_rad[:, 1], CHANNELS["Hammer"], atol=1e-5)
    assert run("info", recording, "--propose", mapping) == 2
    assert "exists already" in capsys.readouterr().err


def test_what_is_not_stated_is_marked_and_what_is_unusual_is_proposed(tmp_path: Path, capsys) -> None:
    recording, mapping = tmp_path / "a.h5", tmp_path / "m.toml"
    wrapped = (CHANNELS["Taste"] + 20) % 2**16
    with h5py.File(recording, "w") as file:
        file["run/load"], file["run/key"] = CHANNELS["Kraft"] / 20, wrapped.astype(np.uint16)
        file["run/load"].attrs["unit"] = "mV"
        file["run/key"].attrs["gain"] = 3.0
        file["scaled"] = np.zeros((4, 3))
    assert run("info", recording, "--json") == 0
    facts = json.loads(capsys.readouterr().out)
    assert {row["channel"]: row["rate_hz"] for row in facts["channels"]} == dict.fromkeys(
        ("run/load", "run/key"), "not stated"
    )
    assert [row["channel"] for row in facts["unusable"]] == ["scaled", "run/key"]
    assert "gain = 3" in facts["does_not_import_yet"]
    with h5py.File(recording, "a") as file:
        del file["run/key"].attrs["gain"]
    assert run("info", recording, "--propose", mapping) == 0
    lines = mapping.read_text(encoding="utf-8").splitlines()
    for start in ("sample_rate_hz = 1000", "newtons_per_unit = 1.0", "counts_per_revolution", "sign = 1"):
        assert any(line.startswith(start) and "# CHECK: " in line for line in lines), start
    assert "counter_bits = 16" in lines and 'unit = "counts"  # CHECK: the file states none' in lines
    right = (
        mapping.read_text("utf-8")
        .replace("1000.0", "4000.0")
        .replace("newtons_per_unit = 1.0", "newtons_per_unit = 20.0")
    )
    mapping.write_text(right, encoding="utf-8")
    assert run("import", recording, "--mapping", mapping, "--out", tmp_path / "s") == 0
    data = Session.open(tmp_path / "s").trial(1).read()
    np.testing.assert_array_equal(data.encoder_count[:, 0], CHANNELS["Taste"] + 20)
    assert data.raw_force_n.max() == pytest.approx(9.0)


@pytest.mark.parametrize(("counts", "digits"), [(20_000, 4), (40_000, 4), (163_840, 6), (4_096, 3)])
def test_the_steps_of_an_encoder_are_found_in_its_angles(counts: int, digits: int) -> None:
    """Without them a coarse encoder that takes one step after a rest seems to have stood still."""
    degrees = np.round(np.round(21.0 * PUSH**2 * counts / 360.0) * 360.0 / counts + 0.7, digits)
    assert find_steps_of_turn(degrees, 360.0) == counts
    assert find_steps_of_turn(np.radians(degrees), 2.0 * np.pi) == counts
    assert find_steps_of_turn(21.0 * np.sin(PUSH) ** 2, 360.0) is None
    assert find_steps_of_turn(np.array([0.0, 1.0, np.nan]), 360.0) is None


def test_a_file_without_a_force_is_listed_all_the_same(tmp_path: Path, capsys) -> None:
    recording = tmp_path / "a.csv"
    recording.write_text("time_s,depth\n" + "\n".join(f"{k / 1000},{k}" for k in range(50)), encoding="utf-8")
    assert run("info", recording) == 0
    said = capsys.readouterr().out
    assert "channel depth" in said and "none: no channel has a unit of force" in said
    assert run("info", recording, "--propose", tmp_path / "m.toml") == 2
    assert "not written" in capsys.readouterr().err and not (tmp_path / "m.toml").exists()


def test_a_channel_that_cannot_be_read_is_proposed_with_what_is_wrong(tmp_path: Path, capsys) -> None:
    recording = tmp_path / "a.csv"
    recording.write_text(text(".", ",", "Zeit,Kraft,Taste,Hammer\ns,N,counts,rad") + "0.175,NaN,1,0\n", "utf-8")
    assert run("info", recording, "--json") == 0
    facts = json.loads(capsys.readouterr().out)
    assert "Kraft row 702: found 'NaN'" in facts["does_not_import_yet"] and 'channel = "Kraft"' in facts["mapping"]


def test_the_channels_of_one_group_are_proposed_together(tmp_path: Path, capsys) -> None:
    recording, mapping = tmp_path / "a.h5", tmp_path / "m.toml"
    with h5py.File(recording, "w") as file:
        for run_name, scale in (("b", 1.0), ("a", 2.0)):
            for name, values in CHANNELS.items():
                file[f"{run_name}/{name}"] = values * (scale if name != "Taste" else 1.0)
    assert run("info", recording, "--propose", mapping) == 0
    assert "rate_hz 4000" in capsys.readouterr().out
    assert run("import", recording, "--mapping", mapping, "--out", tmp_path / "s") == 0
    data = Session.open(tmp_path / "s").trial(1).read()
    assert data.sample_rate_hz == pytest.approx(2000.0) and data.raw_force_n.max() == pytest.approx(18.0)


def test_a_file_that_is_no_recording_is_not_called_a_session(tmp_path: Path, capsys) -> None:
    film = tmp_path / "film.mraw"
    film.write_bytes(b"1")
    for path, words in ((film, "ending '.mraw', allowed .csv, "), (tmp_path / "a.csv", "a.csv: cannot be read")):
        assert run("info", path) == 2
        said = capsys.readouterr().err
        assert words in said and "session" not in said
    assert run("info", tmp_path / "lab") == 2
    assert "no such session folder" in capsys.readouterr().err


def test_trials_that_are_absent_from_a_session_are_named(tmp_path: Path, capsys) -> None:
    recording, mapping = tmp_path / "a.csv", tmp_path / "m.toml"
    recording.write_text(text(".", ",", "Zeit,Kraft,Taste,Hammer\ns,N,counts,rad"), "utf-8")
    assert run("info", recording, "--propose", mapping) == 0
    files = (recording, recording, recording)
    assert run("import", *files, "--mapping", mapping, "--out", tmp_path / "s") == 0
    capsys.readouterr()
    assert run("info", tmp_path / "s") == 0 and "absent_trials" not in capsys.readouterr().out
    (tmp_path / "s" / "trial_0002.h5").unlink()
    assert run("info", tmp_path / "s", "--json") == 0
    assert json.loads(capsys.readouterr().out)["absent_trials"] == "2"
