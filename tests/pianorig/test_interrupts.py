"""Ctrl-C says what it did: outputs, the trial under way, what is kept and how to go on."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import rig
from pianorig import workflows
from pianorig.console.failures import Interrupted
from pianorig.workflows.recording import report_interrupt
from rig.safety.interrupts import Terminated
from rig.simulated import SimulatedBackend
from tests.command_line import run


def interrupting(at_trial: int, after_s: float = 0.3, what: type[BaseException] = KeyboardInterrupt) -> Any:
    def progress(at: rig.Progress) -> None:
        if at.trial == at_trial and at.time_s > after_s:
            raise what("stopped by SIGTERM") if what is Terminated else what

    return progress


def record(folder: Path, **keywords: Any) -> str:
    with pytest.raises(Interrupted) as caught, report_interrupt(folder):
        workflows.record(folder, trials=3, **keywords)
    assert caught.value.exit_code == 130
    return str(caught.value)


def test_an_interrupted_recording_says_outputs_trial_session_and_how_to_go_on(tmp_path: Path) -> None:
    said = record(tmp_path / "s", progress=interrupting(2))
    assert said == (
        f"stopped by Ctrl-C; outputs safe; trial 2 sealed as interrupted; session at {tmp_path / 's'}, 2 of 3 trials "
        f"to go: pianorig record --resume {tmp_path / 's'}"
    )
    session = rig.Session.open(tmp_path / "s")
    assert [trial.status for trial in session.trials] == ["complete", "interrupted"]
    assert run("record", "--resume", tmp_path / "s") == 0
    assert [trial.status for trial in rig.Session.open(tmp_path / "s").trials].count("complete") == 3


def test_a_request_to_end_is_named(tmp_path: Path) -> None:
    assert record(tmp_path / "s", progress=interrupting(1, what=Terminated)).startswith(
        "stopped by SIGTERM; outputs safe"
    )


def test_a_safe_stop_that_fails_is_never_called_safe(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    faults = [rig.HardwareFault("the output did not answer", phase="stop")]
    real = SimulatedBackend.safe_stop

    def fails(self: SimulatedBackend) -> None:
        real(self)
        if faults:
            raise faults.pop()

    monkeypatch.setattr(SimulatedBackend, "safe_stop", fails)
    said = record(tmp_path / "s", progress=interrupting(1))
    assert "OUTPUTS NOT CONFIRMED SAFE" in said and "the output did not answer" in said and "outputs safe" not in said
    assert "trial 1 sealed as fault" in said


def test_an_interrupt_before_the_first_block_claims_no_trial(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def stop(*_: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("pianorig.workflows.recording.predictor", stop)
    assert record(tmp_path / "s") == "stopped by Ctrl-C; nothing was recorded and no session was made"
    older = tmp_path / "older"
    older.mkdir()
    (older / "session.toml").write_text("of another recording")
    assert record(older) == "stopped by Ctrl-C; nothing was recorded"


def test_an_interrupted_tracking_says_what_is_kept(tmp_path: Path) -> None:
    unfinished = tmp_path / "a.csv.unfinished.npz"
    for there, words in ((False, "no frame was kept"), (True, f"kept in {unfinished}, the same command goes on there")):
        if there:
            unfinished.touch()
        with (
            pytest.raises(Interrupted, match="stopped by Ctrl-C") as caught,
            workflows.report_tracking_interrupt(unfinished),
        ):
            raise KeyboardInterrupt
        assert words in str(caught.value) and "no table was written" in str(caught.value)


def test_an_interrupted_self_test_says_that_outputs_are_safe(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    stops: list[str] = []
    real = SimulatedBackend.safe_stop
    monkeypatch.setattr(SimulatedBackend, "safe_stop", lambda self: (stops.append("safe"), real(self))[1])

    def stop(*_: Any, **more: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(SimulatedBackend, "arm", stop)
    monkeypatch.chdir(tmp_path)
    assert run("selftest") == 130
    assert "stopped by Ctrl-C; outputs safe; no record of the self-test was written" in capsys.readouterr().err
    assert stops and not (tmp_path / "selftests").exists()


def test_any_other_command_says_that_no_file_is_half_written(
    short_force: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def stop(*_: Any, **more: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("model.simulate", stop)
    assert run("simulate", "--force", short_force, "--out", tmp_path / "o.csv", "--json") == 130
    seen = capsys.readouterr()
    assert '"kind": "interrupted"' in seen.out
    assert seen.err == "pianorig: simulate stopped by Ctrl-C; files are written whole or not at all\n"
    assert not (tmp_path / "o.csv").exists()
