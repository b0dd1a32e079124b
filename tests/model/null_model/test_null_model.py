"""The null model against energies, closed forms and the five-body model it is the yardstick of."""

from __future__ import annotations

import numpy as np
import pytest

import model
from model import null_model
from model.null_model import run as null_run
from model.null_model.reduction import HAMMER, KEY
from model.parameters.action import CONTACTS
from tests.model.conftest import read_table
from tests.model.verification.reference_equations import Twin

FRICTIONLESS = {
    **{f"{c}.friction.A": 0.0 for c in CONTACTS},
    **{f"{c}.normal.D": 0.0 for c in CONTACTS},
    **{f"{b}.joint_friction.A": 0.0 for b in model.BODIES},
}


@pytest.fixture(scope="module")
def smooth(action: model.Action) -> model.Action:
    return action.with_values(FRICTIONLESS)


KEPT: dict[str, null_model.Reduced] = {}


def reduction(action: model.Action) -> null_model.Reduced:
    """What `null_model.simulate` reduces an action to; kept, for it takes a second."""
    if action.content() not in KEPT:
        KEPT[action.content()] = null_model.reduce_action(action)
    return KEPT[action.content()]


@pytest.fixture(scope="module")
def reduced(smooth: model.Action) -> null_model.Reduced:
    return reduction(smooth)


def heights(action: model.Action, reduced: null_model.Reduced, solution: model.Solution) -> np.ndarray:
    return reduced.up * (solution.angle_rad[:, HAMMER] - reduced.rest_rad[HAMMER])


def test_pull_is_the_slope_of_the_stored_energy(smooth: model.Action, reduced: null_model.Reduced) -> None:
    scene = model.build_scene(smooth)
    for path, start, end in ((reduced.joined, 0.001, reduced.let_off - 1e-3), (reduced.away, -0.002, 0.042)):
        part = (reduced.sigma > start) & (reduced.sigma < end)
        states = path.angle_rad[part]
        still = (model.Simulation(scene, model.State(0.0, q, np.zeros(5)), energy=True) for q in states)
        stored = np.array([run.stored_energy() for run in still])
        pull = path.pull[part]
        work = np.concatenate([[0.0], np.cumsum(0.5 * (pull[1:] + pull[:-1]) * np.diff(reduced.sigma[part]))])
        np.testing.assert_allclose(stored - stored[0], -work, atol=2e-3 * np.ptp(stored))


def test_mass_is_the_kinetic_energy_of_all_bodies(smooth: model.Action, reduced: null_model.Reduced) -> None:
    twin = Twin(smooth)
    for i in np.flatnonzero((reduced.sigma > 0.001) & (reduced.sigma < 0.025))[::20]:
        before, after = reduced.joined.angle_rad[i - 1], reduced.joined.angle_rad[i + 1]
        turn = (after - before) / (reduced.sigma[i + 1] - reduced.sigma[i - 1])
        _, mass = twin.forces_and_mass(reduced.joined.angle_rad[i], np.zeros(5), 0.0)
        assert reduced.joined.mass[i] == pytest.approx(turn @ mass @ turn, rel=1e-9)
    # the hammer, geared up about 9.5 to 1, is most of what a finger feels
    rest = int(np.argmin(np.abs(reduced.sigma - 0.01)))
    assert reduced.joined.mass[rest] - reduced.away.mass[rest] == pytest.approx(
        reduced.hammer_inertia * reduced.joined.ratio[rest, HAMMER] ** 2, rel=0.01
    )


def test_frictionless_blow_keeps_its_energy(smooth: model.Action, reduced: null_model.Reduced) -> None:
    time = np.linspace(0.0, 0.2, 4001)
    blow = null_model.simulate(smooth, [0.0, 0.2], [5.0, 5.0], output_time_s=time)
    sigma = reduced.rest_rad[KEY] - blow.angle_rad[:, KEY]
    riding = (sigma > 2e-3) & (sigma < reduced.let_off - 1e-3) & (np.arange(len(time)) < np.argmax(sigma))
    push = reduced.joined.pull + 5.0 * reduced.joined.lever
    work = np.concatenate([[0.0], np.cumsum(0.5 * (push[1:] + push[:-1]) * np.diff(reduced.sigma))])
    gained = np.interp(sigma, reduced.sigma, work) - np.interp(0.0, reduced.sigma, work)
    mass = np.interp(sigma, reduced.sigma, reduced.joined.mass)
    assert riding.sum() > 300
    np.testing.assert_allclose((0.5 * mass * blow.speed_rad_per_s[:, KEY] ** 2)[riding], gained[riding], rtol=2.5e-3)


def test_hammer_flies_and_rebounds_as_a_ballistic_pendulum(smooth: model.Action, reduced: null_model.Reduced) -> None:
    time = np.linspace(0.0, 0.2, 4001)
    blow = null_model.simulate(smooth, [0.0, 0.2], [5.0, 5.0], output_time_s=time)
    phi, omega = heights(smooth, reduced, blow), reduced.up * blow.speed_rad_per_s[:, HAMMER]
    sigma = reduced.rest_rad[KEY] - blow.angle_rad[:, KEY]
    hit = int(np.argmax(phi))
    flying = np.arange(np.flatnonzero(sigma > reduced.let_off)[0] + 2, hit - 1)
    assert len(flying) > 50
    angle = blow.angle_rad[:, HAMMER]
    x, y = smooth["hammer.center_of_mass.x"], smooth["hammer.center_of_mass.y"]
    energy = 0.5 * reduced.hammer_inertia * omega**2 + smooth["hammer.mass"] * smooth["gravity.g"] * (
        np.sin(angle) * x + np.cos(angle) * y
    )
    assert np.ptp(energy[flying]) < 1e-7 * energy[flying][0]
    # without damping nothing is lost at the string
    assert -omega[hit + 2] == pytest.approx(omega[hit - 2], rel=1e-3)
    assert phi.max() == pytest.approx(reduced.string_rad, abs=1e-9)
    touch = reduced.rest_rad.copy()
    touch[HAMMER] += reduced.up * reduced.string_rad
    assert abs(float(model.observables.hammer_height_m(smooth, touch[None])[0])) < 1e-9


def test_restitution_of_slow_impacts_is_hunt_and_crossleys_straight_line() -> None:
    assert null_model.restitution(1.0, 0.0) == 1.0
    assert null_model.restitution(1.0, 1e-3) == pytest.approx(1.0 - 2e-3 / 3.0, abs=1e-6)
    assert null_model.restitution(1e6, 10.0) < 1e-6


def test_key_stays_where_its_weight_is_carried(action: model.Action) -> None:
    """At rest, and half way down under the force that balances there, nothing moves."""
    still = null_model.simulate(action, [0.0, 0.3], [0.0, 0.0], output_time_s=[0.0, 0.3])
    np.testing.assert_allclose(still.angle_rad[1], still.angle_rad[0], atol=1e-5)
    np.testing.assert_allclose(still.angle_rad[0], model.rest_state(action).angle_rad, atol=1e-9)
    reduced = reduction(action)
    i = int(np.argmin(np.abs(reduced.sigma - 0.012)))
    hold = -reduced.joined.pull[i] / reduced.joined.lever[i]
    start = model.RestState(model.BODIES, reduced.joined.angle_rad[i], (), np.zeros(0), np.zeros(0), 0.0)
    held = null_model.simulate(action, [0.0, 0.1], [hold, hold], output_time_s=[0.1], initial=start)
    np.testing.assert_allclose(held.angle_rad[0], start.angle_rad, atol=2e-5)


@pytest.mark.parametrize("name, blow", [("hirschkorn2004", "forte"), ("hirschkorn2004-regulated", "piano")])
def test_blow_is_near_the_five_bodies_until_the_string_and_caught_after_it(name: str, blow: str) -> None:
    """What a force-driven comparison cannot tell from five bodies; no parameter was fitted."""
    action = model.load_action(name)
    table = read_table(f"{blow}_force.csv")
    times = table[:, 0]
    null = null_model.simulate(action, times, table[:, 1])
    five = model.simulate(action, times, table[:, 1], tolerance=1e-4)
    assert null.bodies == five.bodies and null.angle_rad.shape == five.angle_rad.shape
    hits = [times[np.argmax(s.speed_rad_per_s[:, HAMMER] ** 2)] for s in (null, five)]
    peaks = [np.abs(s.speed_rad_per_s[:, HAMMER]).max() for s in (null, five)]
    assert hits[0] == pytest.approx(hits[1], abs=0.005)
    assert peaks[0] == pytest.approx(peaks[1], rel=0.1)
    for solution in (null, five):  # both are caught a good way above rest, and come back in the end
        after = (times > hits[1] + 0.05) & (times < hits[1] + 0.15)
        assert np.ptp(solution.angle_rad[after, HAMMER]) < 0.02
    rest = five.angle_rad[0]
    assert np.abs(null.angle_rad[-1] - rest).max() < 0.15


def test_step_is_small_enough(action: model.Action, monkeypatch: pytest.MonkeyPatch) -> None:
    table = read_table("forte_force.csv")
    at = np.linspace(0.0, 0.102, 50)  # until let-off; afterwards an event may fall into the neighbouring step
    coarse = null_model.simulate(action, table[:, 0], table[:, 1], output_time_s=at)
    monkeypatch.setattr(null_run, "STEP", null_run.STEP / 4)
    fine = null_model.simulate(action, table[:, 0], table[:, 1], output_time_s=at)
    assert np.abs(coarse.angle_rad - fine.angle_rad).max() < 2e-5  # the ratio of rest to ride changes within a step


def test_short_blow_lets_the_hammer_leave_before_let_off_and_land_again(smooth: model.Action) -> None:
    """Force taken away and turned round before let-off: the jack cannot pull the hammer back."""
    reduced = reduction(smooth)
    time = np.linspace(0.0, 0.12, 2401)
    blow = null_model.simulate(smooth, [0.0, 0.03, 0.0301, 0.12], [4.0, 4.0, -8.0, -8.0], output_time_s=time)
    sigma = reduced.rest_rad[KEY] - blow.angle_rad[:, KEY]
    assert sigma.max() < reduced.let_off
    ahead = heights(smooth, reduced, blow) - np.interp(
        sigma, reduced.sigma, reduced.up * (reduced.joined.angle_rad[:, HAMMER] - reduced.rest_rad[HAMMER])
    )
    assert ahead.min() > -1e-3 and ahead.max() > 0.02
    assert ahead[time < 0.03].max() < 1e-6


@pytest.mark.parametrize(
    "times, output, words",
    [([0.0, 0.0], None, "row 2"), ([0.0, 1.0], [0.5, 2.0], "within the table"), ([0.0, 1.0], [0.5, 0.1], "increasing")],
)
def test_bad_input_is_refused(action: model.Action, times: list[float], output: list[float] | None, words: str) -> None:
    with pytest.raises(model.InputError, match=words):
        null_model.simulate(action, times, [0.0, 0.0], output_time_s=output)


def test_actions_of_equal_content_share_one_reduction(action: model.Action, monkeypatch: pytest.MonkeyPatch) -> None:
    reduced: list[model.Action] = []
    kept = reduction(action)
    monkeypatch.setattr(null_run, "reduce_action", lambda given: reduced.append(given) or kept)
    for mass in (0.011, 0.011, 0.0111):  # of no other test
        null_model.simulate(action.with_values({"hammer.mass": mass}), [0.0, 0.01], [0.0, 0.0])
    assert [given["hammer.mass"] for given in reduced] == [0.011, 0.0111]


@pytest.mark.parametrize("name", ["hirschkorn2004", "hirschkorn2004-regulated"])
@pytest.mark.parametrize(
    "corners_s, corners_n",
    [
        ((0, 0.05, 0.35, 0.8, 0.9), (0, 0, 1.5, 1.5, 0)),  # pressed slowly past let-off: no impact, no check
        ((0, 0.1, 0.11, 0.16, 0.18, 0.24, 0.3, 0.6), (0, 8, 9, 9, 0, 0, 8, 0)),  # a second blow before the check
        ((0, 0.1, 0.103, 0.5, 0.7), (0, 0, 6, 1.2, 0)),
        ((0, 0.02, 0.08, 0.5), (0, 120, 0, 0)),
    ],
)
def test_hammer_and_key_stay_within_their_stops(
    name: str, corners_s: tuple[float, ...], corners_n: tuple[float, ...]
) -> None:
    action = model.load_action(name)
    reduced = reduction(action)
    time = np.linspace(0.0, 1.0, 5001)
    blow = null_model.simulate(action, time, np.interp(time, corners_s, corners_n))
    hammer = heights(action, reduced, blow)
    joined = reduced.up * (reduced.joined.angle_rad[:, HAMMER] - reduced.rest_rad[HAMMER])
    assert hammer.min() > -0.003 and hammer.max() <= reduced.string_rad + 1e-9
    sigma = reduced.rest_rad[KEY] - blow.angle_rad[:, KEY]
    assert sigma.min() > reduced.sigma[0] and sigma.max() < reduced.sigma[-1]
    # nothing holds the hammer up for ever, and nothing lets it through: the jack or the lever is under it
    assert np.all(hammer >= np.interp(sigma, reduced.sigma, joined) - 2e-3)


def test_hammer_that_misses_the_check_lies_on_the_lever_until_the_jack_is_back(action: model.Action) -> None:
    reduced = reduction(action)
    time = np.linspace(0.0, 1.2, 6001)
    force = np.interp(time, [0, 0.05, 0.35, 0.8, 0.9], [0, 0, 1.5, 1.5, 0])
    blow = null_model.simulate(action, time, force)
    hammer = heights(action, reduced, blow)
    held = (time > 0.7) & (time < 0.8)
    lever = reduced.up * (reduced.joined.angle_rad[-1, HAMMER] - reduced.rest_rad[HAMMER])
    np.testing.assert_allclose(hammer[held], lever, atol=1e-9)
    assert abs(hammer[-1]) < 0.01


def test_key_beyond_its_stops_is_an_error_not_a_number(action: model.Action) -> None:
    with pytest.raises(model.ModelError, match="cannot predict this blow: key turns .* its stops allow"):
        null_model.simulate(action, [0.0, 0.001, 0.5], [0.0, 900.0, 900.0])


@pytest.mark.parametrize("scene", ["lifting-key", "string"])
def test_the_yardstick_is_the_same_in_every_scene_a_force_drives(action: model.Action, scene: str) -> None:
    """It knows no effects: reports of these scenes had none, for a rest of six angles or rows of what is remembered."""
    times, force = [0.0, 0.05, 0.12, 0.3], [0.0, 6.0, 7.0, 0.0]
    of_scene = model.load_scene(scene).on(action)
    plain = null_model.simulate(action, times, force, output_time_s=np.linspace(0.0, 0.3, 61))
    found = null_model.simulate(of_scene, times, force, output_time_s=plain.time_s)
    np.testing.assert_array_equal(found.angle_rad, plain.angle_rad)
    rest = model.rest_state(of_scene, 0.39)
    begun = null_model.simulate(of_scene, times, force, output_time_s=plain.time_s, initial=rest)
    assert begun.angle_rad[0, KEY] == pytest.approx(rest.angle_rad[KEY], abs=1e-9)


def test_the_yardstick_has_one_law_and_says_what_it_cannot_follow(action: model.Action) -> None:
    felt = action.with_laws({"contact12": "stulov"}).with_values({"contact12.stulov.tau": 1e-4})
    np.testing.assert_array_equal(null_model.reduce_action(felt).sigma, reduction(action).sigma)
    for scene, words in (("motor-arm", "driven by torque_nm"), ("key-whippen", "found a scene of key, whippen driven")):
        with pytest.raises(model.InputError, match=words):
            null_model.simulate(model.load_scene(scene).on(action), [0.0, 0.1], [0.0, 1.0])
