"""Rest state: against the published balance, under load, and for actions that differ from the printed one."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq

import model
from model.simulation import statics
from model.simulation.statics import NO_REST
from tests.model.verification.reference_equations import Twin

pytestmark = pytest.mark.processor

# Static balance of the printed parameters, found independently by two implementations (hand-written
# Newton-Euler, symbolic Lagrange), residual < 3e-14 N m; project note model.md, rest_state.json.
REST = [0.028600363768885056, 0.025109511260139862, 0.31975495900647877, 0.3523367185735365, 0.2950879163697746]
LOADED = {
    "contact01": 0.8107367073071615, "contact03": 0.16583632333201143, "contact05": 0.1100818121289008,
    "contact06": 1.1387309386691051, "contact07": 0.41177955991788406, "contact13": 0.03905360523296049,
}  # fmt: skip


def test_rest_state_of_the_printed_action(action: model.Action) -> None:
    rest = model.rest_state(action)
    np.testing.assert_allclose(rest.angle_rad, REST, rtol=0, atol=1e-9)
    forces = dict(zip(rest.contacts, rest.contact_normal_n, strict=True))
    for name, force in forces.items():
        assert force == pytest.approx(LOADED.get(name, 0.0), abs=1e-8), name
    assert rest.residual_nm < 1e-12
    height = model.observables.hammer_height_m(action, rest.angle_rad[None])[0]
    assert height == pytest.approx(48.15659994532259e-3, abs=1e-9)


@pytest.mark.parametrize("force", [-0.1, 0.3, 10.0, 60.0])
def test_rest_under_load_balances_the_twin(action: model.Action, twin: Twin, force: float) -> None:
    rest = model.rest_state(action, force)
    residual, _ = twin.forces_and_mass(rest.angle_rad, np.zeros(5), force)
    assert np.abs(residual).max() < 1e-10


def test_rest_searched_from_one_near_by_is_the_same(action: model.Action) -> None:
    near = model.rest_state(action, 0.1)
    heavier = action.with_values({"hammer.mass": 1.1 * action["hammer.mass"]})
    cold, warm = model.rest_state(heavier, 0.2), model.rest_state(heavier, 0.2, near=near)
    np.testing.assert_allclose(warm.angle_rad, cold.angle_rad, rtol=0, atol=1e-10)
    lifting = model.load_scene("giving-joints").on(action)  # of other bodies: the search begins anew
    np.testing.assert_array_equal(
        model.rest_state(lifting, 0.2, near=near).angle_rad, model.rest_state(lifting, 0.2).angle_rad
    )


def test_a_rest_where_other_contacts_touch_is_not_kept(action: model.Action) -> None:
    pressed = model.rest_state(action, 0.45)  # has left the rest that a hand sets up under less
    cold = model.rest_state(action, 0.05)
    assert not np.array_equal(pressed.penetration_m > 0, cold.penetration_m > 0)
    np.testing.assert_array_equal(model.rest_state(action, 0.05, near=pressed).angle_rad, cold.angle_rad)


def test_rest_of_other_actions(action: model.Action) -> None:
    random = np.random.default_rng(7)
    lengths = [p for p, q in action.quantities.items() if q.unit == "m" and not p.endswith("radius")]
    for _ in range(15):
        moved = action.with_values({p: action[p] + random.uniform(-5e-4, 5e-4) for p in lengths})
        rest = model.rest_state(moved)
        residual, _ = Twin(moved).forces_and_mass(rest.angle_rad, np.zeros(5), 0.0)
        assert np.abs(residual).max() < 1e-10


def test_input_must_be_finite(action: model.Action) -> None:
    with pytest.raises(model.InputError, match="finite"):
        model.rest_state(action, float("nan"))


def stiffnesses(action: model.Action, share: float, contacts: tuple[str, ...] = ("contact",)) -> dict[str, float]:
    """A share of the stiffness of felts; without any a felt is no part of the scene, and another kernel is compiled."""
    return {
        path: share * q.value
        for path, q in action.quantities.items()
        if path.startswith(contacts) and ".normal." in path and q.unit.startswith("N")
    }


@pytest.mark.parametrize("input_n", [0.0, 0.5])
@pytest.mark.parametrize("g", [0.0, 1e-12])
def test_without_weight_nothing_rests_and_one_line_says_it(action: model.Action, g: float, input_n: float) -> None:
    with pytest.raises(model.StaticsError) as error:
        model.rest_state(action.with_values({"gravity.g": g}), input_n)
    assert str(error.value) == NO_REST


def test_without_felt_nothing_rests_and_one_line_says_it(action: model.Action) -> None:
    with pytest.raises(model.StaticsError) as error:
        model.rest_state(action.with_values(stiffnesses(action, 1e-30)))
    assert str(error.value) == NO_REST


def test_a_felt_that_only_touches_holds_nothing(action: model.Action) -> None:
    """Without weight a hammer that just touches is held by the stiffness there, and pressed by nothing."""
    at_rest = model.rest_state(action)
    scene = model.build_scene(action.with_values({"gravity.g": 0.0}))
    for k in range(8):
        start = at_rest.angle_rad.copy()
        start[4] += 1e-9 * k  # rounding of another processor, and more
        with pytest.raises(model.StaticsError):
            statics.solve_rest(scene, 0.0, start)


@pytest.mark.parametrize("g", [0.01, 1.6, 9.81, 100.0])
def test_little_weight_is_enough(action: model.Action, g: float) -> None:
    light = action.with_values({"gravity.g": g})
    residual, _ = Twin(light).forces_and_mass(model.rest_state(light).angle_rad, np.zeros(5), 0.0)
    assert np.abs(residual).max() < 1e-10


def test_which_rest_is_found_off_a_saddle_does_not_hang_on_the_sign_of_an_eigenvector(
    action: model.Action, monkeypatch: pytest.MonkeyPatch
) -> None:
    soft = stiffnesses(action, 1e-30, tuple(f"contact{c:02d}" for c in (6, 7, 11, 12, 13)))
    scene = model.build_scene(action.with_values(soft))
    start = np.array(model.rest_state(action).angle_rad)
    upright = np.arctan2(action["hammer.center_of_mass.x"], action["hammer.center_of_mass.y"])

    def moment(turn: float) -> float:
        return float(statics.balance(scene, np.append(start[:4], turn), 0.0)[0][4])

    start[4] = brentq(moment, upright - 0.1, upright + 0.1, xtol=1e-15)  # stands on its pivot: it may fall either way
    found, eigh = [], np.linalg.eigh
    for sign in (1.0, -1.0):

        def other(matrix: np.ndarray, sign: float = sign) -> tuple[np.ndarray, np.ndarray]:
            value, axes = eigh(matrix)
            return value, sign * axes

        monkeypatch.setattr(np.linalg, "eigh", other)
        found.append(statics.solve_rest(scene, 0.0, start, held=(0, 1, 2, 3))[4])
    assert abs(found[0] - start[4]) > 1.0  # it fell
    assert found[0] == pytest.approx(found[1], abs=1e-9)
