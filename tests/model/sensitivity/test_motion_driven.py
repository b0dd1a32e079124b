"""Derivatives under a measured motion of the key, against differences of whole runs."""

from __future__ import annotations

import numpy as np
import pytest

import model
from model.motion_driven.prescribed_key import run_prescribed
from model.motion_driven.spline_fit import fit_key_motion
from tests.model.sensitivity.richardson import changed, relative_error

# with a step of differences
STEPS = {"hammer.mass": 1e-6, "contact07.second.x": 2e-7, "contact01": 1e-4, "friction": 1e-4, "key.mass": 1e-5}


@pytest.fixture(scope="module")
def motion(action: model.Action) -> tuple[np.ndarray, np.ndarray]:
    """Changes of the key's angle since rest in a forte, up to after the strike."""
    time, force = model.force_table("forte")
    keep = time <= 0.115
    key = model.simulate(action, time[keep], force[keep], tolerance=1e-8).angle_rad[:, 0]
    return time[keep], key - key[0]


@pytest.fixture(scope="module")
def found(action: model.Action, motion: tuple[np.ndarray, np.ndarray]) -> model.Sensitivities:
    return model.motion_sensitivities(action, motion, [*STEPS])


@pytest.mark.parametrize("name", STEPS)
def test_motion_and_force_agree_with_differences(
    action: model.Action, motion: tuple[np.ndarray, np.ndarray], found: model.Sensitivities, name: str
) -> None:
    ends = [
        model.simulate_motion(
            changed(action, name, s * STEPS[name]), *motion, from_rest=True, members=0, tolerance=1e-11,
            method="rodas5p",
        )
        for s in (1.0, -1.0)
    ]  # fmt: skip
    j = found.parameters.index(name)
    order = [found.angle_names.index(body) for body in ends[0].bodies]
    angles = (ends[0].angle_rad - ends[1].angle_rad) / (2.0 * STEPS[name])
    force = (ends[0].force_n - ends[1].force_n) / (2.0 * STEPS[name])
    moving = np.max(np.abs(angles), axis=0) > 1e-6 / STEPS[name] * 1e-3
    if name == "key.mass":  # changes the rest angle, hence where the whole motion lies, and the force
        assert np.ptp(found.d_angles[:, -1, j]) == 0.0 and found.d_angles[0, -1, j] != 0.0
    assert np.any(moving)
    ours = found.d_angles[:, order, j][:, moving]
    assert relative_error(ours, angles[:, moving]) < 2e-4
    apart = np.abs(found.d_force[:, j] - force) / np.max(np.abs(force))  # type: ignore[index]
    assert np.quantile(apart, 0.98) < 1e-3  # samples next to a touch stand on a kink


def test_angles_from_ground_do_not_move_with_the_rest(
    action: model.Action, motion: tuple[np.ndarray, np.ndarray]
) -> None:
    rest = model.rest_state(action).angle_rad[0]
    short = motion[0][:200], motion[1][:200] + rest
    found = model.motion_sensitivities(action, short, ["contact01.first.y"], from_rest=False)
    assert not np.any(found.d_angles[:, -1]) and np.any(found.d_angles[:, 0])


def test_a_fitted_motion_from_a_rest_under_a_force(action: model.Action, motion: tuple[np.ndarray, np.ndarray]) -> None:
    """The key rests lower under the arm, and other bodies with it: derivatives of both ends of that."""
    time, turn = motion[0][:300], motion[1][:300]
    fitted = fit_key_motion(time, turn).motion()
    options = model.SensitivityOptions(events=False, rest_input=0.5, output_time_s=time[1:-1], allow_idle=True)
    found = model.motion_sensitivities(action, fitted, ["contact01", "contact02"], options=options)
    ends = []
    for s in (1.0, -1.0):
        moved = changed(action, "contact01", s * 1e-4)
        key = model.rest_state(moved, 0.5).angle_rad[0]
        ends.append(run_prescribed(moved, fitted.raised(key), time[1:-1], tolerance=1e-11).angle_rad)
    apart = (ends[0] - ends[1])[:, [1, 2, 3, 4, 0]] / 2e-4
    assert relative_error(found.d_angles[:, :, 0], apart) < 1e-3
    free = model.SensitivityOptions(events=False, output_time_s=time[1:-1], allow_idle=True)
    unloaded = model.motion_sensitivities(action, fitted, ["contact01"], options=free)
    assert abs(unloaded.d_rest[-1, 0] - found.d_rest[-1, 0]) > 0.01 * abs(found.d_rest[-1, 0])


def test_what_only_a_force_has_is_refused(action: model.Action, motion: tuple[np.ndarray, np.ndarray]) -> None:
    with pytest.raises(model.InputError, match="found events, allowed tolerances"):
        model.motion_sensitivities(action, motion, ["hammer.mass"], options=model.SensitivityOptions())
    with pytest.raises(model.InputError, match="contact12: does nothing in this stroke"):
        model.motion_sensitivities(action, (motion[0][:100], motion[1][:100]), ["contact12"])
    with pytest.raises(model.InputError, match="found nothing but the prescribed key"):
        options = model.SensitivityOptions(events=False, scene="key")
        model.motion_sensitivities(action, motion, ["key.mass"], options=options)
