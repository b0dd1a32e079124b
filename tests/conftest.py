"""Fixtures shared by the tests of all packages."""

from __future__ import annotations

import os

# before NumPy is loaded: with more threads than free processors, those of OpenBLAS spin while they wait for each other
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import gc
import hashlib
import pickle
import re
import shutil
import signal
import stat
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import configuration, settings

import model
from model.kernels.lanes import LANES, has_wide_vectors
from model.kernels.process_lock import hold_lock
from tests.command_line import run

PROCESSES = 2
"""Processes of a run of the whole suite; files given by name run in one."""


@pytest.hookimpl(tryfirst=True)
def pytest_cmdline_main(config: pytest.Config) -> None:
    """Share the whole suite out to two processes, unless its options ask for something else.

    Each takes half of it, and whoever is done first takes half of what the other has left: both end together.
    """
    option = config.option
    if not config.pluginmanager.hasplugin("xdist") or hasattr(config, "workerinput"):
        return  # not installed, or one of the two
    named = config.args_source is pytest.Config.ArgsSource.ARGS
    watched = option.collectonly or option.usepdb or option.capture == "no"
    if not named and not watched and option.numprocesses is None and option.dist == "no":
        option.numprocesses, option.dist = min(PROCESSES, os.cpu_count() or 1), "worksteal"


def _copies_can_be_written() -> None:
    """What tests copy from a checkout that only others may write is theirs to change."""

    def writable(given: Callable[..., None]) -> Callable[..., None]:
        def copied(source: Any, target: Any, **options: Any) -> None:
            given(source, target, **options)
            os.chmod(target, os.stat(target).st_mode | stat.S_IWUSR)

        return copied

    shutil.copystat, shutil.copymode = writable(shutil.copystat), writable(shutil.copymode)


def _name_only_what_opencv_knows() -> None:
    """A name that its build does not know disables nothing, and is told by OpenCV in all that commands print."""
    told = subprocess.run([sys.executable, "-c", "import cv2"], capture_output=True, text=True).stderr
    unknown = re.findall(r"unknown CPU feature: '([^']+)'", told)
    names = os.environ["OPENCV_CPU_DISABLE"].split(",")
    os.environ["OPENCV_CPU_DISABLE"] = ",".join(name for name in names if name not in unknown)


def pytest_configure(config: pytest.Config) -> None:
    """Let what the machine, its shell and its user have set change no result; Hypothesis measures no time."""
    settings.register_profile("suite", deadline=None, database=None, print_blob=True)
    settings.load_profile("suite")
    own = tempfile.TemporaryDirectory(prefix="hypothesis-")
    configuration.set_hypothesis_home_dir(own.name)
    config.add_cleanup(own.cleanup)
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        # in the background of a shell Ctrl-C is ignored, also by what the tests start and stop by it
        signal.signal(signal.SIGINT, signal.default_int_handler)
    if not os.access(__file__, os.W_OK):
        _copies_can_be_written()
    if "OPENCV_CPU_DISABLE" in os.environ and not hasattr(config, "workerinput"):
        _name_only_what_opencv_knows()


@pytest.hookimpl(tryfirst=True)
def pytest_collection() -> None:
    """What is imported and collected stays to the end: no search for garbage goes through it again and again."""
    gc.disable()


def pytest_collection_finish() -> None:
    """Leave what was collected out of later searches."""
    gc.freeze()
    gc.enable()


def pytest_sessionstart(session: pytest.Session) -> None:
    """Of two processes of a run, let one compile the step loops, the other the printed action: nobody waits.

    Nearly every file needs them, and both would begin with the same.
    """
    worker = getattr(session.config, "workerinput", {}).get("workerid")
    if worker == "gw0":
        from model.integrators.lanes import compile_lane_loop  # its import compiles the loop of one run

        if has_wide_vectors():
            compile_lane_loop(LANES)
    elif worker == "gw1":
        from model import build_scene
        from model.codegen.load import load_kernels, load_lane_kernels

        tables = build_scene(model.load_action(), model.SceneChoice()).tables
        load_kernels(tables)
        if has_wide_vectors():
            load_lane_kernels(tables, LANES)


@pytest.fixture(scope="session")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Any]:
    """Make something costly once in a run, in whichever of its processes asks first; the others read a copy.

    ``shared(make, *arguments)`` is ``make(folder, *arguments)``, with an empty folder for the files it may write. It
    goes by the place of the function in the source and the text of the arguments; a second process that asks
    meanwhile waits. Nothing outlives the run, so no older code can have made it.
    """
    own = tmp_path_factory.getbasetemp()
    root = own.parent if os.environ.get("PYTEST_XDIST_WORKER") else own

    def get(make: Callable[..., Any], *arguments: object) -> Any:
        code = make.__code__
        said = f"{code.co_filename}:{code.co_firstlineno}{arguments!r}"
        name = "shared-" + hashlib.sha256(said.encode()).hexdigest()[:16]
        file = root / f"{name}.pickle"
        with hold_lock(root, name):
            if file.is_file():
                return pickle.loads(file.read_bytes())
            folder = Path(tempfile.mkdtemp(prefix=f"{name}-", dir=root))
            value = make(folder, *arguments)
            part = folder.with_suffix(".part")
            part.write_bytes(pickle.dumps(value))
            os.replace(part, file)
            return value

    return get


def leave_out_figures(patch: pytest.MonkeyPatch) -> None:
    """Pages without their figures, which cost most of a page."""
    patch.setattr("validation.report.page.all_figures", lambda view: {"repeatability": [], "comparison": []})


@pytest.fixture
def without_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    leave_out_figures(monkeypatch)


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


@pytest.fixture(scope="session")  # one for all tests of a process: Playwright's event loop cannot be started twice
def browser() -> Iterator[Any]:
    """Chromium, driven by Playwright; skipped where either is missing."""
    names = ("chromium", "chromium-browser", "google-chrome")
    chromium = next((path for name in names if (path := shutil.which(name))), None)
    if chromium is None:
        pytest.skip("no Chromium found: install chromium to look at pages in a browser")
    api = pytest.importorskip("playwright.sync_api", reason="playwright drives the browser")
    with api.sync_playwright() as driver:
        opened = driver.chromium.launch(
            executable_path=chromium,
            args=["--no-sandbox", "--disable-gpu", "--disable-quic", "--disable-background-networking"],
        )
        yield opened
        opened.close()
