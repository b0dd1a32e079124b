"""One row of the table of sessions, and what is shown of one that was chosen."""

from __future__ import annotations

import os
import stat
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pianorig.page.catalogue.result_summary import ResultSummary, read_results, shortened
from pianorig.workflows.film.session_film import STEP
from rig.errors import RigError
from rig.session import Session, Trial

REPORT = "report.html"
RESULTS = "results.json"
UNREADABLE = "unreadable"
LARGEST_BYTES = {"session.toml": 2_000_000, "annotations.jsonl": 20_000_000}
LARGEST_TRIAL_BYTES = 2_000_000_000
"""A trial is hashed whole before it is opened; one above this size is named, not read."""


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
    """The row of a folder; one that cannot be read has a ``problem``."""
    try:
        session = open_session(folder)
        trials = session.trials
        info = session.info
        found = read_results(folder / RESULTS) or ResultSummary()
        return SessionRow(
            name=folder.name,
            created_utc=shortened(info.created_utc),
            action=shortened(info.action.name),
            operator=shortened(info.operator),
            profile=shortened(info.profile.name),
            simulated=info.simulated,
            trials=len(trials),
            rejected=sum(trial.rejected is not None for trial in trials),
            status=_status(trials, bool(session.journals)),
            verdict=found.outcome,
            sentence=found.sentence,
            findings=found.findings,
            n_findings=found.n_findings,
            report=(folder / REPORT).is_file(),
            stale=_is_older(found, trials),
            problem=found.problem,
        )
    except (RigError, OSError, ValueError, RecursionError) as error:
        return SessionRow(name=folder.name, problem=_reason(error, folder))


def open_session(folder: Path) -> Session:
    """The session, unless its text files are too large to be what they say, or something in it is no plain file.

    A pipe or a device in place of a trial, a film or a table would hold whoever reads it for ever.

    Raises
    ------
    rig.errors.RigInputError : the session cannot be read
    ValueError : a file is too large, or is none
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
    """Refuse a session's folder that holds a pipe, a socket or a device.

    Raises
    ------
    ValueError : naming it
    """
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
    """A trial that is not too large to be read.

    Raises
    ------
    rig.errors.RigInputError : no such trial
    ValueError : it is too large
    """
    trial = session.trial(number)
    size = trial.path.stat().st_size if trial.path.is_file() else 0
    if size > LARGEST_TRIAL_BYTES:
        raise ValueError(f"trial {number} has {size / 1e6:.0f} MB, allowed {LARGEST_TRIAL_BYTES / 1e6:.0f}")
    return trial


def trial_status(trial: Trial) -> str:
    """Status of a trial, or ``unreadable``."""
    try:
        if not trial.path.is_file() or trial.path.stat().st_size > LARGEST_TRIAL_BYTES:
            return UNREADABLE
        return trial.status
    except (RigError, OSError):
        return UNREADABLE


def session_detail(folder: Path) -> dict[str, Any]:
    """Trials and annotations of a session, as plain values.

    Raises
    ------
    rig.errors.RigInputError, ValueError : the session cannot be read
    """
    session = open_session(folder)
    return {
        "trials": [
            {
                "trial": trial.number,
                "status": trial_status(trial),
                "rejected": None if trial.rejected is None else shortened(trial.rejected),
                "film": "" if trial.film is None else trial.film.name,
                "tracked": session.derived_path(STEP, trial.number).is_file(),
            }
            for trial in session.trials
        ],
        "annotations": [
            {
                "trial": entry.trial,
                "kind": entry.kind,
                "reason": shortened(entry.reason),
                "author": shortened(entry.author),
                "time_utc": shortened(entry.time_utc),
            }
            for entry in session.annotations
        ],
    }


def _status(trials: tuple[Trial, ...], unsealed: bool) -> str:
    counts = Counter(trial_status(trial) for trial in trials)
    texts = [name if len(counts) == 1 else f"{n} {name}" for name, n in counts.most_common()]
    return ", ".join([*texts, *(["not sealed: recording, or cut off"] if unsealed else [])]) or "no trials"


def _is_older(found: ResultSummary, trials: tuple[Trial, ...]) -> bool:
    """Whether trials were added, exchanged, rejected or accepted since the report was made.

    By what the report itself says of them: times of files do not survive a copy.
    """
    if found.problem or not found.seals:
        return False
    if {trial.number: trial.rejected is not None for trial in trials} != dict(found.rejected):
        return True
    return any(trial.path.stem in found.seals and _seal(trial) != found.seals[trial.path.stem] for trial in trials)


def _seal(trial: Trial) -> str:
    try:
        return trial.sha256 if trial.path.stat().st_size <= LARGEST_TRIAL_BYTES else ""
    except (RigError, OSError):
        return ""


def _reason(error: Exception, folder: Path) -> str:
    """The error in one line, without the path that the row names already."""
    return shortened(str(error).replace(f"{folder}: ", "").replace(f"{folder}/", "") or type(error).__name__)
