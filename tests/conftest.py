"""Fixtures shared by the tests of all packages."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.command_line import run

ROOT = Path(__file__).parents[1]
WHOLE_SUITE = 1000
"""Number of tests from which compiling ahead is worthwhile."""


def pytest_collection_finish(session: pytest.Session) -> None:
    """Compile kernels used by later tests in a second process."""
    if len(session.items) >= WHOLE_SUITE and not session.config.option.collectonly:
        quiet = subprocess.DEVNULL
        ahead = subprocess.Popen([sys.executable, "-m", "tests.compile_ahead"], cwd=ROOT, stdout=quiet, stderr=quiet)
        session.config.add_cleanup(lambda: (ahead.kill(), ahead.wait()))


def contents(folder: Path) -> dict[Path, bytes]:
    return {path: path.read_bytes() if path.is_file() else b"" for path in folder.rglob("*")}


@pytest.fixture
def refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[..., None]:
    """Check that a command in the test's folder exits with 2, gives the reason in one line and changes no file."""

    def check(words: str, *arguments: str | Path) -> None:
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr("pianorig.console.progress.PATIENCE_S", 600.0)  # on a slow machine it says what takes long
        before = contents(tmp_path)
        capsys.readouterr()
        assert run(*arguments) == 2
        error = capsys.readouterr().err
        assert words in error
        assert error.endswith("\n") and len(error.splitlines()) == 1
        assert contents(tmp_path) == before

    return check
