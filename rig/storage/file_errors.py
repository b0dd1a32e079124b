"""One wording for what the file system refuses."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path

from rig.errors import RigInputError


@contextlib.contextmanager
def refused(path: Path, action: str, advice: str = "") -> Iterator[None]:
    """Turn an OSError in the block into :class:`rig.errors.RigInputError`: ``path: cannot be <action> (reason)``."""
    try:
        yield
    except OSError as error:
        reason = f"({error.strerror or error})"
        raise RigInputError(f"{path}: cannot be {action} {reason}{advice and '; '}{advice}") from error
