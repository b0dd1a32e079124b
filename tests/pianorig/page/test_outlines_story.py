"""A new user gets from a foreign film to the angles of three bodies: at most 60 clicks and keys, then a frame again."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import model
import vision
from rig.simulated import ActionGeometry, CameraSettings, film_bodies, film_trial
from tests.pianorig.page.conftest import Page, serve
from tests.pianorig.page.stories import opened, until

FILMED = ("whippen", "jack", "repetition")
CAMERA = CameraSettings(width=280, height=212, scale_px_per_m=2240.0)
START_S = 0.045  # the force begins at 0.05 s


class User:
    """Clicks and keys, counted."""

    def __init__(self, tab: Any) -> None:
        self.tab, self.actions = tab, 0

    def click(self, target: Any, **more: Any) -> None:
        self.actions += 1
        target.click(**more)

    def type(self, text: str) -> None:
        self.actions += len(text)
        self.tab.keyboard.type(text)

    def press(self, key: str) -> None:
        self.actions += 1
        self.tab.keyboard.press(key)


def film_of(blow: model.Solution, path: Path) -> list[vision.Body]:
    """Film whippen, jack and repetition lever of a blow; the outlines they were drawn with."""
    action = model.load_action()
    whippen, jack, repetition = ((action[f"{name}.pivot.x"], action[f"{name}.pivot.y"]) for name in FILMED)
    columns = [model.BODIES.index(name) for name in FILMED]  # jack and lever from the whippen, as the camera wants them

    def angles_at(time_s: np.ndarray) -> np.ndarray:
        return np.stack([np.interp(time_s, blow.time_s, blow.angle_rad[:, i]) for i in columns], axis=1)

    rest = tuple(float(angle) for angle in blow.angle_rad[0, columns])
    geometry = ActionGeometry(whippen, jack, repetition, (rest[0], rest[1], rest[2]))
    film_trial(path, START_S + (np.arange(60) + 0.5) / CAMERA.frame_rate_hz, angles_at, geometry, CAMERA, seed=1)
    return list(film_bodies(geometry, CAMERA))


def draw(user: User, points: np.ndarray) -> None:
    """Click the corners of an outline; those outside the picture at its edge."""
    canvas = user.tab.locator(".film canvas")
    box = canvas.bounding_box()
    for x, y in points.clip((-0.4, -0.4), (CAMERA.width - 0.6, CAMERA.height - 0.6)):
        at = {"x": (x + 0.5) / CAMERA.width * box["width"], "y": (y + 0.5) / CAMERA.height * box["height"]}
        user.click(canvas, position=at)


def test_from_a_foreign_film_to_three_angles(browser: Any, tmp_path: Path) -> None:
    times = np.linspace(0.0, 0.2, 1001)
    force = np.interp(times, *model.force_table("forte"))
    blow = model.simulate(model.load_action(), times, force)
    truth = film_of(blow, tmp_path / "foreign.mraw")
    for page in serve(tmp_path, control=True):
        with opened(browser, page, page.address) as tab:
            user = User(tab)
            user.click(tab.get_by_role("link", name="Outlines"))
            tab.locator("main[data-ready]").wait_for()
            until(tab, "document.querySelector('.film canvas').dataset.frame === '0'")
            for body in truth:
                user.click(tab.get_by_role("button", name="New body"))
                draw(user, body.polygon_px)
                user.click(tab.get_by_role("button", name=body.name, exact=True))
            for body in truth:
                if body.layer:
                    tab.get_by_label(f"Layer of {body.name}").focus()
                    user.press("Control+A")
                    user.type(str(body.layer))
                    user.press("Tab")
            user.click(tab.get_by_role("button", name="Track", exact=True))
            tab.locator(".worst button").first.wait_for(timeout=120_000)
            print(f"{user.actions} clicks and keys")
            assert user.actions <= 60
            table = pd.read_csv(tmp_path / "foreign.angles.csv")
            saved = {body.name: body for body in vision.load_bodies(tmp_path / "foreign.bodies.toml")}
            assert saved["jack"].parent == "whippen" and saved["repetition"].parent == "whippen"
            assert {name: one.layer for name, one in saved.items()} == {one.name: one.layer for one in truth}
            check_angles(table, blow)
            again(tab, tmp_path)


def check_angles(table: pd.DataFrame, blow: model.Solution) -> None:
    """The angles are those that the film was made with."""
    for name in FILMED:
        turned = np.interp(
            START_S + (table["frame"] + 0.5) / CAMERA.frame_rate_hz,
            blow.time_s,
            blow.angle_rad[:, model.BODIES.index(name)],
        )
        found = table["whippen_rad" if name == "whippen" else f"{name}_relative_rad"]
        known = np.isfinite(found)
        assert known.mean() > 0.95
        missed = (found - turned)[known]
        assert np.std(missed) < 5e-4, (name, np.std(missed))


def again(tab: Any, folder: Path) -> None:
    """A frame looked at, an outline dragged away and back by hand, and the frame tracked again."""
    before = pd.read_csv(folder / "foreign.angles.csv").set_index("frame")
    tab.locator(".worst button").first.click()
    until(tab, "document.querySelector('.film canvas').dataset.frame !== '0'")
    frame = int(tab.evaluate("document.querySelector('.film canvas').dataset.frame"))
    inside = """() => { const e = window.benchEditor, f = e.panel.film;
      for (let y = 1; y < f.height; y += 2) for (let x = 1; x < f.width; x += 2)
        if ([[-3, 0], [3, 0], [0, -3], [0, 3]].every(([dx, dy]) => e.trackedAt(x + dx, y + dy)?.name === 'jack'))
          return [x, y]; }"""
    x, y = tab.evaluate(inside)
    canvas = tab.locator(".film canvas")
    canvas.scroll_into_view_if_needed()
    box, k = canvas.bounding_box(), canvas.bounding_box()["width"] / CAMERA.width
    at = (box["x"] + (x + 0.5) * k, box["y"] + (y + 0.5) * k)
    tab.mouse.move(*at)
    tab.mouse.down()
    tab.mouse.move(at[0] + 2 * k, at[1] - 2 * k)
    tab.mouse.move(at[0] + 0.4 * k, at[1] - 0.3 * k)
    tab.mouse.up()
    for key in ("]", "["):
        tab.keyboard.press(key)
    tab.get_by_role("button", name="Track this frame again").press("Enter")
    tab.get_by_text("found", exact=True).wait_for()
    after = pd.read_csv(folder / "foreign.angles.csv").set_index("frame")
    assert after.loc[frame, "jack_rad"] == pytest.approx(before.loc[frame, "jack_rad"], abs=1e-3)
    others = before.index != frame
    pd.testing.assert_frame_equal(before[others], after[others])


def test_points_are_added_moved_deleted_and_taken_back(browser: Any, filmed: Path, looking: Page) -> None:
    with opened(browser, looking, f"{looking.address}#outlines?film=example_forte&trial=1") as tab:
        tab.locator("main[data-ready]").wait_for()
        until(tab, "document.querySelector('.film canvas').dataset.frame === '0'")
        points = "window.benchEditor.bodies[0].points"
        assert len(tab.evaluate(points)) == 4
        canvas = tab.locator(".film canvas")
        box = canvas.bounding_box()
        k = box["width"] / 120
        canvas.click(position={"x": 21.5 * k, "y": 4.5 * k})  # above the upper edge: a corner in it
        assert tab.evaluate(points)[1] == pytest.approx([21.0, 4.0], abs=0.3) and len(tab.evaluate(points)) == 5
        tab.keyboard.press("ArrowDown")
        tab.keyboard.press("Shift+ArrowRight")
        assert tab.evaluate(points)[1] == pytest.approx([21.1, 5.0], abs=0.3)
        tab.mouse.move(box["x"] + 6.5 * k, box["y"] + 52.5 * k)
        tab.mouse.down()
        tab.mouse.move(box["x"] + 9.5 * k, box["y"] + 55.5 * k)
        tab.mouse.up()
        assert tab.evaluate(points)[4] == pytest.approx([9.0, 55.0], abs=0.3)
        tab.keyboard.press("Delete")
        assert len(tab.evaluate(points)) == 4
        tab.reload()  # what was drawn is not lost
        tab.locator("main[data-ready]").wait_for()
        assert len(tab.evaluate(points)) == 4 and tab.evaluate(points)[1] == pytest.approx([21.1, 5.0], abs=0.3)
        tab.get_by_role("button", name="New body").click()
        for keys in (["Enter"], ["Enter", "ArrowDown"], ["Enter", "Control+ArrowDown"]):  # corners without a pointer
            for key in keys:
                tab.keyboard.press(key)
        assert tab.evaluate("window.benchEditor.bodies[3].points") == [[60, 30], [70, 31], [80, 41]]
        for _ in range(6):
            tab.get_by_role("button", name="Undo", exact=True).click()
        assert tab.evaluate("window.benchEditor.bodies.length") == 3
        assert tab.get_by_role("button", name="Save", exact=True).is_disabled()  # looking only
