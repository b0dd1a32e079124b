"""``pianorig watch``: the text drawing, the picture, and a shipped session."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.command_line import run

SHIPPED = Path(__file__).parents[3] / "sessions" / "example_forte"


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
