"""Messages name the caller's world: a package its arguments, the command line its options, a TypeError the function."""

from __future__ import annotations

import ast
import re
from functools import cache
from pathlib import Path

import pytest
from typer.main import get_command

import model
import rig
import validation
import vision
from pianorig import commands
from pianorig.cli import app
from pianorig.console.output import ARGUMENT, name_options

ROOT = Path(__file__).parents[1]
OPTION_LIKE = re.compile(r"(?<![\w-])--[a-z][a-z-]+")
A_COMMAND = re.compile(r"pianorig [a-z]")
KEPT = {"--yes"}  # how the operator confirmed, as sessions hold it


@cache
def texts() -> dict[str, list[str]]:
    """Strings of the four packages that are no docstrings, by file; the parts of an f-string as one."""
    found: dict[str, list[str]] = {}
    for package in ("model", "vision", "rig", "validation"):
        for path in (ROOT / package).rglob("*.py"):
            nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
            inside = {id(part) for node in nodes if isinstance(node, ast.JoinedStr) for part in ast.walk(node)}
            left_out = inside | {id(node.value) for node in nodes if isinstance(node, ast.Expr)}
            for node in nodes:
                parts = node.values if isinstance(node, ast.JoinedStr) else [node] if id(node) not in left_out else []
                said = [p.value for p in parts if isinstance(p, ast.Constant) and isinstance(p.value, str)]
                found.setdefault(str(path.relative_to(ROOT)), []).append("…".join(said))
    return found


def options() -> set[str]:
    """Every option of every command."""
    group = get_command(app)
    found: set[str] = set()
    for name in commands.full_names():
        command, context = group, None
        for word in name.split():
            command = command.get_command(context, word)
        found |= {option for one in command.params for option in one.opts}
    return found


def test_a_package_names_no_option_but_in_a_whole_command() -> None:
    wrong = [
        (file, text)
        for file, said in texts().items()
        for text in said
        if OPTION_LIKE.search(text) and not A_COMMAND.search(text) and text not in KEPT
    ]
    assert not wrong, wrong


def test_every_argument_that_a_message_names_is_an_option_of_a_command() -> None:
    named = {found for said in texts().values() for text in said for found in ARGUMENT.findall(text)}
    assert {"frame_rate_hz", "tolerance", "overrides", "priors"} <= named
    unknown = {name for name in named if name_options(f"`{name}`") not in options()}
    assert unknown <= {"frame_time_s"}, unknown  # times of an array: no command takes them


def test_the_command_line_names_options() -> None:
    assert (
        name_options("give `n_still` 3, or `frame_rate_hz`: `overrides` a.b")
        == "give --n-still 3, or --frame-rate: --set a.b"
    )
    assert name_options("a `Film`, `x.y`") == "a `Film`, `x.y`"


@pytest.mark.parametrize(
    ("call", "name", "wrong"),
    [
        (lambda **k: model.simulate("hirschkorn2004", [0.0, 1.0], [0.0, 0.0], **k), "model.simulate", "tolerances"),
        (lambda **k: model.simulate_motion("hirschkorn2004", [0.0], [0.0], **k), "model.simulate_motion", "seeds"),
        (lambda **k: model.simulate_many("hirschkorn2004", {}, **k), "model.simulate_many", "lane"),
        (lambda **k: vision.track("film.mraw", [], **k), "vision.track", "frame_rate"),
        (lambda **k: vision.preview("film.mraw", [], **k), "vision.preview", "still"),
        (lambda **k: vision.retrack_frames("film.mraw", [], [], [], **k), "vision.retrack_frames", "rows_per_ms"),
        (lambda **k: rig.record("out", **k), "rig.record", "trails"),
        (lambda **k: rig.correct_force([0.0], [0.0], None, **k), "rig.correct_force", "preload"),
        (lambda **k: validation.compare("session", **k), "validation.compare", "tolerances"),
        (lambda **k: rig.record_passive("out", **k), "rig.record_passive", "operators"),
        (lambda **k: validation.identify([], [], **k), "validation.identify", "prior"),
    ],
)
def test_a_keyword_that_a_function_has_not_is_refused_in_its_name(call, name: str, wrong: str) -> None:
    said = rf"^{re.escape(name)}\(\) got an unexpected keyword argument '{wrong}'; did you mean"
    with pytest.raises(TypeError, match=said):
        call(**{wrong: 1})
