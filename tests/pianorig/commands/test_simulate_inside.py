"""``simulate --inside``: columns, units, sums and the key's lift, as a user meets them."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.command_line import run
from tests.pianorig.test_commands import DATA

FORTE = str(DATA / "forte_force.csv")


def test_inside_as_columns(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "inside.csv"
    assert run("simulate", "--force", FORTE, "--inside", "--output-rate", "1000", "--out", str(out), "--json") == 0
    facts = json.loads(capsys.readouterr().out)
    header = out.read_text().splitlines()[0].split(",")
    rows = dict(zip(header, np.loadtxt(out, delimiter=",", skiprows=1).T, strict=True))
    assert len(header) == len(set(header)) == 1 + 10 + 13 * 7 + 5 * 3 + 5 * 6
    for name in ("contact04_slid_m", "contact12_felt_j", "key_joint_y_n", "hammer_center_y_m_per_s2"):
        assert np.ptp(rows[name]) > 0.0, name
    by_name = {c["contact"]: c for c in facts["contacts"]}
    assert by_name["contact04"]["rubbed_j"] == rows["contact04_rubbed_j"][-1]
    # the string is met for a millisecond, between the rows of the file
    assert by_name["contact12"]["largest_normal_n"] > rows["contact12_normal_n"].max()
    np.testing.assert_allclose(
        rows["jack_from_ground_rad_per_s"], rows["jack_rad_per_s"] + rows["whippen_rad_per_s"], atol=1e-12
    )
    first = facts["key_would_lift"][0]
    assert first["start_s"] < first["largest_at_s"] < first["end_s"] and first["largest_n"] > 10.0


def test_inside_as_hdf5_opens_in_xarray(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    import xarray

    out = tmp_path / "inside.h5"
    assert run("simulate", "--force", FORTE, "--inside", "--output-rate", "500", "--out", str(out)) == 0
    text = capsys.readouterr().out
    assert "back check" in text and "key would lift from its balance rail 0.109" in text
    with xarray.open_dataset(out, engine="h5netcdf") as data:
        units = {
            "contact01_normal_n": "N",
            "contact07_sliding_m_per_s": "m/s",
            "contact04_rubbed_j": "J",
            "contact12_penetration_m": "m",
            "whippen_joint_x_n": "N",
            "jack_center_x_m_per_s2": "m/s^2",
            "repetition_from_ground_rad_per_s2": "rad/s^2",
        }
        for name, unit in units.items():
            assert data[name].attrs["units"] == unit and data[name].dims == ("time_s",), name
        assert data["contact04_rubbed_j"].attrs["long_name"] == "back check: energy lost by friction since the start"
        assert data["time_s"].attrs["units"] == "s"
        from_s, to_s = data.attrs["key_would_lift_from_s"], data.attrs["key_would_lift_to_s"]
        assert np.all(from_s < to_s) and from_s[0] == pytest.approx(0.1093, abs=5e-4)


def test_sheet_and_animation(short_force: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    drawings = {"--figures": tmp_path / "sheet.pdf", "--animation": tmp_path / "blow.html"}
    arguments = [str(part) for pair in drawings.items() for part in pair]
    out = tmp_path / "o.csv"
    assert run("simulate", "--force", short_force, *arguments, "--output-rate", "100", "--out", out, "--json") == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["figures"] == str(drawings["--figures"]) and "contacts" not in facts
    assert drawings["--figures"].read_bytes()[:5] == b"%PDF-"
    assert "back check" in drawings["--animation"].read_text(encoding="utf-8")
    assert len(out.read_text().splitlines()[0].split(",")) == 11  # drawings add no columns


@pytest.mark.parametrize(
    ("option", "name", "words"),
    [
        ("--figures", "sheet.jpeg", "allowed .svg, .pdf or .png"),
        ("--animation", "blow.mp4", "allowed .html"),
        ("--animation", "nowhere/blow.html", "does not exist"),
    ],
)
def test_drawings_that_cannot_be_are_refused_first(
    option: str, name: str, words: str, refused: Callable[..., None]
) -> None:
    refused(words, "simulate", "--force", FORTE, option, name, "--out", "o.csv")
