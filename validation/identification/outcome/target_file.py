"""Where an identified action is written: checked before any work is done, without loading what does the work."""

from __future__ import annotations

from pathlib import Path

from validation.errors import ValidationInputError


def check_target(path: str | Path) -> Path:
    """The path, if it can be one of an action file."""
    target = Path(path)
    if target.suffix != ".toml":
        raise ValidationInputError(f"{target}: ending found {target.suffix!r}, allowed .toml")
    if not target.parent.is_dir():
        raise ValidationInputError(f"{target}: there is no folder {target.parent}; make it or choose another")
    return target
