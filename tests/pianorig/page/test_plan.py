"""A plan played from the page: who may, what may be ordered, and that it stops, waits and ends as the operator says."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from rig.session import Session
from tests.pianorig.page.conftest import Page, awaited, left, own_process, serve

ORDER = {"profile": "piano", "trials": 3, "session": "mine", "operator": "ana", "action": "upright"}
PLAN = """schema = "piano-action-rig plan 1"
name = "two"
rest_s = 0.5
[[conditions]]
name = "soft"
profile = "piano"
repeats = 2
prompt = "loosen the screw"
"""


def test_a_guessed_token_opens_nothing(folder: Path) -> None:
    for page in serve(folder, control=True):
        for token in ("", "x", "A" * 43, page.first_address.split("=")[1][:-1]):
            assert page.ask(f"/?token={token}").status == 403
            assert page.ask("/api/plan", "POST", ORDER).status == 403
        assert page.take().status == 200  # the right one has not been used up by guesses


@pytest.mark.parametrize(
    ("change", "status", "words"),
    [
        ({"profile": "/etc/passwd"}, 400, "profile"),
        ({"profile": "../x.toml"}, 400, "profile"),
        ({"profile": ["piano"]}, 400, "profile"),
        ({"trials": 0}, 400, "1 to 9999"),
        ({"trials": "3"}, 400, "1 to 9999"),
        ({"trials": True}, 400, "1 to 9999"),
        ({"plan": "/etc/passwd"}, 404, "no plan"),
        ({"plan": "../rig.toml"}, 404, "no plan"),
        ({"session": "../mine"}, 400, "letters"),
        ({"session": "-mine"}, 400, "letters"),
        ({"session": "example_forte"}, 400, "exists"),
        ({"operator": "a\nb"}, 400, "line of text"),
        ({"operator": "x" * 201}, 400, "line of text"),
        ({"resume": "nothing"}, 404, "no session"),
        ({"resume": "example_forte"}, 400, "nothing to resume"),
    ],
)
def test_what_cannot_be_played_is_refused_in_one_line(
    writing: Page, folder: Path, change: dict[str, Any], status: int, words: str
) -> None:
    before = sorted(folder.rglob("*"))
    answer = writing.ask("/api/plan", "POST", {**ORDER, **change})
    assert answer.status == status and words in answer.json["error"] and "\n" not in answer.json["error"]
    assert sorted(folder.rglob("*")) == before and writing.ask("/api/plan").json["state"]["phase"] == "idle"


def test_buttons_without_a_plan_say_so(writing: Page, folder: Path) -> None:
    (folder / "mine.toml").write_text(PLAN)
    (folder / "other.toml").write_text("schema = 'x'")
    os.symlink("/nowhere", folder / "dangling.toml")
    found = writing.ask("/api/plan").json
    assert found["plans"] == ["mine.toml"] and "forte" in found["profiles"]
    assert found["bench"] == {"rig": "virtual", "backend": "sim://"}
    for path in ("pause", "resume", "abort"):
        answer = writing.ask(f"/api/plan/{path}", "POST", {})
        assert answer.status == 400 and answer.json["error"] == "no plan is being played"
    assert "not open" in writing.ask("/api/plan/answer", "POST", {"question": 1, "text": ""}).json["error"]
    assert writing.ask("/api/plan/reboot", "POST", {}).status == 404


def test_long_work_and_a_plan_are_not_done_at_once(
    writing: Page, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from pianorig.page.jobs import Jobs
    from pianorig.page.plan import PlanControl

    with monkeypatch.context() as busy:
        busy.setattr(PlanControl, "running", True)
        for path in ("sessions/example_forte/validate", "plan"):
            answer = writing.ask(f"/api/{path}", "POST", ORDER)
            assert answer.status == 400 and "a plan is being played" in answer.json["error"], path
    monkeypatch.setattr(Jobs, "running", "track of film.avi")
    answer = writing.ask("/api/plan", "POST", ORDER)
    assert answer.status == 400 and "track of film.avi is running" in answer.json["error"]
    assert not (folder / "mine").exists()


class Watch:
    """The page's websocket: answers that it is there, for as long as it is open."""

    def __init__(self, page: Page) -> None:
        self.page, self.states = page, []  # type: ignore[var-annotated]

    async def until(self, phase: str, **more: Any) -> dict[str, Any]:
        """Be there until the plan is in this phase."""
        from tornado.httpclient import HTTPRequest
        from tornado.websocket import websocket_connect

        origin = self.page.address.rstrip("/")
        headers = {"Origin": origin, "Cookie": str(self.page.cookie)}
        address = f"{origin.replace('http', 'ws')}/plan"
        socket = await websocket_connect(HTTPRequest(address, headers=headers))
        try:
            for _ in range(1200):
                state = json.loads(await asyncio.wait_for(socket.read_message(), 60))
                await socket.write_message("seen")
                self.states.append(state)
                if state["phase"] == phase and more.items() <= state.items():
                    return dict(state)
                assert state["phase"] != "ended", state
        finally:
            await left(socket)
        raise AssertionError(f"never {phase} {more}: {self.states[-1]}")

    def __call__(self, phase: str, **more: Any) -> dict[str, Any]:
        return awaited(self.until(phase, **more))


def quietly(page: Page, phase: str) -> dict[str, Any]:
    """Wait for a phase without being there."""
    for _ in range(600):
        state = page.ask("/api/plan").json["state"]
        if state["phase"] == phase:
            return dict(state)
        time.sleep(0.1)
    raise AssertionError(f"never {phase}: {state}")


@pytest.mark.slow
def test_begin_pause_resume_and_to_the_end(folder: Path) -> None:
    (folder / "two.toml").write_text(PLAN)
    for page in serve(folder, control=True, backend="sim://?clock=4"):
        page.take()
        watch = Watch(page)
        assert page.ask("/api/plan", "POST", {"plan": "two.toml", "session": "two"}).status == 200
        asked = watch("asking")
        assert "loosen the screw" in asked["question"]
        assert "not open" in page.ask("/api/plan/answer", "POST", {"question": 7, "text": ""}).json["error"]
        page.ask("/api/plan/answer", "POST", {"question": asked["question_number"], "text": ""})
        watch("recording", trial=1)
        assert "being played" in page.ask("/api/plan", "POST", ORDER).json["error"]
        page.ask("/api/plan/pause", "POST", {})
        paused = watch("paused")
        assert paused["why"] == "by the operator" and len(Session.open(folder / "two").trials) == 1
        page.ask("/api/plan/resume", "POST", {})
        ended = watch("ended")
        assert ended["code"] == 0
        assert [trial.status for trial in Session.open(folder / "two").trials] == ["complete"] * 2
        assert page.ask("/api/sessions/two").json["trials"][1]["status"] == "complete"


@pytest.mark.slow
def test_a_page_that_vanishes_lets_the_trial_end_and_the_plan_pause(folder: Path) -> None:
    for page in serve(folder, control=True, backend="sim://?clock=1"):
        page.take()
        watch = Watch(page)
        page.ask("/api/plan", "POST", ORDER)
        watch("recording", trial=1)  # and is not there from here on
        paused = quietly(page, "paused")
        assert "not seen" in paused["why"]
        trials = Session.open(folder / "mine").trials
        assert {trial.status for trial in trials} == {"complete"} and len(trials) == paused["trial"] - 1 < 3
        again = watch("paused")  # a page that comes back starts nothing by itself
        assert again["trial"] == paused["trial"]
        page.ask("/api/plan/resume", "POST", {})
        watch("recording")
        page.ask("/api/plan/abort", "POST", {})
        ended = quietly(page, "ended")
        assert ended["code"] == 130 and "outputs safe" in ended["message"] and "--resume" in ended["message"]
        last = Session.open(folder / "mine").trials[-1]
        assert last.status == "interrupted"
        assert page.ask("/api/plan", "POST", {"resume": "mine"}).status == 200
        assert watch("ended")["code"] == 0
        statuses = [trial.status for trial in Session.open(folder / "mine").trials]
        assert statuses.count("complete") == 3 and statuses.count("interrupted") == 1


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGSTOP])
def test_a_server_that_is_killed_or_stopped_lets_the_trial_end(folder: Path, how: signal.Signals) -> None:
    with own_process(folder, "--control", "--backend", "sim://?clock=1") as (server, page):
        page.take()
        page.ask("/api/plan", "POST", {**ORDER, "trials": 9})
        Watch(page)("recording", trial=1)
        server.send_signal(how)
        session = Session.open(folder / "mine", require_trials=False)
        for _ in range(600):
            if session.trials and not session.journals:
                break
            time.sleep(0.1)
        time.sleep(4.0 if how == signal.SIGSTOP else 1.0)
        done = len(session.trials)
        time.sleep(2.0)
        assert len(session.trials) == done < 9 and not session.journals  # nothing begins without a page
        assert {trial.status for trial in session.trials} == {"complete"}
        if how == signal.SIGSTOP:
            server.send_signal(signal.SIGCONT)
            assert quietly(page, "paused")["trial"] == done + 1
