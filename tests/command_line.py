"""The command line run inside the test's process."""

from __future__ import annotations

from pathlib import Path

import pytest

from pianorig.cli import main


def run(*arguments: str | Path) -> int:
    """Exit code of a command."""
    with pytest.raises(SystemExit) as caught:
        main([str(argument) for argument in arguments])
    return int(caught.value.code or 0)
