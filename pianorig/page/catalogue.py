"""Sessions, films and reports below a folder: rows for the table, and the file that a name in a request means."""

from __future__ import annotations

import json
import os
import stat
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pianorig.errors import CommandInputError
from pianorig.workflows.session_film import STEP
from rig.errors import RigError
from rig.session import Session, Trial
from rig.session.folder import FILM_SUFFIXES, UNREADABLE

LARGEST_RESULTS_BYTES = 64_000_000  # 1,000 trials write about 30 MB
MOST_FINDINGS = 50  # of one session in the list
LONGEST = 600  # characters of one text that the page shows


def shorten_text(text: object) -> str:
    """Text on one line, of bounded length."""
    words = " ".join(str(text).split())
    return words if len(words) <= LONGEST else words[: LONGEST - 1] + "…"


REPORT = "report.html"
RESULTS = "results.json"
LARGEST_BYTES = {"session.toml": 2_000_000, "annotations.jsonl": 20_000_000}  # thousands of conditions, of remarks
LARGEST_TRIAL_BYTES = 2_000_000_000  # a trial is hashed whole before it is opened; a larger one is named, not read


@dataclass(frozen=True)
class SessionRow:
    """A session as the table shows it; ``problem`` says why the rest is empty, ``stale`` that the report is older."""

    name: str
    created_utc: str = ""
    action: str = ""
    operator: str = ""
    profile: str = ""
    simulated: bool = False
    trials: int = 0
    rejected: int = 0
    status: str = UNREADABLE
    verdict: str = ""
    sentence: str = ""
    findings: tuple[str, ...] = ()
    n_findings: int = 0
    report: bool = False
    stale: bool = False
    problem: str = ""


def read_row(folder: Path) -> SessionRow:
    """Row of the list of sessions for the one in ``folder``; where that cannot be read, a row with its name and the
    ``problem`` in words."""
    try:
        session = open_session(folder)
        trials = session.trials
        info = session.info
        return SessionRow(
            name=folder.name,
            created_utc=shorten_text(info.created_utc),
            action=shorten_text(info.action.name),
            operator=shorten_text(info.operator),
            profile=shorten_text(info.profile.name),
            simulated=info.simulated,
            trials=len(trials),
            rejected=sum(trial.rejected is not None for trial in trials),
            status=_status(trials, bool(session.journals)),
            report=(folder / REPORT).is_file(),
            **results_of(folder / RESULTS, trials),
        )
    except (RigError, OSError, ValueError, RecursionError) as error:
        return SessionRow(name=folder.name, problem=_reason(error, folder))


def open_session(folder: Path) -> Session:
    """Open the session in ``folder``, also without trials; ValueError where its text files are too large, or something
    in it is no plain file. RigInputError as `Session.open`.

    A pipe or a device in place of a trial, a film or a table would hold whoever reads it for ever.
    """
    refuse_odd_files(folder)
    for name, largest in LARGEST_BYTES.items():
        path = folder / name
        if path.exists() and not path.is_file():
            raise ValueError(f"{name} is no file")
        if path.is_file() and path.stat().st_size > largest:
            raise ValueError(f"{name} has {path.stat().st_size / 1e6:.0f} MB, allowed {largest / 1e6:.0f}")
    return Session.open(folder, require_trials=False)


def refuse_odd_files(folder: Path) -> None:
    """Refuse a session's folder that holds a pipe, a socket or a device."""
    for place in (folder, *(path for path in (folder / "derived").glob("*") if path.is_dir())):
        with os.scandir(place) as entries:
            odd = next((entry.name for entry in entries if not _is_plain(entry)), None)
        if odd is not None:
            raise ValueError(f"{odd} is no file")


def _is_plain(entry: os.DirEntry[str]) -> bool:
    """A file or folder, also behind a link; a link that leads nowhere is harmless."""
    try:
        mode = entry.stat().st_mode
    except OSError:
        return True
    return stat.S_ISREG(mode) or stat.S_ISDIR(mode)


def readable_trial(session: Session, number: int) -> Trial:
    trial = session.trial(number)
    size = trial.path.stat().st_size if trial.path.is_file() else 0
    if size > LARGEST_TRIAL_BYTES:
        raise ValueError(f"trial {number} has {size / 1e6:.0f} MB, allowed {LARGEST_TRIAL_BYTES / 1e6:.0f}")
    return trial


def trial_status(trial: Trial) -> str:
    try:
        if not trial.path.is_file() or trial.path.stat().st_size > LARGEST_TRIAL_BYTES:
            return UNREADABLE
        return trial.status
    except (RigError, OSError):
        return UNREADABLE


def session_detail(folder: Path) -> dict[str, Any]:
    """Trials (number, status, reason of a rejection or None, film, whether tracked) and annotations of the session in
    ``folder``, as lists of plain dicts."""
    session = open_session(folder)
    return {
        "trials": [
            {
                "trial": trial.number,
                "status": trial_status(trial),
                "rejected": None if trial.rejected is None else shorten_text(trial.rejected),
                "film": "" if trial.film is None else trial.film.name,
                "tracked": session.derived_path(STEP, trial.number).is_file(),
            }
            for trial in session.trials
        ],
        "annotations": [
            {
                "trial": entry.trial,
                "kind": entry.kind,
                "reason": shorten_text(entry.reason),
                "author": shorten_text(entry.author),
                "time_utc": shorten_text(entry.time_utc),
            }
            for entry in session.annotations
        ],
    }


def _status(trials: tuple[Trial, ...], unsealed: bool) -> str:
    counts = Counter(trial_status(trial) for trial in trials)
    texts = [name if len(counts) == 1 else f"{n} {name}" for name, n in counts.most_common()]
    return ", ".join([*texts, *(["not sealed: recording, or cut off"] if unsealed else [])]) or "no trials"


def results_of(path: Path, trials: tuple[Trial, ...]) -> dict[str, Any]:
    """Fields of a session's row from a report's ``results.json``: verdict, findings, whether it is stale by the
    session's ``trials``; empty without that file, a ``problem`` where it cannot be read."""
    if not path.is_file():
        return {}
    try:
        size = path.stat().st_size
        if size > LARGEST_RESULTS_BYTES:
            limit = f"at most {LARGEST_RESULTS_BYTES / 1e6:.0f} read"
            return {"problem": f"results.json has {size / 1e6:.0f} MB, {limit}"}
        content = json.loads(path.read_text(encoding="utf-8"))
        try:
            return _results(content, trials)
        except KeyError as missing:
            version = content.get("schema_version", "unknown")
            return {"problem": f"results.json of version {version} lacks {missing}; make the report again"}
    except (OSError, ValueError, RecursionError, TypeError, AttributeError) as error:
        return {"problem": f"results.json cannot be read ({shorten_text(error)}); make the report again"}


def _results(content: dict[str, Any], trials: tuple[Trial, ...]) -> dict[str, Any]:
    """Verdict, first sentence and findings (the first few, and their number) of a report's content, and ``stale``:
    whether trials were added, exchanged, rejected or accepted since.

    By what the report itself says of them: times of files do not survive a copy.
    """
    lines, tables = content["verdict_lines"], content["tables"]
    # a fault of the session stands once for each model
    texts = list(dict.fromkeys(shorten_text(row["text"]) for row in tables["findings"]))
    outcomes = dict.fromkeys(shorten_text(result.get("outcome", "")) for result in content["results"])
    rejected = {int(row["trial"]): str(row["reason"]).startswith("rejected") for row in tables["trials"]}
    seals = dict(content["results"][0]["provenance"]["trials_sha256"])
    return {
        "verdict": ", ".join(text for text in outcomes if text),
        "sentence": shorten_text(lines[0]) if lines else "",
        "findings": tuple(texts[:MOST_FINDINGS]),
        "n_findings": len(texts),
        "stale": bool(seals)
        and (
            {trial.number: trial.rejected is not None for trial in trials} != rejected
            or any(trial.path.stem in seals and _seal(trial) != seals[trial.path.stem] for trial in trials)
        ),
    }


def _seal(trial: Trial) -> str:
    try:
        return trial.sha256 if trial.path.stat().st_size <= LARGEST_TRIAL_BYTES else ""
    except (RigError, OSError):
        return ""


def _reason(error: Exception, folder: Path) -> str:
    """The error in one line, without the path that the row names already."""
    return shorten_text(str(error).replace(f"{folder}: ", "").replace(f"{folder}/", "") or type(error).__name__)


SESSION_FILE = "session.toml"
COMPARISONS = "comparisons"
"""Folder, among the sessions, of reports of several of them."""
GIVEN_OUT = {
    ".html": "text/html; charset=utf-8",
    ".csv": "text/csv; charset=utf-8",
    ".json": "application/json",
    ".nc": "application/octet-stream",
}
"""Files of a report that are given out, and as what."""

Fingerprint = tuple[tuple[str, int, int], ...]


class UnknownName(ValueError):
    """A name in a request that is not that of a session or of a report's file."""


class Catalogue:
    """Sessions in a folder, read again only where a file has changed.

    Parameters
    ----------
    folder : where the sessions are; each a folder with a ``session.toml``
    """

    def __init__(self, folder: Path) -> None:
        if not folder.is_dir():
            raise CommandInputError(
                f"{folder}: no such folder; name the folder that holds your sessions, or record one:  pianorig demo"
            )
        if (folder / SESSION_FILE).is_file():
            raise CommandInputError(f"{folder}: is a session itself; name the folder above it, {folder.parent}")
        self.root = folder.absolute()
        self._known: dict[str, tuple[Fingerprint, SessionRow]] = {}

    def names(self) -> list[str]:
        """Names of the folders that hold a ``session.toml``."""
        return self._list_names(self.root, lambda path: (path / SESSION_FILE).is_file())

    def rows(self) -> list[SessionRow]:
        """Rows of all sessions below the root, newest first, those without a date last; a row is read again only where
        its folder has changed."""
        found = []
        for name in self.names():
            fingerprint = self._fingerprint(name)
            known = self._known.get(name)
            row = known[1] if known is not None and known[0] == fingerprint else read_row(self.root / name)
            self._known[name] = (fingerprint, row)
            found.append(row)
        return sorted(found, key=lambda row: row.created_utc, reverse=True)

    def folder(self, name: str) -> Path:
        """The folder of a session, which must be one of `names`."""
        if name not in self.names():
            raise UnknownName(f"no session {name[:120]!r} in {self.root}")
        return self.root / name

    def films(self) -> list[str]:
        """Names of the films that lie in the folder itself, beside the sessions."""
        return self._list_names(self.root, lambda path: path.suffix.lower() in FILM_SUFFIXES and path.is_file())

    def film(self, name: str) -> Path:
        """A film that lies on its own, which must be one of `films`."""
        if name not in self.films():
            raise UnknownName(f"no film {name[:120]!r} in {self.root}")
        return self.root / name

    def report_file(self, name: str, path: str = REPORT) -> tuple[Path, str]:
        """A file of a session's report, and its media type; it lies in the session's folder, also behind links."""
        return self._served_file(self.folder(name), path)

    def comparisons(self) -> list[str]:
        """Names of the reports of several sessions, newest first."""
        folder = self.root / COMPARISONS
        return self._list_names(folder, lambda path: (path / REPORT).is_file())[::-1] if folder.is_dir() else []

    def comparison_file(self, name: str, path: str = REPORT) -> tuple[Path, str]:
        if name not in self.comparisons():
            raise UnknownName(f"no comparison {name[:120]!r} in {self.root}")
        return self._served_file(self.root / COMPARISONS / name, path)

    @staticmethod
    def _served_file(report: Path, path: str) -> tuple[Path, str]:
        """Path of the file ``path`` in the folder ``report`` and its media type; `UnknownName` for a path that leads
        out of it, or a kind that is not served."""
        folder, name = report.resolve(), report.name
        try:
            file = (folder / path).resolve()
            inside = file.is_relative_to(folder) and file.is_file()
        except (OSError, ValueError) as error:  # a name that no file can have
            raise UnknownName(f"{name}: no file {path[:120]!r}") from error
        kind = GIVEN_OUT.get(file.suffix)
        if not inside or kind is None:
            raise UnknownName(f"{name}: no file {path[:120]!r} of a report")
        return file, kind

    @staticmethod
    def _list_names(folder: Path, is_one: Callable[[Path], bool]) -> list[str]:
        """Names in a folder, sorted, of what passes a test; what cannot be looked at does not."""
        found = []
        for path in folder.iterdir():
            with suppress(OSError):
                found += [path.name] if is_one(path) else []
        return sorted(found)

    def _fingerprint(self, name: str) -> Fingerprint:
        try:
            with os.scandir(self.root / name) as entries:
                found = [(entry.name, entry.stat(follow_symlinks=False)) for entry in entries]
        except OSError:
            return ()
        return tuple(sorted((file, stat.st_size, stat.st_mtime_ns) for file, stat in found))
