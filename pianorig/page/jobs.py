"""Long work that the page begins: a command of ``pianorig`` in a process of its own, one at a time."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from collections import deque
from dataclasses import dataclass, field
from typing import Any

from pianorig.console.progress import PROGRESS
from pianorig.errors import CommandInputError

KEPT_LINES = 40  # of a job's output: what a page shows
KEPT_JOBS = 20  # of one evening
PATIENCE_S = 10.0  # for a job to end by itself before it is ended


@dataclass
class _Job:
    number: int
    subject: str
    command: str
    process: subprocess.Popen[str]
    lines: deque[str] = field(default_factory=lambda: deque(maxlen=KEPT_LINES))
    code: int | None = None


def begin_process(words: list[str], variables: dict[str, str], **streams: Any) -> subprocess.Popen[str]:
    """Start ``python -m`` with these words; Ctrl-C in the terminal is the page's to hand on."""
    own_group: dict[str, Any] = {} if sys.platform == "win32" else {"start_new_session": True}
    return subprocess.Popen(
        [sys.executable, "-m", *words], stdout=subprocess.PIPE, encoding="utf-8", errors="replace",
        env={**os.environ, **variables}, **own_group, **streams,
    )  # fmt: skip


def end_process(process: subprocess.Popen[str], patience_s: float) -> None:
    """Wait for a process that was asked to end; one that does not listen is killed."""
    try:
        process.wait(patience_s)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


class Jobs:
    def __init__(self) -> None:
        self._jobs: dict[int, _Job] = {}
        self._lock = threading.Lock()

    @property
    def running(self) -> str:
        """Command and subject of the job that is running; empty where none is."""
        busy = next((job for job in self._jobs.values() if job.code is None), None)
        return "" if busy is None else f"{busy.command} of {busy.subject}"

    def begin(self, subject: str, arguments: list[str]) -> dict[str, Any]:
        """Start ``pianorig`` with ``arguments`` in a process of its own, as a job about the session ``subject``, and
        return the job's state; CommandInputError while another runs."""
        with self._lock:
            if busy := self.running:
                raise CommandInputError(f"{busy} is running; wait, or stop it")
            process = begin_process(
                ["pianorig", *arguments], {PROGRESS: "lines"}, stdin=subprocess.DEVNULL, stderr=subprocess.STDOUT
            )
            job = _Job(max(self._jobs, default=0) + 1, subject, arguments[0], process)
            self._jobs[job.number] = job
            for old in list(self._jobs)[:-KEPT_JOBS]:
                del self._jobs[old]
        threading.Thread(target=self._follow, args=(job,), name="bench job", daemon=True).start()
        return self._state(job)

    def _follow(self, job: _Job) -> None:
        assert job.process.stdout is not None
        with job.process.stdout as said:
            for line in said:
                if line.strip():
                    job.lines.append(line.rstrip())
        job.code = job.process.wait()

    def state(self, number: int) -> dict[str, Any] | None:
        """How far a job is; None where there is none of this number."""
        job = self._jobs.get(number)
        return None if job is None else self._state(job)

    @staticmethod
    def _state(job: _Job) -> dict[str, Any]:
        """State of a job for the page by name: number, session, command, whether it is running, whether it failed, and
        the lines printed so far."""
        return {
            "job": job.number,
            "session": job.subject,
            "command": job.command,
            "running": job.code is None,
            "failed": job.code not in (None, 0),
            "lines": list(job.lines),
        }

    def stop(self, number: int) -> None:
        """Ask a job to end as Ctrl-C does."""
        job = self._jobs.get(number)
        if job is not None and job.code is None:
            job.process.send_signal(signal.SIGTERM if sys.platform == "win32" else signal.SIGINT)

    def close(self) -> None:
        """End what is running; what does not listen is killed."""
        for job in self._jobs.values():
            if job.process.poll() is None:
                self.stop(job.number)
                end_process(job.process, PATIENCE_S)
