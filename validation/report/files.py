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
    """Refuse early what cannot become a folder to write in.

    Raises
    ------
    InputError
        When the path is a file, lies below a file, or nothing can be written in its nearest existing folder.
    """
    nearest = folder
    while not nearest.exists() and nearest != nearest.parent:
        nearest = nearest.parent
    if not nearest.is_dir():
        raise InputError(f"{folder}: {nearest} is a file; name a folder")
    check_writable(nearest)


def check_writable(folder: Path) -> None:
    """Refuse early a folder that no file can be made in; what its permissions say is not the whole truth.

    Raises
    ------
    InputError
        With what the file system says.
    """
    probe = folder / f".written.{os.getpid()}.part"
    try:
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise InputError(f"{folder}: cannot be written ({error.strerror or error}); choose another folder") from None


def write_files(folder: Path, texts: dict[str, str | bytes]) -> dict[str, Path]:
    """Write texts and bytes under their relative names, replacing older ones only when all have been written.

    Returns
    -------
    dict
        Relative name → path.
    """
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
    """Make a folder and its parents; each new one is appended to ``made``."""
    if folder.is_dir():
        return
    if folder.parent != folder:
        _make(folder.parent, made)
    folder.mkdir()
    made.append(folder)


def check_target(path: str | Path, ending: str = ".toml") -> Path:
    """The path, if it can be one of an action file or a plan, or of a file with another ending."""
    target = Path(path)
    if target.suffix != ending:
        raise ValidationInputError(f"{target}: ending found {target.suffix!r}, allowed {ending}")
    if not target.parent.is_dir():
        raise ValidationInputError(f"{target}: there is no folder {target.parent}; make it or choose another")
    if target.is_dir():
        raise ValidationInputError(f"{target}: is a folder; name a file")
    check_writable(target.parent)
    return target
