"""The page's side of a plan that is played: one at a time, in a process of its own (`recorder_process`)."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import IO, Any

from pianorig.errors import CommandInputError
from pianorig.page.control.order import Bench, Order

SEEN_EVERY_S = 0.5
PATIENCE_S = 20.0
"""How long an aborted recorder may take to seal its trial before it is killed; the device's watchdog is then left."""
IDLE: dict[str, Any] = {"phase": "idle"}
DOES = ("pause", "resume", "abort")


class PlanControl:
    """The plan of one page.

    Parameters
    ----------
    bench : that plans are played on
    now_s : monotonic clock, s
    """

    def __init__(self, bench: Bench, now_s: Callable[[], float] = time.monotonic) -> None:
        self.bench, self._now_s = bench, now_s
        self._process: subprocess.Popen[str] | None = None
        self._state = dict(IDLE)
        self._seen_s = -SEEN_EVERY_S
        self._lock = threading.Lock()

    @property
    def state(self) -> dict[str, Any]:
        """Where the plan is: ``phase`` idle, starting, asking, recording, paused or ended, and what belongs to it."""
        return self._state

    @property
    def running(self) -> bool:
        """Whether a plan is being played."""
        process = self._process
        return process is not None and process.poll() is None and self._state.get("phase") != "ended"

    def start(self, order: Order) -> dict[str, Any]:
        """Begin to play a plan.

        Raises
        ------
        CommandInputError : one is being played
        """
        with self._lock:
            if self.running:
                raise CommandInputError("a plan is being played; abort it, or wait for its end")
            self._wait_for_exit()
            own_group = {} if sys.platform == "win32" else {"start_new_session": True}
            said = tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace")  # noqa: SIM115 `_follow` closes it
            process = subprocess.Popen(
                [sys.executable, "-m", "pianorig.page.control.recorder_process"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=said,
                encoding="utf-8",
                env={**os.environ, "PYTHONUNBUFFERED": "1"},
                **own_group,  # type: ignore[call-overload]  # Ctrl-C in the terminal is the page's to hand on
            )
            self._process = process
            self._state = {"phase": "starting"}
        self._write(process, json.dumps(order.to_plain()))
        threading.Thread(target=self._follow, args=(process, said), name="plan", daemon=True).start()
        return self._state

    def _wait_for_exit(self) -> None:
        """Wait for a recorder that has told its end, and closes its bench."""
        if self._process is not None:
            try:
                self._process.wait(PATIENCE_S)
            except subprocess.TimeoutExpired:
                raise CommandInputError(
                    "the last recorder has not closed its bench yet; wait, then try again"
                ) from None
            if self._process.stdin is not None:
                with suppress(OSError):
                    self._process.stdin.close()

    def _follow(self, process: subprocess.Popen[str], said: IO[str]) -> None:
        assert process.stdout is not None
        with process.stdout as lines:
            for line in lines:
                with suppress(ValueError):
                    self._state = json.loads(line)
        code = process.wait()
        with said:
            said.seek(0)
            words = [line.strip() for line in said if line.strip()]
        if self._state.get("phase") != "ended":
            reason = words[-1] if words else "it said nothing"
            left = "look at the outputs; a trial that was cut off is sealed with  pianorig recover"
            self._state = {
                "phase": "ended",
                "code": code,
                "message": f"the recorder ended with {code}: {reason}; {left}",
            }

    def do(self, what: str) -> dict[str, Any]:
        """Pause before the next trial, resume, or abort at once.

        Raises
        ------
        CommandInputError : nothing is being played, or another word
        """
        if what not in DOES:
            raise CommandInputError(f"{what[:40]!r}: allowed {', '.join(DOES)}")
        return self._send({"do": what})

    def answer(self, number: Any, text: Any) -> dict[str, Any]:
        """Answer the recorder's question of this number.

        Raises
        ------
        CommandInputError : no such question is open
        """
        state = self._state
        if state.get("phase") != "asking" or number != state.get("question_number") or type(number) is not int:
            raise CommandInputError("this question is not open any more")
        if not isinstance(text, str) or len(text) > 200:
            raise CommandInputError("answer: allowed is text of at most 200 characters")
        return self._send({"do": "answer", "question": number, "text": text})

    def seen(self) -> None:
        """The page is there; told to the recorder now and then."""
        now_s = self._now_s()
        if self.running and now_s - self._seen_s >= SEEN_EVERY_S:
            self._seen_s = now_s
            self._send({"do": "seen"})

    def _send(self, words: dict[str, Any]) -> dict[str, Any]:
        process = self._process
        if process is None or process.poll() is not None:
            raise CommandInputError("no plan is being played")
        self._write(process, json.dumps(words))
        return self._state

    def _write(self, process: subprocess.Popen[str], line: str) -> None:
        assert process.stdin is not None
        with self._lock, suppress(OSError, ValueError):  # ended between two looks
            process.stdin.write(line + "\n")
            process.stdin.flush()

    def close(self) -> None:
        """The page ends by Ctrl-C: so does the trial under way, safely, and is sealed."""
        process = self._process
        if process is None:
            return
        if process.poll() is None:
            with suppress(CommandInputError):
                self._send({"do": "abort"})
            try:
                process.wait(PATIENCE_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
        if process.stdin is not None:
            with suppress(OSError):
                process.stdin.close()
