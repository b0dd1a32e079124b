"""What commands show while they work: one line drawn over on a terminal, plain lines in a pipe, of any width."""

from __future__ import annotations

import os
import re
import sys
import time
from pathlib import Path

import numpy as np
import pytest

if sys.platform == "win32":
    pytest.skip("pseudo-terminals are POSIX only", allow_module_level=True)

import termios

from pianorig.commands.watch import draw_curve
from pianorig.console import progress
from pianorig.console.output import print_json
from pianorig.console.progress import ONCE
from rig import Progress
from tests.command_line import run


def test_a_recording_is_one_line_of_a_narrow_terminal(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    screen, stderr = os.openpty()
    termios.tcsetwinsize(stderr, (24, 40))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("pianorig.console.terminal.REFRESH_S", 0.0)
    with open(stderr, "w", encoding="utf-8") as terminal:
        with monkeypatch.context() as patch:
            patch.setattr(sys, "stderr", terminal)
            assert run("record", "--trials", "1", "--out", "s") == 0
        text = os.read(screen, 100_000).decode()
    os.close(screen)
    assert text.replace(ONCE, "").lstrip().startswith("recording forte on sim:// into s\r\n")
    drawn = [part for part in re.split(r"[\r\n]+", text) if part.startswith("trial 1/1")]
    assert len(drawn) > 10 and max(map(len, drawn)) < 40 and text.count("\r\n") == text.count("\n") <= 2
    assert "filming" not in text and text.endswith("\r")  # nothing was filmed, and the line is cleared


def test_long_work_in_a_pipe_says_what_it_does_in_plain_lines(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(progress, "PATIENCE_S", 0.0)
    with progress.recording_line(title="recording") as recorded, progress.bar("filming") as filmed:
        assert recorded is not None and filmed is not None
        for trial in (1, 2):
            recorded(Progress(trial, 2, 0.1, 0.5, 3.0))
            recorded(Progress(trial, 2, 0.2, 0.5, 3.0))
        for done in range(1, 4):
            filmed(done, 3)
    with progress.working("regulating"):
        time.sleep(0.2)
    monkeypatch.setattr(progress, "PATIENCE_S", 60.0)
    with progress.working("never said"), progress.bar("never said") as filmed:
        assert filmed is not None
        filmed(1, 3)
    said = capsys.readouterr().err.splitlines()
    assert said == [
        "trial 1 of 2, recording", "trial 2 of 2, recording", "filming: 3 frames, 0:00 left", "regulating ..."
    ]  # fmt: skip


def test_the_largest_force_of_a_trial_stays_shown_until_the_next_trial(monkeypatch: pytest.MonkeyPatch) -> None:
    shown: list[str] = []
    monkeypatch.setattr(progress.LIVE, "show", shown.append)
    with progress.recording_line() as recorded:
        assert recorded is not None
        for trial, peak_n in ((1, 2.0), (1, 30.5), (1, 9.0), (2, 4.0)):
            recorded(Progress(trial, 2, 0.1, 0.5, peak_n))
    assert [line.split("peak")[1].split() for line in shown] == [[n, "N"] for n in ("2.0", "30.5", "30.5", "4.0")]


def test_a_peak_of_one_sample_is_drawn_from_top_to_bottom() -> None:
    drawn = draw_curve(np.eye(1, 2000, 1001)[0], width=10, height=3)  # a hundred samples under each dot
    full, empty, base = 0x47, 0x2800, 0x28C0  # left dots of a cell; no dots; both dots of the lowest row
    assert [ord(line[5]) & full for line in drawn] == [full] * 3
    assert {ord(sign) for line in drawn[:2] for sign in line[:5] + line[6:]} == {empty}
    assert {ord(sign) for sign in drawn[2][:5] + drawn[2][6:]} == {base}


def test_a_number_that_is_not_known_is_null_in_json(capsys: pytest.CaptureFixture[str]) -> None:
    """JSON has no NaN: other programs' readers stop at it."""
    print_json({"dip_mm": 9.5, "after_touch_mm": np.nan, "body": "key"})
    assert capsys.readouterr().out == '{"dip_mm": 9.5, "after_touch_mm": null, "body": "key"}\n'
