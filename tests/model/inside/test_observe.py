"""The inside view against the twin, finite differences, Newton's law and the energy audit."""

from __future__ import annotations

import numpy as np
import pytest

import model
from model.inside import Observer, tensions
from tests.model.conftest import random_states, read_table
from tests.model.verification.reference_equations import Twin


@pytest.fixture(scope="module")
def forte(action: model.Action) -> model.Solution:
    table = read_table("forte_force.csv")
    return model.simulate(action, table[:, 0], table[:, 1], energy=True, inside=True, tolerance=1e-7)


def center(twin: Twin, q: np.ndarray, body: str) -> np.ndarray:
    twin._place(q, np.zeros(len(q)))
    turn, local = twin.angle[body], twin.mass[body][2]
    return twin.pivot[body] + np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]) @ local


def newton(twin: Twin, q: np.ndarray, v: np.ndarray, force: float, acceleration: dict) -> dict[str, np.ndarray]:
    """Joint forces by Newton's law on each body, from accelerations (2,) of centres and the twin's forces."""
    twin._place(q, v)
    rest = {b: twin.mass[b][0] * (acceleration[b] + [0.0, twin.action["gravity.g"]]) for b in twin.bodies}
    rest["key"] = rest["key"] + [0.0, force]
    for name in twin.contacts:
        normal, tangential, _ = twin.contact(name, v)
        _, n, _, first, second = twin.gap(name)
        push = normal * n + tangential * np.array([-n[1], n[0]])
        for body, sign in ((first, -1.0), (second, 1.0)):
            if body != "ground":
                rest[body] = rest[body] + sign * push
    for child in (b for b in twin.bodies if twin.parent[b] != "ground"):
        rest[twin.parent[child]] = rest[twin.parent[child]] + rest[child]
    if twin.lifts:
        rest["key"] = rest["key"] - [0.0, twin.rail_force(q[5], v[5])]
    return rest


@pytest.mark.parametrize("effects", [(), ("balance_rail", "shank")], ids="+".join)
def test_motion_and_joint_forces_of_single_states(action: model.Action, effects: tuple[str, ...]) -> None:
    twin = Twin(action, effects)
    scene = model.build_scene(action, model.SceneChoice(effects=effects))
    assert list(scene.bodies) == twin.coordinates
    observer = Observer(scene)
    random = np.random.default_rng(4)
    for q, v, force in random_states(25, 21):
        q, v = (np.append(x, s * random.normal(size=len(effects))) for x, s in ((q, 3e-4), (v, 0.1)))
        f, mass = twin.forces_and_mass(q, v, force)
        a = np.linalg.solve(mass, f)
        step = min(1e-4 / np.sqrt(np.abs(a).max()), 1e-4 / np.abs(v).max())  # little bent, well above rounding
        state = observer.evaluate(q[None], v[None], np.array([force]))
        late, early = (q + s * v + 0.5 * s * s * a for s in (step, -step))
        found = state.joint_forces()[0]
        differences = {}
        for body in twin.bodies:
            i = scene.bodies.index(body)
            after, at, before = (center(twin, angles, body) for angles in (late, q, early))
            speed, differences[body] = (after - before) / (2 * step), (after - 2 * at + before) / step**2
            np.testing.assert_allclose(state.velocity[0, i], speed, rtol=1e-5, atol=1e-6)
            size = 1e-5 * np.abs(differences[body]).max() + 1e-7 * np.abs(a).max()
            np.testing.assert_allclose(state.acceleration[0, i], differences[body], rtol=0, atol=size)
        wanted = newton(twin, q, v, force, differences)
        size = max(float(np.abs(f).max()) for f in wanted.values())
        for body in twin.bodies:
            np.testing.assert_allclose(found[scene.bodies.index(body)], wanted[body], rtol=0, atol=1e-4 * size)
        turning = a[:5] + np.array([0.0, 0.0, a[1], a[1], 0.0])
        np.testing.assert_allclose(state.turning[0, :5], turning, rtol=1e-9, atol=1e-9 * np.abs(a).max())


def test_what_contacts_and_joints_lose_is_the_audits(forte: model.Solution) -> None:
    """The audit is integrated with the motion, step by step, by another kernel."""
    inside, energy = forte.inside, forte.energy
    assert inside is not None and energy is not None
    allowed = inside.error_j + abs(energy.residual) + 1e-8 * energy.work_in
    assert abs(inside.rubbed_j[-1].sum() - energy.lost_in_contact_friction) < allowed
    assert abs(inside.felt_j[-1].sum() - energy.lost_in_felt) < allowed
    assert abs(inside.joint_j[-1].sum() - energy.lost_in_joint_friction) < allowed
    for grows in (inside.rubbed_j, inside.felt_j, inside.joint_j, inside.slid_m):
        assert np.all(grows[0] == 0.0) and np.all(np.diff(grows, axis=0) >= -1e-9)
    assert inside.slid_m[-1, 3] > 1e-4 and inside.rubbed_j[-1, 1] == 0.0  # back check rubs; key front has no friction


def test_a_key_that_can_lift_does_where_a_joint_would_pull(action: model.Action, forte: model.Solution) -> None:
    """And what rail, pin and shank lose is the audit's."""
    table = read_table("forte_force.csv")
    scene = model.SceneChoice(effects=("balance_rail", "shank"))
    solution = model.simulate(action, table[:, 0], table[:, 1], energy=True, inside=True, tolerance=1e-7, scene=scene)
    inside, energy = solution.inside, solution.energy
    assert inside is not None and energy is not None and forte.inside is not None
    allowed = inside.error_j + abs(energy.residual) + 1e-8 * energy.work_in
    rail, guide, shank = (inside.contacts.index("balance_rail"), *map(inside.bodies.index, ("key_lift", "shank")))
    felt, joints = inside.felt_j[-1], inside.joint_j[-1]
    assert abs(felt[rail] + joints[guide] - energy.lost_in_rail) < allowed and energy.lost_in_rail > 1e-5
    assert abs(joints[shank] - energy.lost_in_shank) < allowed and energy.lost_in_shank > 1e-5
    assert abs(felt.sum() - felt[rail] - energy.lost_in_felt) < allowed
    assert abs(joints[:5].sum() - energy.lost_in_joint_friction) < allowed
    first, lifted = forte.inside.key_tensions()[0], inside.key_lifts()
    assert inside.key_tensions() == [] and forte.inside.key_lifts() == []
    assert any(one.start_s < first.largest_at_s + 1e-3 and one.end_s > first.start_s for one in lifted)
    highest = max(one.largest_m for one in lifted)
    # the coordinate measures from the height at rest, the lift from the felt's surface above it
    sunk = solution.angle_rad[:, inside.bodies.index("key_lift")].max() - highest
    assert highest > 5e-5 and -1e-4 < sunk < 1e-4
    columns = inside.columns()
    assert "key_lift_center_x_m_per_s" not in columns and "shank_center_x_m_per_s" in columns


def test_rows_do_not_change_what_adds_up(action: model.Action, forte: model.Solution) -> None:
    table = read_table("forte_force.csv")
    coarse = model.simulate(
        action, table[:, 0], table[:, 1], output_time_s=np.array([0.1, 0.3]), inside=True, tolerance=1e-7
    ).inside
    assert coarse is not None and forte.inside is not None
    rows = np.searchsorted(forte.time_s, [0.1, 0.3])
    np.testing.assert_allclose(coarse.rubbed_j, forte.inside.rubbed_j[rows], atol=2e-8)
    np.testing.assert_allclose(coarse.slid_m, forte.inside.slid_m[rows], atol=2e-8)
    np.testing.assert_allclose(coarse.largest_normal_n[11], forte.inside.largest_normal_n[11], rtol=1e-3)
    assert forte.inside.largest_normal_n[11] > 50.0 > coarse.normal_n[:, 11].max()
    np.testing.assert_allclose(coarse.joint_n, forte.inside.joint_n[rows], atol=1e-9)


def test_the_motors_tip(action: model.Action) -> None:
    """At rest its shaft bears what the tip presses with, that is torque over length; in motion it loses energy."""
    scene = model.build_scene(action, model.SceneChoice(effects=("motor_arm",)))
    rest = model.rest_state(action, 0.03, scene)
    q = rest.angle_rad
    state = Observer(scene).evaluate(q[None], np.zeros((1, scene.size)), np.array([0.03]))
    motor = scene.bodies.index("motor")
    length, spring = action["motor_arm.length"], action["motor_arm.spring_stiffness"]
    torque = 0.03 + action["motor_arm.preload_n"] * length - spring * q[motor]
    press = torque / (length * np.cos(q[motor]))
    assert state.tip[0, 0, 0] == pytest.approx(press, rel=1e-9)
    np.testing.assert_allclose(state.joint_forces()[0, motor], [0.0, -press], atol=1e-9)
    pushed = Observer(model.build_scene(action)).evaluate(q[None, :motor], np.zeros((1, 5)), np.array([press]))
    np.testing.assert_allclose(
        state.joint_forces()[0, :5], pushed.joint_forces()[0], atol=1e-8
    )  # as a force of that size
    inside = model.simulate(action, [0.0, 0.03, 0.15], [0.0, 0.8, 0.8], inside=True, scene="motor-arm").inside
    assert inside is not None and inside.tip_j[-1, 0] > 1e-5
    np.testing.assert_array_equal(inside.columns()["motor_arm_normal_n"], inside.tip_n[:, 0])


def test_tensions_of_a_sine() -> None:
    time = np.linspace(0.0, 2.0, 2001)
    found = tensions(time, 3.0 * np.sin(2 * np.pi * time))
    assert len(found) == 2
    for one, start in zip(found, (0.5, 1.5), strict=True):
        assert (one.start_s, one.end_s) == (pytest.approx(start, abs=1e-6), pytest.approx(start + 0.5, abs=1e-6))
        assert one.largest_n == pytest.approx(3.0) and one.largest_at_s == pytest.approx(start + 0.25)
        assert one.impulse_ns == pytest.approx(3.0 / np.pi, rel=1e-5)
    assert tensions(time, np.ones_like(time)) == []
    (all_of_it,) = tensions(time, -np.ones_like(time))
    assert (all_of_it.start_s, all_of_it.end_s, all_of_it.impulse_ns) == (0.0, 2.0, pytest.approx(2.0))


def test_a_smaller_scene_and_one_that_never_moves(action: model.Action) -> None:
    still = model.simulate(action, [0.0, 0.01], [0.0, 0.0], inside=True, scene="key").inside
    assert still is not None and still.bodies == ("key",)
    assert set(still.contacts) == {"contact02", "contact03"}
    columns = still.columns()
    assert "key_joint_y_n" in columns and "hammer_joint_y_n" not in columns
    assert np.all(columns["key_joint_rubbed_j"] < 1e-12)
    assert model.simulate(action, [0.0, 0.01], [0.0, 0.0]).inside is None
