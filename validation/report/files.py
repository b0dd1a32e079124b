"""Writing a set of files together: all of them, or none.

Conventions: texts are UTF-8 with Unix line ends. Anything the file system refuses becomes a `ValidationInputError`;
temporary files and folders made on the way are removed.
"""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

from rig.atomic_write import replace_when_complete
from rig.errors import RigInputError
from validation.errors import InputError, ValidationInputError


def check_folder(folder: Path) -> None:
    """Raise an input error where ``folder`` is or lies below a file, or where nothing can be written in its nearest
    existing folder; nothing is made."""
    nearest = folder
    while not nearest.exists() and nearest != nearest.parent:
        nearest = nearest.parent
    if not nearest.is_dir():
        raise InputError(f"{folder}: {nearest} is a file; name a folder")
    check_writable(nearest)


def check_writable(folder: Path) -> None:
    """Raise an input error where no file can be made in an existing ``folder``, by making an empty one and removing it;
    permissions alone do not tell."""
    probe = folder / f".written.{os.getpid()}.part"
    try:
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise InputError(f"{folder}: cannot be written ({error.strerror or error}); choose another folder") from None


def write_files(folder: Path, texts: dict[str, str | bytes]) -> dict[str, Path]:
    """Write texts and bytes, by relative name, into ``folder``, made if need be; older files are replaced once all are
    written. Returns the path by name. Raises an input error if that fails, and removes the folders made."""
    made: list[Path] = []
    try:
        with contextlib.ExitStack() as whole:
            for name, text in texts.items():
                path = folder / name
                _make(path.parent, made)
                if path.is_dir():
                    raise IsADirectoryError(21, "is a folder", str(path))
                part = whole.enter_context(replace_when_complete(path))
                part.write_bytes(text if isinstance(text, bytes) else text.encode("utf-8"))
    except (OSError, RigInputError) as problem:
        error = problem.__cause__ if isinstance(problem.__cause__, OSError) else problem
        for made_folder in reversed(made):
            with contextlib.suppress(OSError):
                made_folder.rmdir()
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"{folder}: cannot be written ({reason}); choose another folder") from problem
    return {name: folder / name for name in texts}


def _make(folder: Path, made: list[Path]) -> None:
    """Make a folder and its parents where they do not exist; each new one is appended to ``made``, outermost first."""
    if folder.is_dir():
        return
    if folder.parent != folder:
        _make(folder.parent, made)
    folder.mkdir()
    made.append(folder)


def check_target(path: str | Path, ending: str = ".toml") -> Path:
    """The path of a file to write, if it has the ``ending``, lies in an existing writable folder and is no folder; else
    an input error is raised. The file is not made."""
    target = Path(path)
    if target.suffix != ending:
        raise ValidationInputError(f"{target}: ending found {target.suffix!r}, allowed {ending}")
    if not target.parent.is_dir():
        raise ValidationInputError(f"{target}: there is no folder {target.parent}; make it or choose another")
    if target.is_dir():
        raise ValidationInputError(f"{target}: is a folder; name a file")
    check_writable(target.parent)
    return target
