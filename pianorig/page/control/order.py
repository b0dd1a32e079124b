"""What the page may order: a plan on the bench that the terminal named, or the rest of a session's plan."""

from __future__ import annotations

import re
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from pianorig.console.options import SELFTESTS
from pianorig.errors import CommandInputError
from pianorig.page.catalogue.catalogue import Catalogue, UnknownName
from pianorig.workflows.session_paths import new_session_folder
from rig.configuration.profile import built_in_profiles
from rig.recording.resume import due_entries
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

    def to_plain(self) -> dict[str, Any]:
        """As plain data, for the recorder's process."""
        return asdict(self)

    @classmethod
    def from_plain(cls, plain: dict[str, Any]) -> Order:
        """Restored from `to_plain`."""
        return cls(**{**plain, "bench": Bench(**plain["bench"])})


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
