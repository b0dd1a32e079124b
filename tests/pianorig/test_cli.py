"""The list of commands, and what each of them imports: nothing heavy before it is needed."""

from __future__ import annotations

import inspect
import os
import shutil
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import pytest

import pianorig
from pianorig import cli, commands
from pianorig.commands import RETIRED_COMMANDS
from pianorig.errors import CommandInputError, InputError
from tests.command_line import modules_after, modules_of_numba, run
from validation.cache.report_cache import StoredReport, inputs_sha256, store_report

HEAVY = {"numpy", "numba", "pandas", "scipy", "matplotlib", "h5py", "cv2", "nidaqmx", "tornado", "bokeh"}
SHIPPED = Path(__file__).parents[2] / "sessions" / "example_forte"


def test_the_list_of_commands_says_what_each_command_says_of_itself() -> None:
    for name in commands.full_names():
        function = commands.load(name)
        assert (inspect.getdoc(function) or "").splitlines()[0] == commands.find(name).help, name


def test_the_list_imports_no_command_and_help_of_a_command_nothing_heavy() -> None:
    loaded = modules_after(("--help",))
    assert not loaded & HEAVY
    assert not [name for name in loaded if name.startswith("pianorig.commands.")]
    loaded = modules_after(*((*name.split(), "--help") for name in commands.full_names()))
    assert not loaded & HEAVY
    assert not [name for name in loaded if name.startswith("pianorig.workflows.")]


@pytest.mark.parametrize("asked", ["", "3"])
def test_matrices_are_multiplied_by_one_thread_unless_asked(asked: str) -> None:
    environment = {name: value for name, value in os.environ.items() if not name.endswith("BLAS_NUM_THREADS")}
    environment |= {"OPENBLAS_NUM_THREADS": asked} if asked else {}
    code = "import os, pianorig; print(os.environ['OPENBLAS_NUM_THREADS'])"
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == (asked or "1")


def test_a_warning_is_shown_once_and_in_the_words_of_the_command(capsys: pytest.CaptureFixture[str]) -> None:
    """A film is opened for its preview, its tracking and its picture, and warns each time."""
    show = cli._make_warning_printer()
    for text in ("film.avi: give the rate\n(`frame_rate_hz`)", "another", "film.avi: give the rate (`frame_rate_hz`)"):
        show(text)
    assert capsys.readouterr().err == "warning: film.avi: give the rate (--frame-rate)\nwarning: another\n"


def test_simulate_imports_only_what_it_needs(short_force: Path, tmp_path: Path) -> None:
    loaded = modules_after(("simulate", "--force", short_force, "--out", tmp_path / "o.csv"))
    assert "numba" in loaded
    assert not loaded & {"pandas", "matplotlib", "cv2", "nidaqmx", "h5py", "model.inside.figure"}
    ours = loaded - modules_of_numba()
    assert not ours & {"scipy.integrate", "scipy.optimize", "scipy.sparse", "scipy.special", "scipy.stats"}


def test_comparison_and_reports_are_made_without_matplotlib() -> None:
    parts = "validation.pipeline.compare_sessions", "validation.report.write", "validation.infer.report"
    code = f"import sys, {', '.join(parts)}; print('pandas' in sys.modules, 'matplotlib' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["True", "False"]


def test_an_unchanged_validate_only_compares_hashes(tmp_path: Path) -> None:
    session = tmp_path / "session"
    shutil.copytree(SHIPPED, session, ignore=shutil.ignore_patterns("*.mraw", "derived"))
    files = {name: session / name for name in ("report.html", "results.json")}
    for path in files.values():
        path.write_text("made before")
    options = {"set": [], "tolerance": 1e-5, "by_motion": False, "condition": None}
    report = StoredReport(["fine"], ["verdict: fine"], files, "2026-01-01")
    store_report(session, inputs_sha256([session], ["hirschkorn2004"], options), report)
    assert not modules_after(("validate", session)) & HEAVY


def test_the_package_runs_as_a_module_and_knows_its_version() -> None:
    done = subprocess.run([sys.executable, "-m", "pianorig", "--help"], capture_output=True, text=True, check=True)
    assert "Commands:" in done.stdout
    assert pianorig.__version__ == metadata.version("piano-action-rig")
    assert InputError is CommandInputError
    with pytest.raises(AttributeError, match="'pianorig' has no attribute 'nothing'"):
        pianorig.nothing  # noqa: B018


def test_a_retired_command_says_what_takes_its_place(capsys: pytest.CaptureFixture[str]) -> None:
    for name, successor in RETIRED_COMMANDS.items():
        assert run(*name.split(), "anything") == 2
        said = capsys.readouterr().err.strip()
        assert successor in said and len(said.splitlines()) == 1
        assert name not in commands.full_names()
