"""What was computed before from the same inputs: every result under a hash of all that entered it.

Place in the data flow: events, curve scores, pair scores, budget, friction search and runs of a look inside ask here
before they compute; kept in the session's ``derived/scores/kept.txt``.  Predictions are kept by
`validation.prediction.trial_prediction` in the same way, the report as a whole by `validation.cache.report_cache`.
Conventions: SHA-256 of the values themselves (arrays, numbers, text) and of the code that computes, never of names or
times of files: a session that was moved, renamed or touched finds its results, one altered sample does not.  A result
is plain data, and is given as it would be read back, so that a first and a later run cannot differ.
Failure: what is missing, altered or unreadable counts as not computed; what cannot be written costs only time.
"""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass
from pathlib import Path
from threading import Lock
from typing import Any

import numpy as np

from validation.cache.report_cache import code_sha256

PLACE = ("derived", "scores", "kept.txt")
SCHEMA = "piano-action-rig kept results 1"
LARGEST_CHARACTERS = 16_000_000  # of the file; the results used longest ago go first


class Kept:
    """Results of one session, those of earlier runs and those of this one.

    Parameters
    ----------
    folder : Path, optional
        Session folder; None keeps nothing beyond this run.
    """

    def __init__(self, folder: Path | None = None) -> None:
        self._file = None if folder is None else folder.joinpath(*PLACE)
        self._before = {} if self._file is None else _read(self._file)
        self._used: dict[str, str] = {}
        self._counts: Counter[tuple[str, bool]] = Counter()
        self._failures: dict[str, list[str]] = {}
        self._lock = Lock()

    def of(self, kind: str, inputs: object, make: Callable[[], Any]) -> Any:
        """The result of earlier, or of ``make``, which is asked only when these inputs have not been met before.

        Parameters
        ----------
        kind : str
            What is computed; results of two kinds never stand for each other.
        inputs : arrays, numbers, text, and tuples, dicts and dataclasses of them
            Everything the result depends on beside the code of `validation`.
        make : callable
            Gives plain data: numbers, text, lists, dicts with names as keys.
        """
        key = f"{kind}\t{sha256_of((kind, code_sha256('validation', 'report'), inputs))}"
        text = self._used.get(key) or self._before.get(key)
        if text is None:
            text = json.dumps(make())
        with self._lock:
            self._used[key] = text
            self._counts[kind, key in self._before] += 1
        return json.loads(text)

    def count(self, kind: str, *, reused: bool, failure: str = "") -> None:
        """Note a result that is kept elsewhere, or why it could not be."""
        self._counts[kind, reused] += 1
        if failure:
            self._failures.setdefault(kind, []).append(failure)

    def summary(self) -> dict[str, str]:
        """How many results of each kind were reused, ``4 of 5``."""
        kinds = dict.fromkeys(kind for kind, _ in self._counts)
        return {
            kind: f"{self._counts[kind, True]} of {self._counts[kind, True] + self._counts[kind, False]}"
            for kind in kinds
        }

    def save(self) -> list[str]:
        """Write what this run has used beside what others left; what could not be kept, and why."""
        lost = [f"{len(why)} {kind} not kept for the next run: {why[0]}" for kind, why in self._failures.items()]
        failure = self._write()
        return [*lost, f"scores not kept for the next run: {failure}"] if failure else lost

    def _write(self) -> str:
        from rig.errors import InputError as RigInputError
        from rig.storage.atomic_write import write_text

        if self._file is None or self._used.keys() <= self._before.keys():
            return ""
        lines = _read(self._file)  # again: another run may have written meanwhile
        for key, text in self._used.items():
            lines.pop(key, None)
            lines[key] = text
        kept, size = [], 0
        for key, text in reversed(lines.items()):
            size += len(key) + len(text) + 2
            if size > LARGEST_CHARACTERS:
                break
            kept.append(f"{key}\t{text}\n")
        body = "".join(reversed(kept))
        try:
            self._file.parent.mkdir(parents=True, exist_ok=True)
            write_text(self._file, _head(body) + body)
        except (RigInputError, OSError) as error:
            return str(error)
        return ""


def _head(body: str) -> str:
    return f"{SCHEMA} {hashlib.sha256(body.encode()).hexdigest()}\n"


def _read(file: Path) -> dict[str, str]:
    """Key → text of every kept result; none when the file is not as it was written."""
    try:
        head, _, body = file.read_bytes().decode().partition("\n")
    except (OSError, ValueError):
        return {}
    if f"{head}\n" != _head(body):
        return {}
    lines = (line.split("\t") for line in body.splitlines())
    return {f"{kind}\t{key}": text for kind, key, text in lines}


def sha256_of(value: object) -> str:
    """Hash of plain values, arrays and dataclasses, by type and content.

    Raises
    ------
    TypeError
        A value whose content cannot be told.
    """
    digest = hashlib.sha256()
    for part in _parts(value):
        digest.update(part)
    return digest.hexdigest()


def _parts(value: object) -> Iterator[bytes]:
    if isinstance(value, np.ndarray) and value.dtype.kind in "biuf":
        yield f"array {value.dtype.str} {value.shape} ".encode()
        yield np.ascontiguousarray(value).tobytes()
    elif isinstance(value, str):
        yield f"text {len(value)} {value}".encode()
    elif value is None or isinstance(value, bool | np.bool_):
        yield f"{value} ".encode()
    elif isinstance(value, int | np.integer):
        yield f"int {value} ".encode()
    elif isinstance(value, float | np.floating):
        yield f"float {float(value).hex()} ".encode()
    elif isinstance(value, tuple | list):
        yield f"list {len(value)} ".encode()
        for item in value:
            yield from _parts(item)
    elif isinstance(value, dict):
        yield f"dict {len(value)} ".encode()
        for name, item in value.items():
            yield from _parts(name)
            yield from _parts(item)
    elif is_dataclass(value) and not isinstance(value, type):
        yield f"{type(value).__qualname__} ".encode()
        for field in fields(value):
            yield from _parts(getattr(value, field.name))
    else:
        raise TypeError(f"{value!r} is a {type(value).__name__}: its content cannot be told")
