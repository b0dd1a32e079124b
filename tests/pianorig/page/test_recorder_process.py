"""The recorder's process of a plan: what it tells cannot hold it up, abort works, hardware asks."""

from __future__ import annotations

import io
import json
import os
import signal
import subprocess
import sys
import threading
import time
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

from pianorig.page.plan import Bench, Order, PlanControl
from pianorig.page.recorder_process import Told, stop_main_thread
from rig.configuration.rig_file import load_rig
from rig.selftest import SelftestFinding, SelftestRecord
from rig.session import Session

DEADLINE_S = 120.0


def test_who_reads_nothing_holds_nothing_up() -> None:
    """A page's server that stands still does not read its end of the pipe; the recording goes on telling."""
    read, write = os.pipe()
    with os.fdopen(write, "w") as stream:
        told = Told(stream)
        began = time.monotonic()
        for number in range(20_000):
            told({"phase": "recording", "trial": number, "words": "x" * 10_000})
        assert time.monotonic() - began < 10.0
        with os.fdopen(read) as lines:  # what is read then is the newest, each line whole
            for line in lines:
                if json.loads(line)["trial"] == 19_999:
                    break
        told({"phase": "ended"})  # and who has gone is no error
        told.finish()


def test_only_what_has_changed_is_told_and_the_last_is_waited_for() -> None:
    stream = io.StringIO()
    told = Told(stream)
    told({"phase": "recording", "trial": 1})
    told.finish()
    told({"phase": "ended"})
    told.finish()
    lines = [json.loads(line) for line in stream.getvalue().splitlines()]
    assert lines[-1] == {"phase": "ended", "trial": 1} and len(lines) <= 3


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_abort_reaches_a_main_thread_that_sleeps() -> None:
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        threading.Timer(0.2, stop_main_thread).start()
        began = time.monotonic()
        with pytest.raises(KeyboardInterrupt):
            time.sleep(30.0)  # as between two trials of a plan
        assert time.monotonic() - began < 20.0
    finally:
        signal.signal(signal.SIGINT, before)


def until(control: PlanControl, phase: str, **more: Any) -> dict[str, Any]:
    """Be there until the plan is in a phase."""
    end = time.monotonic() + DEADLINE_S
    while time.monotonic() < end:
        control.seen()
        state = control.state
        if state["phase"] == phase and more.items() <= state.items():
            return state
        time.sleep(0.05)
    raise AssertionError(f"never {phase} {more}: {control.state}")


@pytest.mark.slow
def test_hardware_asks_for_self_test_and_name_also_after_a_pause(tmp_path: Path) -> None:
    """The virtual device behind a network address is hardware to the recorder."""
    serve = [sys.executable, "-m", "pianorig", "serve-sim", "--port", "0", "--json", "--clock", "real"]
    device = subprocess.Popen(serve, stdout=subprocess.PIPE, text=True)
    assert device.stdout is not None
    try:
        address = f"ni-grpc://{json.loads(device.stdout.readline())['address']}"
        folder, rig = tmp_path / "mine", load_rig("virtual")
        control = PlanControl(Bench("virtual", address, str(tmp_path / "selftests")))
        order = Order(control.bench, str(folder), profile="piano", trials=3)
        control.start(order)
        ended = until(control, "ended")
        assert ended["code"] == 3 and "selftest" in ended["message"] and not folder.exists(), ended

        checked = (SelftestFinding(check="all", passed=True, found="", allowed=""),)
        record = SelftestRecord(
            created_utc=datetime.now(UTC), rig="virtual", rig_sha256=rig.sha256, product=rig.config.device.product,
            device="cDAQ1", backend="test", simulated=True, serial_number="none (simulated)", findings=checked,
        )  # fmt: skip
        record.write(tmp_path / "selftests")
        control.start(order)
        asked = until(control, "asking")
        assert "virtual, to go on" in asked["question"]
        control.answer(asked["question_number"], "yes")
        ended = until(control, "ended")
        assert ended["code"] == 3 and "nothing has moved" in ended["message"] and not folder.exists()

        control.start(order)
        control.answer(until(control, "asking")["question_number"], "virtual")
        until(control, "recording", trial=1)
        control.do("pause")
        until(control, "paused")
        control.do("resume")
        again = until(control, "asking")  # somebody may stand at the arm now
        control.answer(again["question_number"], "wrong")
        third = until(control, "asking", question_number=again["question_number"] + 1)
        control.answer(third["question_number"], "virtual")
        assert until(control, "ended")["code"] == 0
        assert [trial.status for trial in Session.open(folder).trials] == ["complete"] * 3
        control.close()
    finally:
        device.terminate()
        device.wait(60)
        device.stdout.close()
