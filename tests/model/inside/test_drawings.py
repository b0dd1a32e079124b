"""Sheet, side view and animation: drawn from the model's geometry, whole or absent, and saying what was simulated."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest

import model
from model.files.force_library import force_table
from model.inside.animation import FAR_STEP_S, NEAR_STEP_S, frame_rows, write_animation
from model.inside.figure import draw_sheet
from model.inside.labels import close_up
from model.inside.seen_motion import see_motion
from model.inside.side_view import side_view

SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def blow(action: model.Action) -> tuple[model.Solution, np.ndarray]:
    time, force = force_table("forte")
    rows = model.output_times(0.0, 0.3, 5000.0)
    return model.simulate(action, time, force, output_time_s=rows, inside=True), np.interp(rows, time, force)


def test_surfaces_are_those_of_the_parameters(action: model.Action, blow: tuple) -> None:
    view = side_view(blow[0].inside)
    seen = 0
    for body, shapes in view.surfaces.items():
        for shape in shapes:
            for side in ("first", "second"):
                path = f"{shape.contact}.{side}"
                if action.structure[f"{path}.body"] != body:
                    continue
                base = np.array([action[f"{path}.x"], action[f"{path}.y"]])
                if action.structure[f"{path}.shape"] == "line":
                    normal = np.array([action[f"{path}.normal.x"], action[f"{path}.normal.y"]])
                    assert np.abs((shape.points - base) @ normal).max() < 1e-12
                    assert np.hypot(*(shape.points[-1] - shape.points[0])) < 0.06  # what the motion meets, not all
                else:
                    away = np.hypot(*(shape.points - base).T)
                    assert away.min() == pytest.approx(action[f"{path}.radius"], rel=1e-9)  # tangents lie outside
                    hybrid = action.structure[f"{path}.shape"] == "hybrid"
                    assert hybrid or away.max() == pytest.approx(away.min())
                seen += 1
    assert seen == 26
    assert {body: len(sticks) > 0 for body, sticks in view.sticks.items()} == dict.fromkeys(model.BODIES, True)
    drive = [action["drive.point.x"], action["drive.point.y"]]
    assert np.any(np.all(np.isclose(view.sticks["key"], drive), axis=-1))


def test_time_is_fine_around_the_strike(blow: tuple) -> None:
    seen = blow[0].inside
    near = close_up(seen)
    strike = seen.time_s[np.argmax(seen.normal_n[:, 11])]
    assert near[0] < strike < near[1]
    rows = frame_rows(seen)
    time, steps = seen.time_s[rows], np.diff(seen.time_s[rows])
    inside = (time[:-1] > near[0]) & (time[1:] < near[1])
    np.testing.assert_allclose(steps[inside], NEAR_STEP_S)
    turned = np.abs(seen.pose[rows, :, 2] - seen.pose[0, :, 2]).max(axis=1)
    moving = turned[1:] > 2e-4
    assert steps[moving].max() < FAR_STEP_S + 1e-9 and rows[0] == 0 and rows[-1] == len(seen.time_s) - 1
    still = int(np.argmax(turned > 2e-4))
    assert 1 < still < 8  # 0.05 s of rest are a few frames: the viewer does not wait for two seconds


def test_the_animation_moves_as_the_solution(action: model.Action, blow: tuple, tmp_path: Path) -> None:
    solution, force = blow
    write_animation(action, solution, force, tmp_path / "a.svg")
    tree = ET.parse(tmp_path / "a.svg")
    rows = frame_rows(solution.inside)
    moves = [e for e in tree.iter() if e.tag in (f"{SVG}animate", f"{SVG}animateTransform")]
    assert {len(e.attrib["values"].split(";")) for e in moves} == {len(rows)}
    assert len({e.attrib["dur"] for e in moves}) == 1
    turns = [e.attrib["values"].split(";") for e in moves if e.attrib.get("type") == "rotate"]
    assert len(turns) == 5
    for i, body in enumerate(model.BODIES):
        angle = solution.angle_rad[rows, i] + (solution.angle_rad[rows, 1] if body in ("jack", "repetition") else 0.0)
        np.testing.assert_allclose(np.array(turns[i], float), np.degrees(angle), atol=6e-4)
    lights = [
        e for e in moves if e.attrib["attributeName"] == "r" and not set(e.attrib["values"].split(";")) <= {"2", "4"}
    ]
    assert len(lights) == 13  # and not the key's pivot
    string = np.array(lights[11].attrib["values"].split(";"), float)
    area = np.pi * string**2
    k = int(np.argmax(area))
    assert area[k] == pytest.approx(6.0 * solution.inside.normal_n[:, 11].max(), rel=0.02) and string[0] == 0.0
    text = (tmp_path / "a.svg").read_text(encoding="utf-8")
    assert "back check" in text and "nan" not in text
    assert [p.name for p in tmp_path.iterdir()] == ["a.svg"]


@pytest.mark.slow  # compiles scenes of their own
@pytest.mark.parametrize("scene", ["lifting-key-flexible-shank", "key-whippen"])
def test_other_scenes_are_drawn_as_well(action: model.Action, scene: str, tmp_path: Path) -> None:
    time, force = force_table("forte")
    rows = model.output_times(0.0, 0.15, 5000.0)
    solution = model.simulate(action, time, force, output_time_s=rows, inside=True, scene=scene)
    at = np.interp(rows, time, force)
    draw_sheet(action, solution, at, tmp_path / "sheet.png")
    write_animation(action, solution, at, tmp_path / "a.svg")
    names = [e.text for e in ET.parse(tmp_path / "a.svg").iter(f"{SVG}tspan")]
    assert names == [b for b in solution.bodies if b != "key_lift"]
    assert (tmp_path / "sheet.png").stat().st_size > 20_000


def test_what_cannot_be_drawn_is_refused(action: model.Action, blow: tuple, tmp_path: Path) -> None:
    with pytest.raises(model.InputError, match="allowed .svg"):
        write_animation(action, *blow, tmp_path / "a.mp4")
    with pytest.raises(model.InputError, match="allowed .svg, .pdf, .png"):
        draw_sheet(action, *blow, tmp_path / "a.jpeg")
    blind = model.simulate(action, [0.0, 0.01], [0.0, 0.0])
    for draw in (write_animation, draw_sheet):
        with pytest.raises(model.InputError, match="inside=True"):
            draw(action, blind, np.zeros(2), tmp_path / "a.svg")
    assert not list(tmp_path.iterdir())


def test_forces_of_felt_that_remembers_are_those_of_the_run_or_none() -> None:
    """Angles and speeds do not decide them: drawn from those alone they would be another felt's."""
    action = model.load_action().with_laws({"contact02": "stulov"})
    scene, still = model.build_scene(action), model.rest_state(action).angle_rad[None]
    given = np.arange(13.0)[None]
    seen = see_motion(scene, np.zeros(1), still, 0.0 * still, np.zeros(1), given)
    assert np.array_equal(seen.normal_n, given)
    with pytest.raises(model.InputError, match="forces of a drawing from angles alone: found felt that remembers"):
        see_motion(scene, np.zeros(1), still, 0.0 * still, np.zeros(1))
