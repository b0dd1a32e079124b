"""``--figure``: a picture of what was recorded, measured or found, in any of three formats."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.command_line import run

SESSION = Path(__file__).parents[3] / "sessions" / "example_forte"
KEY_BGR, HAMMER_BGR = (0x46, 0x6D, 0x8C), (0x8A, 0x52, 0xA8)


def has_colour(picture: np.ndarray, bgr: tuple[int, int, int]) -> bool:
    """Whether some pixels have nearly this colour."""
    return int((np.abs(picture.astype(int) - bgr).max(axis=2) < 40).sum()) > 50


def test_a_session_is_drawn_in_the_colours_of_its_bodies(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    figure = tmp_path / "session.png"
    assert run("info", SESSION, "--figure", figure, "--json") == 0
    assert json.loads(capsys.readouterr().out)["figure"] == str(figure)
    picture = cv2.imread(str(figure))
    assert has_colour(picture, KEY_BGR) and has_colour(picture, HAMMER_BGR)


def test_targets_of_a_regulation_are_drawn_by_name(tmp_path: Path) -> None:
    figure = tmp_path / "targets.svg"
    assert run("regulate", "hirschkorn2004", "--figure", figure) == 0
    assert "let-off (1.00 mm)" in figure.read_text(encoding="utf-8")


def test_a_blow_is_drawn_with_its_angles_and_events(tmp_path: Path) -> None:
    figure = tmp_path / "blow.svg"
    force, out = SESSION / "trial_0001.h5", tmp_path / "out.csv"
    assert run("simulate", "--force", force, "--out", out, "--figure", figure) == 0
    text = figure.read_text(encoding="utf-8")
    assert all(f"<!-- {word} -->" in text for word in ("repetition", "Let-off", "String impact"))


@pytest.mark.parametrize(
    ("words", "arguments"),
    [
        ("ending found '.jpg', allowed .svg", ("info", SESSION, "--figure", "a.jpg")),
        ("--figure: draws a session", ("info", "--figure", "a.png")),
        ("--figure: draws what was recorded; not with --dry-run", ("record", "--dry-run", "--figure", "a.png")),
    ],
)
def test_what_cannot_be_drawn_is_one_line(words: str, arguments: tuple[object, ...], refused) -> None:  # type: ignore[no-untyped-def]
    refused(words, *arguments)
