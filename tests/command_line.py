"""The command line run inside the test's process, or in a fresh one to see what it imports."""

from __future__ import annotations

import functools
import os
import subprocess
import sys
from pathlib import Path

import pytest

from pianorig.cli import main


def run(*arguments: str | Path) -> int:
    """Exit code of a command."""
    with pytest.raises(SystemExit) as caught:
        main([str(argument) for argument in arguments])
    return int(caught.value.code or 0)


@functools.cache
def modules_of_numba() -> frozenset[str]:
    """Modules that Numba loads, without its BLAS support: docs/explanation/lanes.md."""
    code = "import sys, numba\nprint(*sorted(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=os.environ)
    return frozenset(done.stdout.split())


def modules_after(*lines: tuple[str | Path, ...]) -> set[str]:
    """Modules that a fresh process has imported after these command lines, one after the other."""
    code = (
        "import sys\n"
        "from pianorig.cli import main\n"
        f"for line in {[[str(word) for word in line] for line in lines]!r}:\n"
        "    try:\n        main(line)\n"
        "    except SystemExit as stop:\n        assert not stop.code, (line, stop.code)\n"
        "print('MODULES', *sorted(sys.modules))\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=os.environ)
    return set(done.stdout.splitlines()[-1].split()[1:])
