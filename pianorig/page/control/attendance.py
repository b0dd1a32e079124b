"""Whether somebody attends the bench, as the recorder's process sees it, and what they want; a dead man's switch.

Lines of JSON come from the page's server: that the page was seen, pause, resume, abort, an answer. Before each trial
the plan waits where a pause is wanted, or where the page was not seen for `PATIENCE_S`: browser closed, server stopped.
Where the lines have ended, the server is gone: the plan ends there, and can be resumed. A trial that has begun is never
stopped by silence: it ends by itself, under the recorder's own interlocks.
"""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable, Iterable
from typing import Any

from rig.safety.interrupts import Terminated

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
