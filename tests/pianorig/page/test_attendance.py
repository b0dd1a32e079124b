"""The dead man's switch: a plan waits between trials where nobody is seen, and a server that is gone ends it there."""

from __future__ import annotations

import json
import queue
import threading
from collections.abc import Iterator
from typing import Any

import pytest

from pianorig.page.recorder_process import ASKED, PATIENCE_S, UNSEEN, Attendance
from rig.safety.interrupts import Terminated


class Operator:
    """Somebody at the page, with a clock that only the test moves."""

    def __init__(self) -> None:
        self.now_s = 0.0
        self.told: queue.Queue[dict[str, Any]] = queue.Queue()
        self.lines: queue.Queue[str | None] = queue.Queue()
        self.stopped = threading.Event()
        self.again: list[int] = []
        self.attendance = Attendance(
            self.told.put, self.stopped.set, lambda: self.again.append(1), now_s=lambda: self.now_s
        )
        self.thread = threading.Thread(target=self.attendance.listen, args=(self._lines(),))
        self.thread.start()

    def _lines(self) -> Iterator[str]:
        while (line := self.lines.get()) is not None:
            yield line

    def do(self, what: str, **more: Any) -> None:
        self.lines.put(json.dumps({"do": what, **more}))

    def leave(self) -> None:
        self.lines.put(None)
        self.thread.join(10)

    def heard(self, **what: Any) -> dict[str, Any]:
        """The next thing told that has these values."""
        while True:
            state = self.told.get(timeout=10)
            if what.items() <= state.items():
                return state


@pytest.fixture
def operator() -> Iterator[Operator]:
    there = Operator()
    yield there
    if there.thread.is_alive():
        there.leave()


def waiting(operator: Operator) -> tuple[threading.Thread, list[BaseException]]:
    """A plan that wants to begin trial 2, in a thread of its own."""
    ended: list[BaseException] = []

    def play() -> None:
        try:
            operator.attendance.before_trial(2)
        except BaseException as error:
            ended.append(error)

    thread = threading.Thread(target=play)
    thread.start()
    return thread, ended


def test_a_trial_begins_while_the_page_is_seen(operator: Operator) -> None:
    operator.now_s = 0.9 * PATIENCE_S
    operator.attendance.before_trial(1)
    assert operator.told.empty() and operator.again == []


@pytest.mark.parametrize("silent", [True, False])
def test_a_plan_pauses_where_asked_or_where_nobody_is_seen_and_goes_on_when_told(
    operator: Operator, silent: bool
) -> None:
    if silent:
        operator.now_s = 1.1 * PATIENCE_S
    else:
        operator.do("pause")
        operator.heard(pause_wanted=True)
    thread, ended = waiting(operator)
    state = operator.heard(phase="paused")
    assert state["why"] == (UNSEEN if silent else ASKED) and state["trial"] == 2
    operator.do("seen")  # being there again is not enough: somebody must want it
    thread.join(0.15)
    assert thread.is_alive() and operator.again == []
    operator.do("resume")
    thread.join(10)
    assert not thread.is_alive() and ended == [] and operator.again == [1]


def test_a_server_that_is_gone_ends_the_plan_before_the_next_trial(operator: Operator) -> None:
    operator.leave()
    with pytest.raises(Terminated, match="server is gone"):
        operator.attendance.before_trial(2)
    assert operator.attendance.ask("Type the rig's name: ") is None  # nobody to confirm
    assert not operator.stopped.is_set()  # the trial under way was left to its interlocks


def test_a_server_that_goes_while_the_plan_is_paused_ends_it(operator: Operator) -> None:
    operator.do("pause")
    operator.heard(pause_wanted=True)
    thread, ended = waiting(operator)
    operator.heard(phase="paused")
    operator.leave()
    thread.join(10)
    assert [type(error) for error in ended] == [Terminated]


def test_abort_stops_at_once_and_nothing_begins_after_it(operator: Operator) -> None:
    operator.do("abort")
    assert operator.stopped.wait(10)
    with pytest.raises(Terminated, match="aborted"):
        operator.attendance.before_trial(2)


def test_only_the_answer_to_this_question_counts(operator: Operator) -> None:
    answers: list[str | None] = []
    thread = threading.Thread(target=lambda: answers.extend(operator.attendance.ask(q) for q in ("name?", "again?")))
    thread.start()
    number = operator.heard(phase="asking", question="name?")["question_number"]
    operator.do("answer", question=number, text="virtual")
    second = operator.heard(phase="asking", question="again?")["question_number"]
    operator.do("answer", question=number, text="late")
    thread.join(0.15)
    assert thread.is_alive()
    operator.do("answer", question=second, text="yes")
    thread.join(10)
    assert answers == ["virtual", "yes"]


def test_what_is_no_line_of_ours_is_left(operator: Operator) -> None:
    for line in ("", "[", "3", "null", json.dumps({"do": "reboot"})):
        operator.lines.put(line)
    operator.do("pause")
    operator.heard(pause_wanted=True)
    assert not operator.stopped.is_set()
