"""``annotations.jsonl``: remarks on trials made after they were sealed; append-only.

A rejected trial stays on disk; rejecting and accepting only add lines, the last of them counts. A line that cannot be
read is refused with its number.
"""

from __future__ import annotations

import errno
import json
import os
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal, get_args

from rig import platform_calls
from rig.atomic_write import translate_os_error
from rig.errors import RigInputError, refuse

FILE_NAME = "annotations.jsonl"
Kind = Literal["reject", "accept", "note"]


@dataclass(frozen=True)
class Annotation:
    """One line: ``kind`` is ``reject``, ``accept`` or ``note``; ``trial`` 0 means the whole session."""

    trial: int
    kind: Kind
    reason: str
    author: str
    time_utc: str


def utc_now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")


def append(folder: Path, trial: int, kind: Kind, reason: str, author: str = "") -> Annotation:
    """Append an annotation of a trial (0: the whole session) to ``annotations.jsonl`` in the session folder and return
    it; ``kind``: reject, accept or note; an empty author becomes ``unknown``. RigInputError for another kind or an
    empty reason."""
    refuse(
        RigInputError,
        (kind not in get_args(Kind), f"{folder}: annotation {kind!r}: allowed are {', '.join(get_args(Kind))}"),
        (not reason.strip(), f"{folder}: annotation of trial {trial} has no reason; give one"),
    )
    annotation = Annotation(trial=trial, kind=kind, reason=reason, author=author or "unknown", time_utc=utc_now())
    line = (json.dumps(asdict(annotation)) + "\n").encode("utf-8")
    path = folder / FILE_NAME
    with translate_os_error(path, "written"):
        descriptor = platform_calls.open_raw(path, os.O_RDWR | os.O_APPEND | os.O_CREAT)
        try:
            before = os.fstat(descriptor).st_size
            os.lseek(descriptor, max(before - 1, 0), os.SEEK_SET)
            if os.read(descriptor, 1) not in (b"", b"\n"):  # written by hand, without an end of its last line
                line = b"\n" + line
            if os.write(descriptor, line) < len(line):  # half a line would make the session unreadable
                os.ftruncate(descriptor, before)
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        finally:
            os.close(descriptor)
    return annotation


def read(folder: Path) -> tuple[Annotation, ...]:
    """Return all annotations of the session in ``folder`` in the order they were made; none when there is no file;
    RigInputError for a line that is no annotation."""
    path = folder / FILE_NAME
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        return ()
    except (OSError, UnicodeDecodeError) as error:
        raise RigInputError(f"{path}: cannot be read ({error})") from error
    return tuple(_parse(line, f"{path}:{number}") for number, line in enumerate(text.splitlines(), 1) if line.strip())


def _parse(line: str, where: str) -> Annotation:
    """Parse a JSON line of the annotations; RigInputError, which names file and line by ``where``, for what is none."""
    try:
        fields = json.loads(line)
        annotation = Annotation(**fields)
    except (ValueError, TypeError, RecursionError) as error:
        raise RigInputError(
            f"{where}: not an annotation ({str(error).splitlines()[0]}); remove or repair the line"
        ) from error
    texts = (annotation.reason, annotation.author, annotation.time_utc)
    if annotation.kind not in get_args(Kind) or type(annotation.trial) is not int or annotation.trial < 0:
        raise RigInputError(f"{where}: kind {annotation.kind!r}, trial {annotation.trial!r}: not an annotation")
    if not all(isinstance(text, str) for text in texts) or not annotation.reason.strip():
        raise RigInputError(f"{where}: reason, author and time_utc must be text, the reason not empty; repair the line")
    return annotation


def rejections(annotations: tuple[Annotation, ...]) -> dict[int, str]:
    """Return the reason of every trial that stands rejected, by its number: rejected, and not accepted by a later
    annotation."""
    rejected: dict[int, str] = {}
    for annotation in annotations:
        if annotation.kind == "reject":
            rejected[annotation.trial] = annotation.reason
        elif annotation.kind == "accept":
            rejected.pop(annotation.trial, None)
    return rejected
