"""Results of a session, of this run and of earlier ones: plain values in one text file, tables in derived steps.

A value is given as it would be read back, so that a first and a later run cannot differ. What is missing, altered or
unreadable counts as not computed.
"""

from __future__ import annotations

import json
import os
import shutil
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from threading import Lock
from typing import Any

import pandas as pd

from rig.atomic_write import sha256_of_bytes, write_text
from rig.errors import RigInputError
from rig.session import Session
from validation.cache.content_hash import code_sha256, result_key

PLACE = ("derived", "scores", "kept.txt")
SCHEMA = "piano-action-rig kept results 1"
LARGEST_CHARACTERS = 16_000_000  # of the file; the results used longest ago are dropped first
MOST_VERSIONS = 8  # of a derived step, so that models side by side do not drive out each other's predictions
KINDS = (
    "predictions",
    "events",
    "look inside",
    "force sign and unit",
    "force reach",
    "compatible changes",
    "curve scores",
    "force from motion",
    "difference draws",
    "perfect model",
    "uncertainty budget",
)


class ResultStore:
    """Results of one session.

    Parameters
    ----------
    folder : Path, optional
        Session folder for values; None keeps none beyond this run.
    session : Session, optional
        Session for tables; None keeps none.
    """

    def __init__(self, folder: Path | None = None, session: Session | None = None) -> None:
        self.session = session
        self._file = None if folder is None else folder.joinpath(*PLACE)
        self._before = {} if self._file is None else _read(self._file)
        self._used: dict[str, str] = {}
        self._counts: Counter[tuple[str, bool]] = Counter()
        self._failures: dict[str, list[str]] = {}
        self._lock = Lock()

    def value(self, kind: str, inputs: object, make: Callable[[], Any]) -> Any:
        """The stored value of these inputs, or that of ``make()``, which is called, and its value stored, only when
        they have not been met before.

        Parameters
        ----------
        kind : what is computed
        inputs : arrays, numbers, text, and tuples, dicts and dataclasses of them, everything the result depends on
            beside the code of `validation`
        make : gives plain data: numbers, text, lists, dicts with names as keys
        """
        return self.values(kind, [inputs], lambda missing: [make() for _ in missing])[0]

    def values(self, kind: str, inputs: Sequence[object], make: Callable[[list[int]], Sequence[Any]]) -> list[Any]:
        """Values of a kind, from the store; ``make(indices)`` computes the missing ones, which are stored.

        Parameters
        ----------
        inputs : of each value what `value` takes
        make : gives one value for each place asked for; not called when all are stored
        """
        code = code_sha256("validation", "report")
        keys = [f"{kind}\t{result_key(kind, code, one)}" for one in inputs]
        found = {key: text for key in keys if (text := self._used.get(key) or self._before.get(key)) is not None}
        missing = [i for i, key in enumerate(keys) if key not in found]
        if missing:
            found |= {keys[i]: json.dumps(value) for i, value in zip(missing, make(missing), strict=True)}
        with self._lock:
            self._used |= found
            for key in keys:
                self._counts[kind, key in self._before] += 1
        return [json.loads(found[key]) for key in keys]

    def table(self, step: str, trial: int, key: str) -> tuple[pd.DataFrame, dict[str, Any]] | None:
        """Table and attributes of a derived step of one trial, stored under a key, and marked as used now; None when
        there are none."""
        if self.session is None:
            return None
        try:
            found = self.session.read_derived(step, trial)
        except RigInputError:  # damaged: made again
            return None
        if found is None or found[1].get("input_sha256") != key:
            return None
        with suppress(OSError):  # so that it is not the version used longest ago
            os.utime(self.session.derived_path(step, trial).parent)
        return found

    def write_table(self, step: str, trial: int, seal: str, table: pd.DataFrame, attributes: dict[str, Any]) -> str:
        """Write a derived step ``<step>_<version>`` of a trial; the reason why it could not be written, or "".

        The oldest versions are removed when a new one begins.
        """
        if self.session is None:
            return ""
        folder = self.session.derived_path(step, trial).parent
        is_new = not folder.is_dir()
        try:
            self.session.write_derived(step, trial, table, attributes, {f"trial_{trial:04d}.h5": seal})
            if is_new:
                _remove_oldest_versions(folder)
        except (RigInputError, OSError) as error:
            return str(error)
        return ""

    def count(self, kind: str, *, reused: bool, failure: str = "") -> None:
        """Count a table that was reused or made, and note why it could not be stored."""
        with self._lock:
            self._counts[kind, reused] += 1
            if failure:
                self._failures.setdefault(kind, []).append(failure)

    def summary(self) -> dict[str, str]:
        """Texts by kind on how many results were reused, such as ``4 of 5``."""
        kinds = dict.fromkeys(kind for kind, _ in self._counts)
        ordered = sorted(kinds, key=lambda kind: KINDS.index(kind) if kind in KINDS else len(KINDS))
        return {
            kind: f"{self._counts[kind, True]} of {self._counts[kind, True] + self._counts[kind, False]}"
            for kind in ordered
        }

    def save(self) -> list[str]:
        """Write the values this run has used beside those of other runs; what could not be written, and why."""
        lost = [f"{len(why)} {kind} not kept for the next run: {why[0]}" for kind, why in self._failures.items()]
        failure = self._write()
        return [*lost, f"scores not kept for the next run: {failure}"] if failure else lost

    def _write(self) -> str:
        """Rewrite the file, the entries used as its newest; returns the error's text, empty if it was written."""
        if self._file is None or self._used.keys() <= self._before.keys():
            return ""
        lines = _read(self._file)  # again: another run may have written meanwhile
        for key, text in self._used.items():
            lines.pop(key, None)
            lines[key] = text
        body = "".join(reversed(list(_select_newest(lines))))
        try:
            self._file.parent.mkdir(parents=True, exist_ok=True)
            write_text(self._file, _head(body) + body)
        except (RigInputError, OSError) as error:
            return str(error)
        return ""


def _select_newest(lines: dict[str, str]) -> Iterator[str]:
    """Yield the lines of the file, ``key``, tab, text, from the newest on, as far as its largest size allows."""
    size = 0
    for key, text in reversed(lines.items()):
        size += len(key) + len(text) + 2
        if size > LARGEST_CHARACTERS:
            return
        yield f"{key}\t{text}\n"


def _head(body: str) -> str:
    return f"{SCHEMA} {sha256_of_bytes(body.encode())}\n"


def _read(file: Path) -> dict[str, str]:
    """Key → text of every stored value; none when the file is not as it was written."""
    try:
        head, _, body = file.read_bytes().decode().partition("\n")
    except (OSError, ValueError):
        return {}
    if f"{head}\n" != _head(body):
        return {}
    lines = (line.split("\t") for line in body.splitlines())
    return {f"{kind}\t{key}": text for kind, key, text in lines}


def _remove_oldest_versions(new: Path) -> None:
    """Remove the versions of a derived step that were used longest ago, ``<step>_<version>`` beside a new one."""
    step = new.name.rpartition("_")[0]
    others = [folder for folder in new.parent.iterdir() if folder.name.rpartition("_")[0] == step and folder != new]
    for folder in sorted(others, key=lambda folder: folder.stat().st_mtime, reverse=True)[MOST_VERSIONS - 1 :]:
        shutil.rmtree(folder, ignore_errors=True)
