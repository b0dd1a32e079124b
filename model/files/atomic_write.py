"""The model's one writer of files: a file appears under its name only when it is complete."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from model.errors import InputError


@contextmanager
def whole_file(path: Path, advice: str = "choose another file") -> Iterator[Path]:
    """Yield a temporary name in the folder of ``path``; renamed to ``path``, in place of a file that is there, when the
    block succeeds, else deleted. `InputError`, which ends with ``advice``, where that cannot be written."""
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        yield part
        os.replace(part, path)
    except OSError as problem:
        raise InputError(f"{path}: cannot be written ({problem.strerror or problem}); {advice}") from None
    finally:
        part.unlink(missing_ok=True)
