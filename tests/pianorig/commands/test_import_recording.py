"""``pianorig import`` as a user meets it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.command_line import run


def test_a_force_that_cannot_be_a_blow_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run("examples", ".") == 0
    mapping = Path("lab.toml").read_text("utf-8").replace("newtons_per_unit = 1.0", "newtons_per_unit = 12.0")
    Path("hundredfold.toml").write_text(mapping, "utf-8")
    capsys.readouterr()
    assert run("import", "lab.csv", "--mapping", "lab.toml", "--out", "right") == 0
    assert "cannot be a blow" not in capsys.readouterr().out
    assert run("import", "lab.csv", "--mapping", "hundredfold.toml", "--out", "wrong", "--json") == 0
    (trial,) = json.loads(capsys.readouterr().out)["trials"]
    assert trial["cannot_be_a_blow"].startswith("force: cannot be a blow: largest force 319 N, blows up to 300 N")
