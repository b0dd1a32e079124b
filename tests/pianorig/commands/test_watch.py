"""``pianorig watch``: the text drawing, the picture, and a shipped session."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from pianorig.commands.watch import curve
from tests.command_line import run

SHIPPED = Path(__file__).parents[3] / "sessions" / "example_forte"


def test_a_ramp_rises_from_the_lowest_left_to_the_highest_right_dot() -> None:
    lines = curve(np.linspace(-1, 3, 200), width=10, height=3)
    assert [len(line) for line in lines] == [10, 10, 10]
    assert ord(lines[2][0]) & 0x40 and ord(lines[0][-1]) & 0x08
    assert lines[0][0] == lines[2][-1] == chr(0x2800)
    flat = curve(np.full(5, 7.0), width=4, height=2)
    assert len(set(flat[1])) == 1 and flat[0] == chr(0x2800) * 4


def test_a_finished_session_is_shown_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("watch", str(SHIPPED), "--json") == 0
    seen = json.loads(capsys.readouterr().out)
    assert seen["state"] == "complete" and seen["trial"] == seen["trials"] and seen["raw_peak_force_n"] > 20
    assert run("watch", str(SHIPPED)) == 0
    assert "force, N" in capsys.readouterr().out
    picture = tmp_path / "live.png"
    assert run("watch", str(SHIPPED), "--png", str(picture), "--once") == 0
    assert picture.read_bytes()[:4] == b"\x89PNG"
    assert run("watch", str(tmp_path)) == 2 and run("watch", str(SHIPPED), "--every", "0") == 2
