"""An exported animation: complete in one file, starts at the motion, no peak lost, played by the page's own player."""

from __future__ import annotations

import base64
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import model
from pianorig.page.action import blow_curves
from pianorig.player.animation import (
    Animation,
    animation_html,
    scripts,
    write_blow_animation,
)
from pianorig.player.moving_action import pack


@pytest.fixture(scope="module")
def blow() -> tuple[model.Action, model.Solution, np.ndarray]:
    action, (time, force) = model.load_action(), model.force_table("forte")
    rows = model.output_times(0.0, 0.2, 10_000.0)
    solution = model.simulate(action, time, force, output_time_s=rows, inside=True)
    return action, solution, np.interp(rows, time, force)


@pytest.fixture(scope="module")
def page(blow: tuple[model.Action, model.Solution, np.ndarray], tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("animation") / "blow.html"
    write_blow_animation(*blow, path)
    return path.read_text(encoding="utf-8")


def data_of(text: str) -> dict[str, Any]:
    found = re.search(r'<script type="application/json" id="data">(.*?)</script>', text, flags=re.DOTALL)
    assert found is not None
    return dict(json.loads(found.group(1)))


def numbers(packed: dict[str, Any]) -> np.ndarray:
    return np.frombuffer(base64.b64decode(packed["f32"]), "<f4").reshape(packed["shape"])


def test_the_file_needs_nothing_else(page: str) -> None:
    assert not re.search(r"https?://", page) and not re.search(r"<(script|link|img)[^>]*(src|href)=", page)
    assert "import " not in re.sub(r"//.*", "", page.split('<script type="module">')[1])
    assert len(scripts()) == 7
    for text in scripts().values():  # each function and class of the page's own scripts is in it
        for given in re.findall(r"^export (?:function|class) (\w+)", text, re.MULTILINE):
            assert re.search(rf"(function|class) {given}\b", page), given


def test_it_starts_where_the_motion_does_and_shows_the_pages_numbers(
    page: str, blow: tuple[model.Action, model.Solution, np.ndarray]
) -> None:
    data, solution = data_of(page), blow[1]
    moved = np.abs(solution.angle_rad - solution.angle_rad[0]).max(axis=1) > 2e-4
    first = solution.time_s[np.argmax(moved)]
    assert first - 0.01 < data["start_s"] < first
    by_title = {curve["title"]: curve for curve in data["curves"]}
    assert list(by_title)[1:] == ["key", "whippen", "jack", "repetition lever", "hammer"]
    times = numbers(by_title["hammer"]["time_s"])
    live = np.frombuffer(base64.b64decode(blow_curves("hirschkorn2004", [], "forte")["values"][4]["f32"]), "<f4")
    wanted = np.interp(times, np.arange(live.size) * 2 / 5000.0, live)
    np.testing.assert_allclose(numbers(by_title["hammer"]["value"]), wanted, atol=0.05)
    labels = data["drawings"][0]["drawing"]["labels"]
    assert "back check" in " ".join(labels) and len(labels) == 13


def test_no_short_peak_is_lost_between_two_rows(
    page: str, blow: tuple[model.Action, model.Solution, np.ndarray]
) -> None:
    inside = blow[1].inside
    assert inside is not None
    shown = numbers(data_of(page)["drawings"][0]["drawing"]["normal_n"])
    np.testing.assert_allclose(shown.max(axis=0), inside.normal_n.max(axis=0), rtol=1e-6)
    assert shown.shape[0] < inside.normal_n.shape[0] / 4


def test_a_hostile_title_stays_text() -> None:
    shown = Animation(
        "</script><script>alert(1)</script>",
        [("<b>", {"time_s": pack([0.0, 1.0]), "pose": pack(np.zeros((2, 1, 3)))})],
        [],
        [],
    )
    text = animation_html(shown)
    assert (
        text.count("<script") == 2
        and "alert(1)</script>" not in text
        and data_of(text)["drawings"][0]["title"] == "<b>"
    )


def test_a_blow_without_an_inside_view_is_refused(tmp_path: Path) -> None:
    blind = model.simulate(model.load_action(), [0.0, 0.01], [0.0, 0.0])
    with pytest.raises(model.InputError, match="inside=True"):
        write_blow_animation(model.load_action(), blind, np.zeros(2), tmp_path / "a.html")
    assert not list(tmp_path.iterdir())
