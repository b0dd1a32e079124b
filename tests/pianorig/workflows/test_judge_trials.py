"""Trials judged while a session is recorded: lines and files of each, and nothing lost where the judge is."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from pianorig.page.live import LiveStream
from pianorig.workflows import judge_trials
from rig import open_session
from tests.command_line import run

EXAMPLE = Path(__file__).parents[3] / "sessions" / "example_forte"


def test_every_sealed_trial_is_told_and_written_and_the_page_shows_the_last(tmp_path: Path) -> None:
    folder, told, ended = tmp_path / "session", [], threading.Event()
    shutil.copytree(EXAMPLE, folder)
    last = folder / "trial_0003.h5"
    last.rename(tmp_path / "later.h5")

    def tell(text: str) -> None:
        told.append(text)
        if len(told) == 2:  # sealed while the second is told
            (tmp_path / "later.h5").rename(last)
            ended.set()

    judge_trials.judge_trials(folder, "hirschkorn2004", ended, tell)
    assert [text.split(":")[0] for text in told] == ["trial 1", "trial 2", "trial 3"]
    files = [folder / "derived" / "judged" / f"trial_000{n}.json" for n in (1, 2, 3)]
    assert [json.loads(file.read_text(encoding="utf-8"))["n_trials"] for file in files] == [1, 2, 3]
    state, _ = LiveStream(folder).poll()
    assert state is not None and state["judged"]["trial"] == 3 and "hammer" in state["judged"]["curves"]
    files[-1].unlink()
    state, _ = LiveStream(folder).poll()
    assert state is not None and state["judged"]["trial"] == 2


def test_record_judges_by_a_model_in_another_process(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "session"
    assert run("record", "--trials", "1", "--action", "hirschkorn2004: --set hammer.mass=0.012", "--out", out) == 0
    assert "trial 1: RMSE key" in capsys.readouterr().err
    judged = json.loads((out / "derived" / "judged" / "trial_0001.json").read_text(encoding="utf-8"))
    assert judged["rmse_rad"]["hammer"] > 0 and open_session(out)[1].status == "complete"


def test_words_are_no_model_and_a_file_that_is_missing_is_refused_before_anything_moves(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert [judge_trials.is_model(text) for text in ("unknown", "Steinway D: key 40", "hirschkorn2004")] == [
        False, False, True,
    ]  # fmt: skip
    assert run("record", "--trials", "1", "--action", "missing.toml", "--out", tmp_path / "session") == 2
    assert "missing.toml" in capsys.readouterr().err and not (tmp_path / "session").exists()
    armed = "hirschkorn2004: --scene motor-arm"  # no force on its key drives it
    assert run("record", "--trials", "1", "--action", armed, "--out", tmp_path / "session") == 2
    assert "force_n" in capsys.readouterr().err and not (tmp_path / "session").exists()


def test_a_judge_that_is_killed_takes_nothing_with_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    begin = subprocess.Popen

    def dying(words: list[str], **given: object) -> subprocess.Popen[str]:
        process = begin([sys.executable, "-c", "import time; time.sleep(60)"], **given)  # type: ignore[call-overload]
        process.kill()
        return process  # type: ignore[no-any-return]

    monkeypatch.setattr(judge_trials.subprocess, "Popen", dying)
    assert run("record", "--trials", "2", "--action", "hirschkorn2004", "--out", tmp_path / "session") == 0
    assert "the recording is not touched" in capsys.readouterr().err
    assert [trial.status for trial in open_session(tmp_path / "session")] == ["complete", "complete"]
