"""Where an identified action or a plan is written: checked before any work, without loading what does it."""

from __future__ import annotations

from pathlib import Path

from validation.errors import ValidationInputError
from validation.report.files import check_writable


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
