"""Sheet and side view: drawn from the model's geometry, whole or absent, and saying what was simulated."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

import model
from model import force_table
from model.inside import draw_sheet
from model.inside.body_poses import observe_poses
from model.inside.side_view import side_view


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


@pytest.mark.parametrize(
    ("scene", "per_newton", "unit"),
    [
        ("giving-hammer", 1.0, "N"),
        ("motor-drive", 0.08, "V"),
    ],
)
def test_other_scenes_are_drawn_as_well(
    action: model.Action, scene: str, per_newton: float, unit: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With what joints give: against poses and depths of the inside view."""
    time, force = force_table("forte")
    force, rows = per_newton * force, model.output_times(0.0, 0.15, 5000.0)
    solution = model.simulate(action, time, force, output_time_s=rows, inside=True, scene=scene)
    at = np.interp(rows, time, force)
    sheets: list[Figure] = []
    save = Figure.savefig
    monkeypatch.setattr(Figure, "savefig", lambda self, *a, **k: sheets.append(self) or save(self, *a, **k))
    draw_sheet(action, solution, at, tmp_path / "sheet.png")
    assert (tmp_path / "sheet.png").stat().st_size > 20_000
    inside, axes = solution.inside, sheets[0].axes
    assert inside is not None
    of_millimetres = next(one for one in axes if one.get_ylabel() == "mm")
    dip, height = (line.get_ydata() for line in of_millimetres.lines)
    x, y, turned = inside.pose[:, inside.bodies.index("key")].T
    front = y + action["drive.point.x"] * np.sin(turned) + action["drive.point.y"] * np.cos(turned)
    np.testing.assert_allclose(dip, 1e3 * (front[0] - front), atol=1e-9)
    np.testing.assert_allclose(height, -1e3 * inside.penetration_m[:, inside.contacts.index("contact12")])
    assert axes[0].get_ylabel() == unit
    tips = {name for name in inside.columns() if name.endswith("_felt_j") and not name.startswith(("contact", "bal"))}
    presser = set() if unit == "N" else {"motor_arm_felt_j"}
    assert tips == presser <= inside.long_names({}).keys()


def test_what_cannot_be_drawn_is_refused(action: model.Action, blow: tuple, tmp_path: Path) -> None:
    with pytest.raises(model.InputError, match="allowed .svg, .pdf, .png"):
        draw_sheet(action, *blow, tmp_path / "a.jpeg")
    blind = model.simulate(action, [0.0, 0.01], [0.0, 0.0])
    with pytest.raises(model.InputError, match="inside=True"):
        draw_sheet(action, blind, np.zeros(2), tmp_path / "a.svg")
    assert not list(tmp_path.iterdir())


def test_forces_of_felt_that_remembers_are_those_of_the_run_or_none() -> None:
    """Angles and speeds do not decide them: drawn from those alone they would be another felt's."""
    action = model.load_action().with_laws(
        {"contact02": "stulov", "contact07": "hysteresis", "contact12": "hysteresis"}
    )
    scene, still = model.build_scene(action), model.rest_state(action).angle_rad[None]
    given = np.arange(13.0)[None]
    seen = observe_poses(scene, np.zeros(1), still, 0.0 * still, np.zeros(1), given)
    assert np.array_equal(seen.normal_n, given)
    with pytest.raises(model.InputError, match="forces of a drawing from angles alone: found felt that remembers"):
        observe_poses(scene, np.zeros(1), still, 0.0 * still, np.zeros(1))
