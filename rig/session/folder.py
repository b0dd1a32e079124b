"""The session folder: ``session.toml``, trials, films, annotations and derived results.

Created by the recorder or an importer. The listing is read from disk at every access; trials are never rewritten.
Failures are :class:`rig.errors.RigInputError`, one line each. ``derived/<step>/trial_NNNN.h5`` holds tables that can be
made again (`rig.session.derived_table`).
"""

from __future__ import annotations

import contextlib
import html
import re
import shutil
import warnings
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rig.atomic_write import translate_os_error, write_text
from rig.configuration import toml_file
from rig.errors import RigInputError
from rig.session import annotation_file
from rig.session.derived_table import read_table, write_table
from rig.session.info import SessionInfo
from rig.session.sealed_trial import (
    copied_trial,
    read_condition,
    read_status,
    read_trial,
    trial_problem,
    write_trial,
    write_trial_parts,
)
from rig.session.trial_data import TrialData
from rig.tabular import MOST_NAMES, Tabular

if TYPE_CHECKING:
    import pandas as pd

    from rig.session.force_correction import CorrectedForce

INFO_NAME = "session.toml"
FILM_SUFFIXES = (
    *(".mraw", ".cine", ".avi", ".tif", ".tiff", ".mp4", ".mov", ".mkv", ".m4v", ".webm", ".3gp"),
    *(".mts", ".m2ts", ".ts", ".mpg", ".mpeg", ".mxf"),
)
"""Films that a session can hold: every format of one file that `vision.film.open` reads."""
UNREADABLE = "unreadable"
"""Status of a trial whose file cannot be read."""
_NUMBERED = re.compile(r"trial_(?P<number>\d{4,})\.(?P<suffix>h5|journal)")


class Trial(Tabular):
    """One trial of a session: its file, whether it counts, and its film; ``trial["hammer"]`` reads one angle."""

    def __init__(self, path: Path, number: int, rejected: str | None) -> None:
        self.path = path
        self.number = number
        self.rejected = rejected
        """Reason of the rejection, or None."""

    def __repr__(self) -> str:
        return f"Trial({self.number}, {str(self.path)!r}, rejected={self.rejected!r})"

    @property
    def status(self) -> str:
        """``complete``, ``not at rest``, ``interrupted``, ``fault``, ``defect``, ``incomplete`` or ``unreadable``."""
        return UNREADABLE if self.problem else read_status(self.path)[0]

    @property
    def problem(self) -> str:
        """Why the trial cannot be read, in one line; empty where it can."""
        problem = trial_problem(self.path)
        if not problem and (original := copied_trial(self.path, self.number)):
            return f"{self.path}: is a copy of {original}; restore trial {self.number}, or remove the copy"
        return problem

    def warn_if_unreadable(self) -> bool:
        """Whether the trial cannot be read; a warning then says that it is left out, and why."""
        if self.problem:
            warnings.warn(f"trial {self.number} is left out: {self.problem}", stacklevel=3)
        return bool(self.problem)

    @property
    def condition(self) -> str:
        """Condition that the trial was recorded under; empty where none is known."""
        return "" if self.problem else read_condition(self.path)

    @property
    def sha256(self) -> str:
        """Seal of the trial: SHA-256 over its arrays and attributes."""
        return read_status(self.path)[1]

    @property
    def film(self) -> Path | None:
        """Film beside the trial file, or None."""
        for suffix in FILM_SUFFIXES:
            candidate = self.path.with_suffix(suffix)
            if candidate.is_file():
                return candidate
        return None

    def read(self) -> TrialData:
        """Read and check the trial's data."""
        return read_trial(self.path)

    def columns(self) -> dict[str, NDArray[Any]]:
        """Columns by name, read from the file (`TrialData.columns`)."""
        return self.read().columns()

    def to_frame(self) -> pd.DataFrame:
        """Read the trial as a pandas table; ``attrs["units"]`` has the unit of each column."""
        return self.read().to_frame()

    @property
    def time_s(self) -> NDArray[np.float64]:
        """Sample times (n,), s, read from the file."""
        return self.read().time_s

    @property
    def duration_s(self) -> float:
        """Samples over their rate, s, read from the file."""
        return self.read().duration_s

    @property
    def force_n(self) -> NDArray[np.float64]:
        """Corrected force at the sample times (n,), N, read from the file."""
        return self.read().force_n

    @property
    def raw_force_n(self) -> NDArray[np.float64]:
        """Force as it was read (n,), N, read from the file."""
        return self.read().raw_force_n

    @property
    def peak_force_n(self) -> float:
        """Largest corrected force, N, read from the file; NaN where there is none."""
        return self.read().peak_force_n

    @property
    def angle_rad(self) -> NDArray[np.float64]:
        """Encoder angles (n, encoders), rad, zero at the first sample, read from the file."""
        return self.read().angle_rad

    def corrected_force(self) -> CorrectedForce:
        """Return the force as it acted (`TrialData.corrected_force`)."""
        return self.read().corrected_force()


class Session:
    """A session folder, opened by `rig.open_session`: its trials in order, ``session[3]`` the trial of number 3."""

    def __init__(self, path: Path, info: SessionInfo | None = None) -> None:
        if info is None:
            raise RigInputError(f"rig.Session: open the folder with rig.open_session({str(path)!r})")
        self.path = path
        self.info = info

    def __repr__(self) -> str:
        trials = self.trials
        rejected = sum(trial.rejected is not None for trial in trials)
        count = f"{len(trials)} trial{'' if len(trials) == 1 else 's'}"
        return f"Session({str(self.path)!r}: {count}{f', {rejected} rejected' if rejected else ''})"

    def __len__(self) -> int:
        return len(self._files_by_number("h5"))

    def __bool__(self) -> bool:
        return True  # a session that is being recorded may have no trial yet

    def __iter__(self) -> Iterator[Trial]:
        return iter(self.trials)

    def __getitem__(self, number: int) -> Trial:
        return self.trial(number)

    @classmethod
    def open(cls, path: str | Path, *, require_trials: bool = True) -> Session:
        """Open the session in an existing folder; RigInputError where it or its ``session.toml`` is missing or cannot
        be read, or, unless ``require_trials`` is False, it has no trials.

        Raises RigInputError when the folder, its ``session.toml`` or (unless ``require_trials`` is False) its trials
        are missing or unreadable.
        """
        folder = Path(path)
        if not folder.is_dir():
            raise RigInputError(f"{folder}: no such session folder")
        file = folder / INFO_NAME
        if not file.is_file():
            inside = sorted(one.parent.name for one in folder.glob(f"*/{INFO_NAME}"))[:MOST_NAMES]
            hint = f"; it holds the sessions {', '.join(inside)}" if inside else ""
            raise RigInputError(f"{folder}: not a session, {INFO_NAME} is missing{hint}")
        info = toml_file.check(SessionInfo, toml_file.parse_toml(toml_file.read_text(file), str(file)), str(file))
        session = cls(folder, info)
        if require_trials and not session.trials:
            if session.journals:
                raise RigInputError(f"{folder}: the recording was cut off; run  pianorig recover {folder}")
            raise RigInputError(f"{folder}: the session has no trials (no file trial_0001.h5); record or import some")
        return session

    @classmethod
    def create(cls, path: str | Path, info: SessionInfo, files: Mapping[str, str] | None = None) -> Session:
        """Create a session folder with ``session.toml`` from ``info`` and text files to keep beside it, by name;
        RigInputError, and nothing is left, where the folder is not empty or cannot be written.

        Parameters
        ----------
        path : a folder that does not exist yet, or is empty
        info : contents of ``session.toml``
        files : mapping of file name to text, optional, copies to keep beside it (rig file, profile)

        Raises
        ------
        RigInputError
            When the folder is not empty or cannot be written; nothing is left behind then.
        """
        folder = Path(path)
        existed = folder.is_dir()
        with translate_os_error(folder, "created", "choose a writable place"):
            if folder.exists() and (not existed or any(folder.iterdir())):
                raise RigInputError(f"{folder}: exists already and is not an empty folder; choose another name")
            folder.mkdir(parents=True, exist_ok=True)
        try:
            for name, text in (files or {}).items():
                write_text(folder / name, text)
            write_text(folder / INFO_NAME, toml_file.dump_toml(info.to_table()))
        except BaseException:
            if not existed:
                shutil.rmtree(folder, ignore_errors=True)
            raise
        return cls(folder, info)

    @property
    def trials(self) -> tuple[Trial, ...]:
        """Trials on disk in the order of their numbers, rejected ones included."""
        rejected = annotation_file.rejections(annotation_file.read(self.path))
        return tuple(Trial(file, number, rejected.get(number)) for number, file in self._files_by_number("h5").items())

    @property
    def readable_trials(self) -> tuple[Trial, ...]:
        """Trials that can be read; one warning for each that cannot."""
        return tuple(trial for trial in self.trials if not trial.warn_if_unreadable())

    @property
    def journals(self) -> dict[int, Path]:
        """Journals of trials that are not sealed, by number; during a recording, of the current trial."""
        return self._files_by_number("journal")

    def _files_by_number(self, suffix: str) -> dict[int, Path]:
        """Paths ``trial_NNNN.<suffix>`` in the session's folder by trial number, in rising order; ``suffix``: ``h5`` or
        ``journal``."""
        found = {}
        with contextlib.suppress(FileNotFoundError):
            for file in self.path.iterdir():
                match = _NUMBERED.fullmatch(file.name)
                if match and match["suffix"] == suffix:
                    found[int(match["number"])] = file
        return dict(sorted(found.items()))

    def to_frame(self) -> pd.DataFrame:
        """Table with a row for each trial, rejected ones too: trial (number), status, rejected (reason or ""),
        duration_s, peak_force_n (corrected), frames (number), film (name or "").

        A trial that cannot be read has the status ``unreadable`` and no duration. The force is corrected, NaN where
        that cannot be done.
        """
        import pandas as pd  # start-up: pandas costs 0.4 s, opening a session does not need it

        rows = []
        for trial in self.trials:
            data = None if trial.problem else trial.read()
            rows.append(
                {
                    "trial": trial.number,
                    "status": UNREADABLE if data is None else data.status,
                    "rejected": trial.rejected or "",
                    "duration_s": float("nan") if data is None else data.duration_s,
                    "peak_force_n": float("nan") if data is None else data.peak_force_n,
                    "frames": data.camera.n_frames if data and data.camera else 0,
                    "film": trial.film.name if trial.film else "",
                }
            )
        return pd.DataFrame(rows)

    def summary(self) -> pd.DataFrame:
        """The former name of `to_frame`, for one release."""
        warnings.warn("summary() is to_frame() now", DeprecationWarning, stacklevel=2)
        return self.to_frame()

    def _repr_html_(self) -> str:
        return html.escape(str(self.path)) + str(self.to_frame().to_html(index=False, float_format="{:.2f}".format))

    def trial(self, number: int) -> Trial:
        """Return the trial with this number, rejected or not; RigInputError where the session has none."""
        if not isinstance(number, int | np.integer):
            raise RigInputError(f"{self.path}: trial: found {number!r}, allowed one number; list(session) can be cut")
        for trial in self.trials:
            if trial.number == number:
                return trial
        raise RigInputError(f"{self.path}: no trial {number}; there are {[trial.number for trial in self.trials]}")

    def trial_path(self, number: int) -> Path:
        """Path of the file of trial ``number``."""
        return self.path / f"trial_{number:04d}.h5"

    def journal_path(self, number: int) -> Path:
        """Path of the journal of trial ``number``."""
        return self.path / f"trial_{number:04d}.journal"

    def add_trial(self, data: TrialData) -> Trial:
        """Write and seal one trial under its number."""
        path = self.trial_path(data.number)
        write_trial(path, data)
        return Trial(path, data.number, None)

    def add_trial_parts(self, about: TrialData, n_samples: int, parts: Iterable[TrialData]) -> Trial:
        """Write and seal one trial whose ``n_samples`` come in parts (:mod:`rig.session.sealed_trial`)."""
        path = self.trial_path(about.number)
        write_trial_parts(path, about, n_samples, parts)
        return Trial(path, about.number, None)

    @property
    def annotations(self) -> tuple[annotation_file.Annotation, ...]:
        """All annotations, oldest first."""
        return annotation_file.read(self.path)

    def annotate(
        self, trial: int, kind: annotation_file.Kind, reason: str, *, author: str = ""
    ) -> annotation_file.Annotation:
        """Append an annotation: reject, accept again, or note; trial 0 is the whole session (notes only)."""
        if trial != 0 or kind != "note":
            self.trial(trial)
        return annotation_file.append(self.path, trial, kind, reason, author)

    def derived_path(self, step: str, trial_number: int) -> Path:
        """Path of the derived file of one step and trial."""
        if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_.-]*", step):
            raise RigInputError(f"{self.path}: derived step {step!r}: use letters, digits, '_', '-', '.'")
        return self.path / "derived" / step / f"trial_{trial_number:04d}.h5"

    def write_derived(
        self,
        step: str,
        trial_number: int,
        table: pd.DataFrame,
        attrs: Mapping[str, Any] | None = None,
        parents_sha256: Mapping[str, str] | None = None,
    ) -> Path:
        """Write a table made from a trial to ``derived/STEP/trial_NNNN.h5``, replacing an older one; return the path.
        ``parents_sha256``: SHA-256 by name of the files it was made from; None: of the trial's file."""
        parents = parents_sha256
        if parents is None:
            trial = self.trial(trial_number)
            parents = {trial.path.name: trial.sha256}
        path = self.derived_path(step, trial_number)
        write_table(path, table, attrs or {}, parents)
        return path

    def read_derived(self, step: str, trial_number: int) -> tuple[pd.DataFrame, dict[str, Any]] | None:
        """Return (table, attributes with ``parents_sha256``) of a step, or None when it has not been made."""
        path = self.derived_path(step, trial_number)
        return read_table(path) if path.is_file() else None


def open_session(path: str | Path) -> Session:
    """Open the session in a folder; RigInputError where it or its ``session.toml`` is missing or cannot be read, or it
    has no trials.

    Parameters
    ----------
    path : str or Path
        The session's folder.

    Returns
    -------
    Session
        Iterates over its trials; ``session[3]`` is the trial of number 3.

    Raises
    ------
    RigInputError
        The folder, its ``session.toml`` or its trials are missing or unreadable.

    Examples
    --------
    >>> import rig
    >>> session = rig.open_session("sessions/example_forte")
    >>> len(session), session[2].status
    (3, 'complete')
    """
    return Session.open(path)
