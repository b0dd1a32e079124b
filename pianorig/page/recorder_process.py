"""The process that plays a plan for the page:  python -m pianorig.page.recorder_process

Lines of JSON on standard input: the order, then what the operator does (`Attendance`). Lines of JSON on standard
output: where the recording is, and at last how it ended. Permission, dry run, interlocks and what is stored are those
of ``pianorig record``.
"""

from __future__ import annotations

import json
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterable
from dataclasses import asdict
from pathlib import Path
from typing import Any, TextIO

from pianorig import workflows
from pianorig.page.plan import Bench, Order
from rig import NotPermitted, Progress, Session, load_rig, session_rig
from rig.configuration.rig_file import Rig
from rig.safety.interrupts import Terminated
from rig.safety.permission import confirm

PATIENCE_S = 2.0
TURN_S = 0.1
"""How long at most until a change is noticed that no line announces."""
GONE = "the page's server is gone"
UNSEEN = f"the page was not seen for {PATIENCE_S:g} s"
ASKED = "by the operator"


class Attendance:
    """One operator behind lines of JSON.

    Parameters
    ----------
    tell : called with what has changed: ``phase``, ``question``, ``why``
    stop : ends the trial under way, as Ctrl-C does
    again : called before a paused plan goes on; raises where it may not
    now_s : monotonic clock, s
    """

    def __init__(
        self,
        tell: Callable[[dict[str, Any]], None],
        stop: Callable[[], None],
        again: Callable[[], None] = lambda: None,
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._tell, self._stop, self.again, self._now_s = tell, stop, again, now_s
        self._changed = threading.Condition()
        self._seen_s = now_s()
        self._pause = self._resume = self._gone = self._aborted = False
        self._asked = 0
        self._answers: dict[int, str] = {}

    def listen(self, lines: Iterable[str]) -> None:
        """Take lines until they end; what is none of ours is left."""
        for line in lines:
            try:
                said = json.loads(line)
            except ValueError:
                continue
            if isinstance(said, dict):
                self._take(said)
        with self._changed:
            self._gone = True
            self._changed.notify_all()

    def _take(self, said: dict[str, Any]) -> None:
        with self._changed:
            self._seen_s = self._now_s()
            match said.get("do"):
                case "pause":
                    self._pause = True
                    self._tell({"pause_wanted": True})
                case "resume":
                    self._pause, self._resume = False, True
                    self._tell({"pause_wanted": False})
                case "answer":
                    self._answers[int(said.get("question", 0))] = str(said.get("text", ""))
                case "abort":
                    self._aborted = True
            self._changed.notify_all()
            aborted = said.get("do") == "abort"
        if aborted:
            self._stop()

    def ask(self, question: str) -> str | None:
        """Show a question and wait for its answer; None when nobody is left to answer. Nothing moves meanwhile."""
        with self._changed:
            self._asked += 1
            number = self._asked
            self._tell({"phase": "asking", "question": question, "question_number": number})
            while number not in self._answers and not self._gone and not self._aborted:
                self._changed.wait(TURN_S)
            answer = self._answers.pop(number, None)
        self._tell({"phase": "starting", "question": "", "question_number": number})
        return answer

    def before_trial(self, number: int) -> None:
        """Return when the next trial may begin.

        Raises
        ------
        rig.safety.interrupts.Terminated : aborted, or the server is gone; the plan ends before this trial
        """
        while (why := self._reason_to_wait()) is not None:
            self._wait(number, why)
            self.again()

    def _reason_to_wait(self) -> str | None:
        with self._changed:
            self.check()
            if self._pause:
                return ASKED
            return UNSEEN if self._now_s() - self._seen_s > PATIENCE_S else None

    def _wait(self, number: int, why: str) -> None:
        """Until somebody resumes."""
        self._tell({"phase": "paused", "why": why, "trial": number})
        with self._changed:
            self._resume = False
            while not self._resume:
                self.check()
                self._changed.wait(TURN_S)
        self._tell({"phase": "starting", "why": ""})

    def check(self) -> None:
        """Raise `Terminated` where the plan was aborted, or nobody is left to answer."""
        if self._aborted:
            raise Terminated("aborted on the page")
        if self._gone:
            raise Terminated(f"plan paused: {GONE}")


EVERY_S = 0.1
"""Between two lines."""
LAST_S = 2.0


def main() -> int:
    """Play the plan that the first line orders; return the exit code that ``pianorig record`` would have."""
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell may have had it ignored: abort must always work
    said = json.loads(sys.stdin.readline())
    order = Order(**{**said, "bench": Bench(**said["bench"])})
    return Playing(order, Told(sys.stdout)).play()


class Told:
    """Writes the newest state when it has changed, from a thread of its own: who reads slowly, or not at all, cannot
    hold up the recording.
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream, self._state = stream, {"phase": "starting"}
        self._changed = threading.Condition()
        self._version = self._written = 0
        threading.Thread(target=self._write, name="state", daemon=True).start()

    def __call__(self, change: dict[str, Any]) -> None:
        """Tell a change; returns at once."""
        with self._changed:
            self._state = {**self._state, **change}
            self._version += 1
            self._changed.notify_all()

    def finish(self) -> None:
        """Wait until the last state is written, not longer than `LAST_S`."""
        with self._changed:
            self._changed.wait_for(lambda: self._written == self._version, LAST_S)

    def _write(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._written != self._version)
                state, version = self._state, self._version
            try:
                print(json.dumps(state), file=self._stream, flush=True)
            except OSError:
                return  # nobody is left to tell
            with self._changed:
                self._written = version
                self._changed.notify_all()
            time.sleep(EVERY_S)


class Playing:
    """One order."""

    def __init__(self, order: Order, tell: Told) -> None:
        self._order, self._tell = order, tell
        self._attendance = Attendance(tell, stop_main_thread, self._confirm_again)

    def play(self) -> int:
        """Record; tell where it is and how it ended."""
        threading.Thread(target=self._attendance.listen, args=(sys.stdin,), name="operator", daemon=True).start()
        order, folder = self._order, Path(self._order.folder)
        self._tell({"phase": "starting", "session": folder.name})
        try:
            with workflows.interrupts_told(folder, resumed=order.resume):
                self._record(folder)
        except Exception as problem:
            code = getattr(problem, "exit_code", None)
            text = str(problem) if code is not None else f"defect: {type(problem).__name__}: {problem}"
            self._end(" ".join(text.split()), 1 if code is None else int(code))
            return 1 if code is None else int(code)
        self._end("every trial of the plan is there", 0)
        return 0

    def _record(self, folder: Path) -> None:
        order, attendance = self._order, self._attendance
        bench = order.bench
        access = workflows.BenchAccess(bench.rig, bench.backend, False, attendance.ask, Path(bench.selftests))
        if order.resume:
            workflows.resume(folder, access, self._progress, attendance.before_trial)
            return
        what: dict[str, Any] = {"profile": order.profile, "trials": order.trials}
        if order.plan:
            what = {"plan_file": Path(order.plan)}
        workflows.record(
            folder,
            access,
            **what,
            operator=order.operator,
            action_name=order.action,
            progress=self._progress,
            before_trial=attendance.before_trial,
        )

    def _confirm_again(self) -> None:
        """After a pause somebody may stand at the arm: on hardware the rig's name is typed again, until it is right."""
        if self._order.bench.backend.startswith("sim:"):
            return
        while True:
            try:
                confirm(self._rig(), self._order.bench.backend, yes=False, ask=self._attendance.ask)
                return
            except NotPermitted as refused:
                self._tell({"why": str(refused)})
                self._attendance.check()

    def _rig(self) -> Rig:
        if self._order.resume:
            return session_rig(Session.open(self._order.folder, require_trials=False))
        return load_rig(self._order.bench.rig)

    def _progress(self, at: Progress) -> None:
        self._tell({"phase": "recording", **asdict(at)})

    def _end(self, message: str, code: int) -> None:
        self._tell({"phase": "ended", "message": message, "code": code, "question": "", "why": ""})
        self._tell.finish()


def stop_main_thread() -> None:
    """Interrupt the main thread as Ctrl-C does, also where it sleeps."""
    if sys.platform == "win32":
        signal.raise_signal(signal.SIGINT)
    else:
        signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)


if __name__ == "__main__":
    sys.exit(main())
