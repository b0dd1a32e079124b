"""Files of the model that appear under their name only when they are complete; before that nothing is changed."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from model.errors import InputError


@contextmanager
def whole_file(path: Path, advice: str = "choose another file") -> Iterator[Path]:
    """Give a name beside ``path`` to write to; the file takes the name ``path`` when the block ends well.

    Raises
    ------
    InputError : the block or the last step raised an ``OSError``; the message ends in ``advice``
    """
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        yield part
        os.replace(part, path)
    except OSError as problem:
        raise InputError(f"{path}: cannot be written ({problem.strerror or problem}); {advice}") from None
    finally:
        part.unlink(missing_ok=True)
