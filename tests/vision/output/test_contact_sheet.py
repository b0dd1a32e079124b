"""Outlines on frames and contact sheet: drawn where the body is, lost frames first, nothing left after a failure."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.vision.known_films import PIVOT, bar_scene, film_of
from vision import ArrayFilm, Body, InputError, track, write_contact_sheet
from vision.output.colours import LOST, body_colour, to_bgr
from vision.output.contact_sheet import OutlineDrawer, describe_row, select_worst_rows
from vision.synthetic import box


@pytest.fixture(scope="module")
def tracked() -> tuple[object, object]:
    """A bar that turns by 0.2 rad, hidden in frames 30 to 33."""
    pose = np.tile([0.0, *PIVOT], (44, 1))[:, None, :]
    pose[:, 0, 0] = 0.2 * np.clip((np.arange(44) - 14) / 25.0, 0.0, 1.0) ** 2

    def hide(i: int, light: np.ndarray) -> None:
        if 30 <= i < 34:
            light[:] = 15.0

    known = film_of(bar_scene("speckle"), pose, cover=hide)
    return known, track(known.film, known.bodies)


def test_outline_is_drawn_on_the_body(tracked: tuple) -> None:
    known, result = tracked
    picture = OutlineDrawer(known.film, known.bodies, result).picture(42)
    tinted = np.abs(picture.astype(int) - to_bgr(body_colour("bar", 0))).max(axis=2) < 60
    # the true outline at that pose, rasterised apart: most of it carries the colour
    c, s = np.cos(-0.2), np.sin(-0.2)
    outline = box(-30.0, -22.0, 80.0, 22.0) @ np.array([[c, s], [-s, c]]) + (92.0, 96.0)
    line = np.zeros((150, 210), dtype=np.uint8)
    cv2.polylines(line, [np.rint(outline).astype(np.int32)], True, 255, 3)
    assert np.count_nonzero(tinted & (line > 0)) > 0.8 * np.count_nonzero(tinted) > 100
    dark = OutlineDrawer(known.film, known.bodies, result).picture(31)
    assert (np.abs(dark.astype(int) - to_bgr(LOST)).max(axis=2) < 60).sum() > 100


def test_contact_sheet_shows_lost_frames_first(tmp_path: Path, tracked: tuple) -> None:
    known, result = tracked
    path = tmp_path / "worst.png"
    shown = write_contact_sheet(path, known.film, known.bodies, result, count=5, columns=2)
    assert sorted(shown[:4]) == [30, 31, 32, 33] and len(shown) == 5
    sheet = cv2.imread(str(path))
    assert sheet.shape[1] == 2 * 2 * 210 and sheet.shape[0] > 3 * 2 * 150  # enlarged twice, strips of text between
    row = int(np.flatnonzero(result.frame == 30)[0])
    assert describe_row(result, row)[0].startswith("frame 30, ") and describe_row(result, row)[1].startswith(
        "bar lost: "
    )
    assert describe_row(result, 40)[1].startswith(f"bar correlates {result.zncc[40, 0]:.3f}")
    good = select_worst_rows(result.is_lost, result.zncc, 44)[4:]
    correlation = result.zncc[good, 0]
    assert np.all(np.diff(correlation) >= 0)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["worst.png"]


def test_a_notebook_shows_lost_frames_and_uncertainty(tracked: tuple) -> None:
    _, result = tracked
    view = result._repr_html_()
    assert view.count("<table") == 1
    for words in ("<td>bar</td>", "<td>44</td>", "<td>4</td>", "median u, mdeg"):
        assert words in view


def test_refusals(tmp_path: Path, tracked: tuple) -> None:
    known, result = tracked
    with pytest.raises(InputError, match="outlines of other"):
        write_contact_sheet(tmp_path / "a.png", known.film, [Body("other", known.bodies[0].polygon_px)], result)
    with pytest.raises(InputError, match="has 5 frames"):
        write_contact_sheet(tmp_path / "a.png", ArrayFilm(known.frames[:5]), known.bodies, result)
    with pytest.raises(InputError, match="cannot be written"):
        write_contact_sheet(tmp_path / "absent" / "a.png", known.film, known.bodies, result)
    assert list(tmp_path.iterdir()) == []
