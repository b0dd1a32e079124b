"""Set-valued friction: closed-form motion of one pair, the static coefficient, and the limit of the smoothed law."""

from __future__ import annotations

import numpy as np
import pytest

import model
from model.derived.columns import FELT, SLIDE
from model.derived.observe import contacts_at
from model.errors import InputError
from model.files.force_library import force_table
from model.integrators.stick_slip import stick_together, sweep_once
from model.kernels import layout as L
from model.simulation.run import Simulation, State
from model.stick_slip import compare, simulate

ACTION = model.load_action()
FREE = {f"{b}.joint_friction.A": 0.0 for b in model.BODIES} | {f"contact{i:02d}.friction": 0.0 for i in (1, 4, 7, 10)}


@pytest.mark.slow
def test_joint_friction_holds_then_slides_as_coulomb_says() -> None:
    """A stiff joint alone stops an action whose every other friction is off."""
    stiff = ACTION.with_values(FREE | {"key.joint_friction.A": 0.5})  # 0.5 N m at 0.23 m: more than 2 N
    t = np.arange(0.0, 0.1, 2e-4)
    held = simulate(stiff, t, np.full(len(t), 1.0), 1e-5)
    key = held.solution.bodies.index("key")
    assert np.ptp(held.solution.angle_rad[:, key]) < 1e-12
    assert held.joint_sticks[1:, key].all()
    pushed = simulate(stiff, t, np.full(len(t), 6.0), 1e-5)
    assert pushed.solution.angle_rad[-1, key] < held.solution.angle_rad[-1, key] - 0.01
    assert not pushed.joint_sticks[50, key]


@pytest.mark.slow
def test_energy_closes_as_the_step_falls() -> None:
    """Work of the force is stored, or lost in felt and in what slides, at the kinetic coefficients."""
    scene, off = model.build_scene(ACTION), []
    p, start, bodies = scene.vector, int(scene.tables.offset[1]), range(scene.size)
    rubs = np.array([p[start + L.CONTACT_SIZE * c + L.MU_A] for c in range(len(scene.contacts))])
    turns = np.array([p[L.GLOBALS + L.BODY_SIZE * i + L.JF_A] for i in bodies])
    for step in (2e-5, 1e-5, 5e-6):
        at = np.arange(0.0, 0.13, step)  # over let-off, strike and check
        force = np.interp(at, *force_table("forte"))
        moved = simulate(ACTION, at, force, step).solution
        q, v, normal = moved.angle_rad, moved.speed_rad_per_s, moved.contact_normal_n
        assert normal is not None
        seen = contacts_at(scene.tables, p, q, v)
        rubbed = np.sum(rubs * normal * np.abs(seen[:, :, SLIDE]), axis=1) + np.sum(turns * np.abs(v), axis=1)
        power = rubbed + seen[:, :, FELT].sum(axis=1)
        lost = np.sum(0.5 * (power[1:] + power[:-1]) * np.diff(at))
        work = np.sum(0.5 * (force[1:] + force[:-1]) * np.diff(model.observables.key_dip_m(ACTION, q)))
        ends = [Simulation(scene, State(0.0, q[k], v[k])).stored_energy() for k in (0, -1)]
        assert np.sum(0.5 * (rubbed[1:] + rubbed[:-1]) * np.diff(at)) > 0.05 * work
        off.append(abs(work - (ends[1] - ends[0]) - lost) / work)
    assert off[2] < 2e-5 and off[1] < 0.5 * off[0], off


def test_sticking_pairs_stop_and_impulses_stay_in_their_bounds() -> None:
    rng = np.random.default_rng(11)
    for _ in range(200):
        n, pairs = 4, 7  # more pairs than coordinates
        root = rng.normal(size=(n, n))
        mass = root @ root.T + 0.1 * np.eye(n)
        along = rng.normal(size=(pairs, n))
        given = np.ascontiguousarray(np.linalg.solve(mass, along.T).T)
        own = np.einsum("ij,ij->i", along, given)
        bound = rng.uniform(0.0, 2.0, pairs) * (rng.uniform(size=pairs) > 0.2)
        start = rng.normal(size=n)
        impulse, change = np.zeros(pairs), start.copy()
        for sweep in range(300):
            if sweep % 6 == 5:
                stick_together(along, given, bound, impulse, change)
            if sweep_once(along, given, own, bound, impulse, change) < 1e-11:
                break
        assert change == pytest.approx(start + impulse @ given, abs=1e-9)
        w = along @ change
        assert np.all(np.abs(impulse) <= bound)
        for j in np.flatnonzero(bound > 0.0):  # sticks inside the bound, else the impulse opposes the sliding
            assert abs(w[j]) < 1e-8 or impulse[j] == pytest.approx(-np.sign(w[j]) * bound[j])


@pytest.mark.slow  # python -m pytest -m slow tests/model/stick_slip
def test_smoothed_law_goes_to_the_limit() -> None:
    t, f = force_table("forte")
    cut = t <= 0.25
    limit = compare(ACTION, t[cut], f[cut], (1e-2, 1e-3, 1e-4, 1e-5), step_s=5e-6)
    away = [limit.away_rad(s) for s in limit.smoothed]
    assert away[0] > 2.0 * away[1] > 4.0 * away[2] > 12.0 * away[3]
    assert limit.march_error_rad < away[3] < 1e-4
    strike = [m.strike_s for m in limit.measures]
    assert abs(strike[3] - strike[4]) < 2e-6 < abs(strike[0] - strike[4])


def test_without_friction_the_march_is_the_smooth_motion() -> None:
    """No friction at all: only Moreau's scheme itself is left, of second order in the step."""
    action = ACTION.with_values(FREE)
    t, f = force_table("forte")
    cut = t <= 0.13
    exact = model.simulate(action, t[cut], f[cut], tolerance=1e-9)
    errors = [
        float(np.max(np.abs(simulate(action, t[cut], f[cut], h).solution.angle_rad - exact.angle_rad)))
        for h in (2e-5, 1e-5)
    ]
    assert errors[1] < 2e-5
    assert errors[0] / errors[1] > 3.0


def test_a_pair_that_stuck_holds_up_to_the_static_coefficient() -> None:
    """A peak of eq. 2.10 many times the kinetic coefficient keeps jack and knuckle together for longer."""
    t, f = force_table("forte")
    cut = t <= 0.25
    flat, peaked = (
        simulate(ACTION.with_values({"contact07.friction.B1": b1}), t[cut], f[cut], 1e-5) for b1 in (0.0, 20.0)
    )
    jack = flat.solution.contacts.index("contact07")
    assert peaked.contact_sticks[:, jack].sum() > 1.1 * flat.contact_sticks[:, jack].sum()


@pytest.mark.parametrize(
    ("t", "step", "words"),
    [
        ([0.0, 0.1, 0.3], 1e-5, "not evenly spaced"),
        ([0.0, 0.1, 0.2], 1e-3, "step: found 0.001 s"),
        ([0.0, 0.1, 0.2], 0.0, "step: found 0 s"),
    ],
)
def test_bad_input(t: list[float], step: float, words: str) -> None:
    with pytest.raises(InputError, match=words):
        simulate(ACTION, t, [0.0, 0.0, 0.0], step)


def test_the_command_of_a_drive_is_refused_before_anything_is_computed() -> None:
    """Its winding has no friction to be set-valued in, and a comparison says so at once, in one line."""
    action = model.load_scene("motor-drive").on(ACTION)
    for job in (simulate, compare):
        with pytest.raises(InputError, match="found the effect motor_drive, allowed motor_arm") as caught:
            job(action, *force_table("forte"))
        assert "\n" not in str(caught.value)


@pytest.mark.slow  # compiles its own structures
def test_without_friction_felt_and_string_follow_as_in_the_smooth_motion() -> None:
    """Memories and modes beside the march: of second order in the step, as without them."""
    string = model.load_scene("string").on(ACTION).with_effects({"string.modes": 12.0})
    t, f = force_table("forte")
    cut = t <= 0.12
    for action in (ACTION.with_laws({"contact12": "hysteresis"}), string, model.load_scene("giving-hammer").on(ACTION)):
        still = action.with_values(FREE)
        exact = model.simulate(still, t[cut], f[cut], tolerance=1e-9)
        errors = [
            float(np.max(np.abs(simulate(still, t[cut], f[cut], h).solution.angle_rad - exact.angle_rad)))
            for h in (1e-5, 5e-6)
        ]
        assert errors[1] < 5e-5 and errors[0] / errors[1] > 1.7


def test_a_joint_that_stuck_holds_up_to_its_static_torque() -> None:
    """2 N at 0.23 m on a joint of 0.3 N m: it slides, unless eq. 2.12's hump raises what holds to twice that."""
    t = np.arange(0.0, 0.02, 2e-4)
    values = FREE | {"key.joint_friction.A": 0.3, "key.joint_friction.B2": 1.0}
    turned = [
        np.ptp(simulate(ACTION.with_values(values | {"key.joint_friction.B1": b1}), t, np.full(len(t), 2.0), 2e-5)
               .solution.angle_rad[:, 0])
        for b1 in (0.0, 1.78)
    ]  # fmt: skip
    assert turned[0] > 1e-3 and turned[1] < 1e-9


def test_a_coarse_table_is_compared_by_what_happens_between_its_rows() -> None:
    """Rows of the table alone, 20 ms apart, gave a strike up to as far off."""
    t, f = np.array([0.0, 0.02, 0.04, 0.06, 0.08]), np.array([0.0, 20.0, 25.0, 25.0, 25.0])
    fine = model.output_times(0.0, 0.08, 5000.0)
    coarse, every = (compare(ACTION, *table, (1e-3,), step_s=2e-5) for table in ((t, f), (fine, np.interp(fine, t, f))))
    for one, other in zip(coarse.measures, every.measures, strict=True):
        assert 0.02 < one.strike_s == pytest.approx(other.strike_s, abs=1e-7)
        assert one.strike_m_per_s == pytest.approx(other.strike_m_per_s, rel=1e-5)


def test_a_string_has_as_many_modes_in_the_march_as_beside_it(monkeypatch: pytest.MonkeyPatch) -> None:
    def marched(action: model.Action, *_: object) -> None:
        raise model.ModelError(f"{action['string.modes']:g} modes")

    monkeypatch.setattr("model.stick_slip.limit.simulate", marched)
    with pytest.raises(
        model.ModelError, match="100 modes"
    ):  # what `model.simulate` takes at the tolerance of the limit
        compare(model.load_scene("string").on(ACTION), [0.0, 0.1], [0.0, 0.0])
