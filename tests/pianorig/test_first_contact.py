"""What a newcomer meets first: version, help, completion, old spellings, errors for programs, shadowed names."""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
import webbrowser
from collections.abc import Callable
from importlib import metadata
from pathlib import Path

import pytest

import model
from model.inside.labels import BODY_COLORS
from pianorig import commands
from pianorig.console import progress, terminal
from tests.command_line import run
from vision.output.colours import BODY_COLOURS

SHIPPED = Path(__file__).parents[2] / "sessions" / "example_forte"


def test_version_and_short_help(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("--version") == 0
    assert capsys.readouterr().out.split() == ["pianorig", metadata.version("piano-action-rig")]
    assert run("-h") == 0
    short = capsys.readouterr().out
    assert run("--help") == 0 and capsys.readouterr().out == short
    assert run() == 0 and capsys.readouterr().out == short
    assert run("info", "-h") == 0


def test_help_lists_each_command_once_under_its_group(capsys: pytest.CaptureFixture[str]) -> None:
    run("--help")
    text = capsys.readouterr().out
    places = [text.index(f"\n{title}:") for title in commands.GROUPS]
    assert places == sorted(places)
    assert sorted(name for names in commands.groups().values() for name in names) == sorted(commands.COMMANDS)
    assert text.index("\n  track ") > text.index("\nFilms:") > text.index("\n  record ")


def test_arguments_are_capitals_and_examples_are_not_wrapped(capsys: pytest.CaptureFixture[str]) -> None:
    for name, usage in (
        ("annotate", "SESSION"),
        ("validate", "SESSION..."),
        ("open", "[SESSION]"),
        ("examples", "DIR"),
    ):
        run(name, "--help")
        text = capsys.readouterr().out
        assert f"Usage: pianorig {name} [OPTIONS] {usage}\n" in text
    for name in commands.full_names():
        run(*name.split(), "--help")
        lines = capsys.readouterr().out.splitlines()
        assert not [line for line in lines if "{" in line and "Usage" in line], name
        documented = [line.strip() for line in (commands.load(name).__doc__ or "").splitlines() if "Example:" in line]
        assert documented and set(documented) <= {line.strip() for line in lines}, name
        assert any("--json" in line for line in lines), name


@pytest.mark.parametrize(
    ("line", "wanted"),
    [
        ("pianorig si", {"simulate"}),
        ("pianorig record --rig p", {"pcie6363"}),
        ("pianorig simulate --scene key", {"key", "key-whippen"}),
        ("pianorig touch hirsch", {"hirschkorn2004", "hirschkorn2004-regulated"}),
    ],
)
def test_completion_knows_commands_and_built_in_names(
    line: str, wanted: set[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    place = str(len(line.split()) - 1)
    for name, value in {"_PIANORIG_COMPLETE": "complete_bash", "COMP_WORDS": line, "COMP_CWORD": place}.items():
        monkeypatch.setenv(name, value)
    run()
    assert set(capsys.readouterr().out.split()) == wanted


@pytest.mark.parametrize(
    ("words", "hint"),
    [
        (("record", "--profile", "fortee"), "did you mean forte?"),
        (("record", "--rig", "pcie6366"), "did you mean pcie6363?"),
        (("touch", "hirschkorn204"), "did you mean hirschkorn2004?"),
        (("simulate", "--force", "x.csv", "--out", "o.csv", "--scene", "lifting_key"), "did you mean lifting-key?"),
        (("valdate", "x"), "Did you mean 'validate'?"),
        (("record", "--profil", "forte"), "--profile"),
    ],
)
def test_misspelt_names_get_a_suggestion_in_one_line(words: tuple[str, ...], hint: str, refused: Callable) -> None:
    refused(hint, *words)


def test_errors_are_json_under_json(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    for words in (("info", "gone"), ("simulate",), ("simulate", "--no-such"), ("no-such-command",)):
        assert run(*words, "--json") == 2
        seen = capsys.readouterr()
        error = json.loads(seen.out)["error"]
        assert error["kind"] == "bad input" and error["exit_code"] == 2
        assert seen.err == f"pianorig: {error['message']}\n"
    assert run("selftest", "--backend", "ni://local", "--json") == 3
    assert json.loads(capsys.readouterr().out)["error"]["kind"] == "hardware or safety"
    assert run("info", "gone") == 2
    assert capsys.readouterr().out == ""


def test_a_body_has_one_colour_in_all_pictures() -> None:
    assert {body: BODY_COLORS[body] for body in model.BODIES} == BODY_COLOURS
    assert len(set(BODY_COLOURS.values())) == len(model.BODIES)


def test_old_spellings_are_understood_and_not_listed(
    short_force: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], undrawn: None
) -> None:
    drawn = tmp_path / "sheet.svg"
    assert run("simulate", "--force", short_force, "--figures", drawn, "--out", tmp_path / "o.csv") == 0
    assert drawn.is_file()
    assert run("watch", SHIPPED, "--once", "--png", tmp_path / "w.png") == 0
    assert (tmp_path / "w.png").is_file()
    capsys.readouterr()
    for name, old in (("simulate", "--figures"), ("track", "--plot"), ("watch", "--png")):
        run(name, "--help")
        assert old not in capsys.readouterr().out


def test_open_finds_a_report_and_says_how_to_make_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], refused: Callable
) -> None:
    asked: list[str] = []
    monkeypatch.setattr(webbrowser, "open", lambda address: bool(asked.append(address)) or len(asked) < 2)
    report = tmp_path / "sessions" / "one" / "report.html"
    report.parent.mkdir(parents=True)
    refused("pianorig validate", "open", report.parent)
    refused("no such folder", "open", tmp_path / "gone")
    monkeypatch.chdir(tmp_path)
    refused("no report below it", "open")
    report.write_text("seen")
    assert run("open") == 0 and asked == [report.as_uri()]
    assert capsys.readouterr().out == f"report: {report}\n"
    assert run("open", report, "--json") == 0
    assert json.loads(capsys.readouterr().out) == {"report": str(report), "opened": False}
    assert run("open", "sessions/one", "--no-show") == 0 and len(asked) == 2


def test_another_package_of_our_name_is_named_at_start_up(tmp_path: Path) -> None:
    line = [sys.executable, "-m", "pianorig", "info"]
    (tmp_path / "model.py").write_text("raise SystemExit('never imported')")
    done = subprocess.run(line, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 2 and done.stderr.count("\n") == 1
    assert done.stderr.startswith(f"pianorig: package model: Python finds {tmp_path / 'model.py'}, not ")
    (tmp_path / "model.py").unlink()
    (tmp_path / "rig").mkdir()
    assert subprocess.run(line, cwd=tmp_path, capture_output=True).returncode == 0  # a mere folder shadows nothing
    (tmp_path / "rig" / "__init__.py").touch()
    done = subprocess.run(line, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 2 and "package rig" in done.stderr


KERNELS = """
from pianorig.console.progress import tell_when_compiling

tell_when_compiling()
import numba

@numba.njit(cache=CACHED)
def inner(x):
    return x + 1.0

@numba.njit(cache=CACHED)
def outer(x):
    return 2.0 * inner(x)

print(outer(1.0))
"""


def test_compiling_is_said_once_and_not_when_kernels_are_found(tmp_path: Path) -> None:
    def said(cached: bool) -> list[str]:
        script = tmp_path / f"kernels_{cached}.py"
        if not script.exists():  # a newer file would not find its kernels
            script.write_text(KERNELS.replace("CACHED", str(cached)))
        environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
        done = subprocess.run([sys.executable, script], env=environment, capture_output=True, text=True, check=True)
        assert done.stdout.split() == ["4.0"]
        return done.stderr.splitlines()

    assert said(cached=True) == ["compiling kernels (once, up to half a minute) ..."]
    assert said(cached=True) == []
    (line_of_every_call,) = said(cached=False)
    assert "at every call" in line_of_every_call and "PIANORIG_CACHE_DIR" in line_of_every_call


def test_what_an_encoding_lacks_is_spelt(monkeypatch: pytest.MonkeyPatch) -> None:
    for encoding, wanted in (("ascii", "0.1 deg x 2 ... ?"), ("cp1252", "0.1° × 2 … ?"), ("utf-8", "0.1° × 2 … ⠿")):
        stream = io.TextIOWrapper(io.BytesIO(), encoding=encoding, newline="\n")
        monkeypatch.setattr(sys, "stdout", stream)
        terminal.write_what_the_terminal_can()
        assert terminal.can_print("⠿") == (encoding == "utf-8")
        print("0.1° × 2 … ⠿", end="", flush=True)
        assert stream.buffer.getvalue().decode(encoding) == wanted  # type: ignore[attr-defined]


def test_watch_draws_as_wide_as_the_terminal_with_the_signs_it_has(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for columns in (40, 120):
        monkeypatch.setenv("COLUMNS", str(columns))
        assert run("watch", SHIPPED, "--once") == 0
        lines = capsys.readouterr().out.splitlines()
        assert max(map(len, lines)) == columns - 1
    done = subprocess.run(
        [sys.executable, "-m", "pianorig", "watch", str(SHIPPED), "--once"],
        capture_output=True, env={**os.environ, "PYTHONIOENCODING": "cp1252"}, check=True,
    )  # fmt: skip
    assert b"?" not in done.stdout and done.stdout.count(b":") > 10


def test_a_bar_fits_whatever_the_width() -> None:
    for columns in range(10, 200):
        text = progress.bar_text("tracking", 120, 346, 12.0, columns)
        assert len(text) <= max(columns, len("tracking 120/346"))
    assert progress.bar_text("tracking", 120, 346, 12.0, 80).endswith("0:23 left")
    assert "left" not in progress.bar_text("tracking", 346, 346, 12.0, 80)
    assert progress.bar_text("filming", 0, 0, 0.0, 80).startswith("filming 0/0")
