"""``pianorig bench`` as a user meets it: where it is, what it refuses, how it ends, how a report is begun from it."""

from __future__ import annotations

import json
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from tests.pianorig.page.conftest import EXAMPLE, Page


@contextmanager
def bench(*words: str | Path) -> Iterator[tuple[subprocess.Popen[str], dict[str, Any]]]:
    """The command in a process of its own, and what it says at first."""
    pytest.importorskip("bokeh", reason="the page needs the extra 'bench'")
    line = [sys.executable, "-m", "pianorig", "bench", *map(str, words), "--no-show", "--json"]
    process = subprocess.Popen(line, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        yield process, json.loads(process.stdout.readline())
    finally:
        process.kill()
        process.communicate()


@pytest.mark.skipif(sys.platform == "win32", reason="Ctrl-C is sent as a signal")
def test_it_says_where_it_is_makes_a_report_and_ends_with_ctrl_c(tmp_path: Path) -> None:
    shutil.copytree(EXAMPLE, tmp_path / "s" / "mine", ignore=shutil.ignore_patterns("trial*", "derived"))
    with bench(tmp_path / "s", "--control") as (process, said):
        page = Page(said["address"], int(said["address"].rstrip("/").rpartition(":")[2]))
        assert said["control"]
        refused = page.ask("/api/sessions/mine/validate", "POST", {})
        assert refused.status == 400 and "no trials" in refused.json["error"]
        process.send_signal(signal.SIGINT)
        out, error = process.communicate(timeout=300)  # hangs, not slow
        assert (process.returncode, out, error) == (0, "", "")


def test_a_job_tells_its_lines_and_its_failure() -> None:
    from pianorig.page.jobs import Jobs

    jobs = Jobs()
    number = jobs.begin("a session", ["info", "/nowhere"])["job"]
    deadline = time.monotonic() + 60
    while jobs.state(number)["running"] and time.monotonic() < deadline:  # type: ignore[index]
        time.sleep(0.02)  # a process of its own has no clock to inject
    state = jobs.state(number)
    assert state is not None and state["failed"] and "/nowhere" in state["lines"][-1]
    assert jobs.state(number + 1) is None
    jobs.close()


def test_what_cannot_be_shown_is_refused(refused: Callable[..., None], tmp_path: Path) -> None:
    pytest.importorskip("bokeh", reason="the page needs the extra 'bench'")
    refused("no such folder", "bench", "nowhere", "--no-show")
    (tmp_path / "one").mkdir()
    (tmp_path / "one" / "session.toml").write_text("")
    refused("name the folder above it", "bench", "one", "--no-show")
    import socket

    with socket.socket() as busy:
        busy.bind(("127.0.0.1", 0))
        busy.listen()
        refused("in use", "bench", ".", "--no-show", "--port", str(busy.getsockname()[1]))


def test_without_the_extra_it_says_what_to_install(
    refused: Callable[..., None], monkeypatch: pytest.MonkeyPatch
) -> None:
    from pianorig import page

    def missing(name: str) -> Any:
        raise ModuleNotFoundError("No module named 'tornado'", name="tornado")

    with monkeypatch.context() as without:
        for name in ("serve_until_interrupted", "BenchOptions"):
            without.delitem(vars(page), name, raising=False)
        without.setattr(page, "__getattr__", missing)
        refused("piano-action-rig[bench]", "bench", ".", "--no-show")
    pytest.importorskip("tornado", reason="the page needs the extra 'bench'")
    from pianorig.page import answers as shell  # tornado is there, Bokeh is not

    monkeypatch.setattr(shell, "find_spec", lambda name: None)
    refused("needs the package bokeh", "bench", ".", "--no-show")
