"""The page's side of a plan: what may be ordered, and one played at a time in its own process (`recorder_process`)."""

from __future__ import annotations

import json
import re
import subprocess
import tempfile
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import IO, Any

from pianorig.console.options import SELFTESTS
from pianorig.errors import CommandInputError
from pianorig.page.catalogue import Catalogue, UnknownName
from pianorig.page.jobs import begin_process, end_process
from pianorig.workflows.session_paths import new_session_folder
from rig.configuration.profile import built_in_profiles
from rig.recording.recover import due_entries
from rig.recording.trial_plan import MAX_TRIALS
from rig.session import Session

NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,80}")
LONGEST_TEXT = 200
PLAN_MARK = "piano-action-rig plan"
LARGEST_PLAN_BYTES = 200_000


@dataclass(frozen=True)
class Bench:
    """The bench that plans are played on; said in the terminal, never by the page.

    Attributes
    ----------
    rig : built-in rig or path of a rig file
    backend : address
    selftests : record of a self-test, or the folder of them
    """

    rig: str = "virtual"
    backend: str = "sim://"
    selftests: str = str(SELFTESTS)


@dataclass(frozen=True)
class Order:
    """A plan to be played; ``profile`` and ``trials``, or ``plan``, or ``resume``.

    Attributes
    ----------
    bench : where
    folder : the session's
    profile, trials : a built-in profile and how often it is played
    plan : path of a plan file
    resume : go on with the session that is there
    operator, action : in words, for ``session.toml``
    """

    bench: Bench
    folder: str
    profile: str = ""
    trials: int = 0
    plan: str = ""
    resume: bool = False
    operator: str = "unknown"
    action: str = "unknown"


def plan_files(root: Path) -> list[str]:
    """Names of the plan files that lie among the sessions."""
    return sorted(path.name for path in root.glob("*.toml") if _is_plan(path))


def _is_plan(path: Path) -> bool:
    try:
        if not path.is_file() or path.stat().st_size > LARGEST_PLAN_BYTES:
            return False
        return PLAN_MARK in path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError):
        return False


def choices(catalogue: Catalogue) -> dict[str, Any]:
    """What can be ordered: profiles and plan files."""
    return {"profiles": sorted(built_in_profiles()), "plans": plan_files(catalogue.root)}


def read_order(content: dict[str, Any], catalogue: Catalogue, bench: Bench) -> Order:
    """The order that a request states.

    Parameters
    ----------
    content : ``resume`` with the name of a session; or ``session`` with the name of a new one (empty: by date),
        ``profile`` and ``trials``, or ``plan``; ``operator``, ``action``

    Raises
    ------
    CommandInputError : something in it is not allowed
    UnknownName : no such session
    rig.errors.RigInputError : a session that cannot be resumed
    """
    words = {key: _text(content, key) for key in ("operator", "action", "session", "profile", "plan", "resume")}
    operator, action = words["operator"] or "unknown", words["action"] or "unknown"
    if words["resume"]:
        folder = catalogue.folder(words["resume"])
        if not due_entries(Session.open(folder, require_trials=False)):
            raise CommandInputError(f"{words['resume']}: every trial of its plan is there; nothing to resume")
        return Order(bench, str(folder), resume=True, operator=operator, action=action)
    if words["plan"]:
        if words["plan"] not in plan_files(catalogue.root):
            raise UnknownName(f"no plan {words['plan'][:80]!r} among the sessions")
        what: dict[str, Any] = {"plan": str(catalogue.root / words["plan"])}
    else:
        what = {"profile": words["profile"], "trials": content.get("trials")}
        if words["profile"] not in built_in_profiles():
            raise CommandInputError(f"profile {words['profile'][:80]!r}: allowed {', '.join(built_in_profiles())}")
        if type(what["trials"]) is not int or not 1 <= what["trials"] <= MAX_TRIALS:
            raise CommandInputError(f"trials {str(content.get('trials'))[:40]}: allowed 1 to {MAX_TRIALS}")
    return Order(bench, str(_new_folder(words, catalogue.root)), **what, operator=operator, action=action)


def _new_folder(words: dict[str, str], root: Path) -> Path:
    name = words["session"]
    if not name:
        return new_session_folder(words["plan"] or words["profile"], root=root)
    if not NAME.fullmatch(name):
        raise CommandInputError(
            f"session {name[:80]!r}: allowed are letters, digits, _ . and -, a letter or digit first"
        )
    if (root / name).exists():
        raise CommandInputError(f"session {name!r}: exists already; choose another name, or resume it")
    return root / name


def _text(content: dict[str, Any], key: str) -> str:
    text = content.get(key, "")
    if not isinstance(text, str) or len(text) > LONGEST_TEXT or not text.isprintable():
        raise CommandInputError(f"{key}: allowed is a line of text of at most {LONGEST_TEXT} characters")
    return text.strip()


SEEN_EVERY_S = 0.5
PATIENCE_S = 20.0
"""How long an aborted recorder may take to seal its trial before it is killed; the device's watchdog is then left."""
IDLE: dict[str, Any] = {"phase": "idle"}


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
            said = tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace")  # noqa: SIM115 `_follow` closes it
            process = begin_process(
                ["pianorig.page.recorder_process"], {"PYTHONUNBUFFERED": "1"}, stdin=subprocess.PIPE, stderr=said
            )
            self._process = process
            self._state = {"phase": "starting"}
        self._write(process, json.dumps(asdict(order)))
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
        """``pause`` before the next trial, ``resume``, or ``abort`` at once.

        Raises
        ------
        CommandInputError : nothing is being played
        """
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
            end_process(process, PATIENCE_S)
        if process.stdin is not None:
            with suppress(OSError):
                process.stdin.close()
