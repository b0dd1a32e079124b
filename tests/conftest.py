"""Fixtures shared by the tests of all packages."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.command_line import run

PROCESSES = 2
"""Processes of a run of the whole suite; files given by name run in one."""


@pytest.hookimpl(tryfirst=True)
def pytest_cmdline_main(config: pytest.Config) -> None:
    """Share the files of the whole suite out to two processes, unless its options ask for something else."""
    option = config.option
    if not config.pluginmanager.hasplugin("xdist") or hasattr(config, "workerinput"):
        return  # not installed, or one of the two
    named = config.args_source is pytest.Config.ArgsSource.ARGS
    watched = option.collectonly or option.usepdb or option.capture == "no"
    if not named and not watched and option.numprocesses is None and option.dist == "no":
        option.numprocesses, option.dist = min(PROCESSES, os.cpu_count() or 1), "loadfile"


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
