"""Derivatives of a blow against converged differences, their events and forces, and what is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import model
from model.sensitivity import EVENTS
from model.sensitivity.tangents import input_kinks
from tests.model.sensitivity.richardson import Blow, changed, relative_error, richardson

# geometry, felt, friction, mass, spring, damping, gravity; of each contact that a forte touches early, and of none
# with a step of differences: small beside what felt is pressed in, large beside the error of a run
STEPS = {
    "hammer.mass": 1e-6, "contact02": 1e-4, "friction": 1e-4, "contact07.second.x": 2e-7, "hammer.pivot.x": 2e-7,
    "jack_spring.torque": 4e-7, "contact01.normal.D": 3e-3, "gravity.g": 1e-3,
}  # fmt: skip
NAMES = tuple(STEPS)
END_S = 0.125  # after strike, rebound and the first touch of the back check


def cut(blow: Blow, end: float) -> Blow:
    time, force = blow
    keep = time <= end
    return time[keep], force[keep]


@pytest.fixture(scope="module")
def forte() -> Blow:
    return cut(model.force_table("forte"), END_S)


@pytest.fixture(scope="module")
def found(action: model.Action, forte: Blow) -> model.Sensitivities:
    return model.sensitivities(action, forte, NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_angles_agree_with_converged_differences(
    action: model.Action, forte: Blow, found: model.Sensitivities, name: str
) -> None:
    limit, left = richardson(action, forte, name, STEPS[name])
    assert left < 2e-4  # the differences have converged, so that the tangents are what is tested
    error = relative_error(found.d_angles[:, :, NAMES.index(name)], limit)
    assert error < 3e-5


def test_the_blow_itself_is_that_of_simulate(action: model.Action, forte: Blow, found: model.Sensitivities) -> None:
    solution = model.simulate(action, *forte, tolerance=1e-9, method="rodas5p")
    assert np.max(np.abs(solution.angle_rad - found.angles_rad)) < 1e-6
    assert found.angle_names == solution.bodies
    np.testing.assert_array_equal(found.time_s, forte[0])


def test_rest_state_moves_with_its_parameters(action: model.Action, found: model.Sensitivities) -> None:
    for j, name in enumerate(NAMES):
        h = 1e-7 if name.endswith((".x", ".y")) else 1e-5 * found.values[j]
        ends = [model.rest_state(changed(action, name, s * h)).angle_rad for s in (1.0, -1.0)]
        np.testing.assert_allclose(found.d_rest[:, j], (ends[0] - ends[1]) / (2.0 * h), rtol=1e-5, atol=1e-6)
        np.testing.assert_allclose(found.d_angles[0, :, j], found.d_rest[:, j], rtol=0.0, atol=0.0)
    assert np.max(np.abs(found.d_rest[:, NAMES.index("hammer.pivot.x")])) > 1.0
    assert not np.any(found.d_rest[:, NAMES.index("friction")])  # nothing rubs at rest


def test_rest_under_a_preload(action: model.Action) -> None:
    time = np.linspace(0.0, 0.01, 11)
    options = model.SensitivityOptions(rest_input=1.0)
    found = model.sensitivities(action, (time, np.ones(11)), ["contact01"], options=options)
    ends = [
        model.rest_state(model.scale_parameters(action, {"contact01": 1.0 + s * 1e-5}), force_n=1.0).angle_rad
        for s in (1.0, -1.0)
    ]
    np.testing.assert_allclose(found.d_rest[:, 0], (ends[0] - ends[1]) / 2e-5, rtol=1e-5, atol=1e-9)
    # under the same force it stays there, and so do its derivatives
    np.testing.assert_allclose(found.d_angles[-1], found.d_rest, rtol=1e-6, atol=1e-9)


def test_events_agree_with_differences(action: model.Action, forte: Blow, found: model.Sensitivities) -> None:
    happen = [name for name in EVENTS if name not in found.absent_events]
    assert {"onset_s", "key_bottom_s", "let_off_s", "let_off_m", "strike_s", "strike_m_per_s", "check_s"} <= {*happen}
    options = model.SensitivityOptions(tolerance=1e-10)
    for name in ("friction", "hammer.pivot.x"):
        j = NAMES.index(name)
        h = 1e-7 if found.units[j] == "m" else 1e-5
        ends = [
            model.sensitivities(changed(action, name, s * h), forte, ["hammer.mass"], options=options).events
            for s in (1.0, -1.0)
        ]
        for event in happen:
            difference = (ends[0][event] - ends[1][event]) / (2.0 * h)
            assert found.d_events[event][j] == pytest.approx(difference, rel=2e-4), (name, event)


def test_where_the_hammer_is_held_moves_with_the_hold(action: model.Action) -> None:
    """`check_m` is read half-way through the hold, whose ends move with the parameter."""
    blow, step = cut(model.force_table("forte"), 0.45), 2e-6
    options = model.SensitivityOptions(tolerance=1e-10, relative_tolerance=1e-7, output_time_s=[0.45])
    found, *ends = (
        model.sensitivities(changed(action, "hammer.mass", by), blow, ["hammer.mass"], options=options)
        for by in (0.0, step, -step)
    )
    for event in ("check_s", "check_m", "drop_s"):
        difference = (ends[0].events[event] - ends[1].events[event]) / (2.0 * step)
        assert found.d_events[event][0] == pytest.approx(difference, rel=3e-5), event


def test_the_front_of_a_key_that_lifts_lands_where_its_felt_is_touched(action: model.Action, forte: Blow) -> None:
    options = model.SensitivityOptions(scene="lifting-key-flexible-shank", contact_forces=True)
    found = model.sensitivities(action, forte, ["key.mass"], options=options)
    assert found.contact_forces is not None
    pressed = np.flatnonzero(found.contact_forces[:, found.contact_names.index("contact02")] > 0.0)[0]
    assert found.time_s[pressed - 1] <= found.events["key_bottom_s"] < found.time_s[pressed]


def test_events_that_do_not_happen_say_why(found: model.Sensitivities, action: model.Action) -> None:
    assert found.absent_events == {"check_m": "the hammer is not held", "drop_s": "the hammer is not held"}
    assert np.isnan(found.events["check_m"]) and np.all(np.isnan(found.d_events["drop_s"]))
    time = np.linspace(0.0, 0.05, 51)
    soft = model.sensitivities(action, (time, np.interp(time, [0, 0.05], [0, 0.2])), ["key.mass"])
    assert set(soft.absent_events) == set(EVENTS)
    assert soft.absent_events["strike_s"] == "the hammer does not reach the string"


def test_contact_forces_agree_with_differences(action: model.Action, forte: Blow) -> None:
    names = ["contact12", "key.pivot.y"]
    found = model.sensitivities(action, forte, names, options=model.SensitivityOptions(contact_forces=True))
    assert found.d_contact_forces is not None and found.contact_forces is not None
    for j, (name, h) in enumerate(zip(names, (1e-5, 1e-8), strict=True)):
        ends = [
            model.simulate(
                changed(action, name, s * h), *forte, contact_forces=True, tolerance=1e-11, method="rodas5p"
            ).contact_normal_n
            for s in (1.0, -1.0)
        ]
        assert ends[0] is not None and ends[1] is not None
        difference = (ends[0] - ends[1]) / (2.0 * h)
        apart = np.abs(found.d_contact_forces[:, :, j] - difference)
        # samples next to where a contact opens or closes stand on a kink
        assert np.quantile(apart / np.max(np.abs(difference)), 0.999) < 1e-3, name


def test_a_law_or_a_pattern_is_the_sum_of_its_values(action: model.Action, forte: Blow) -> None:
    short = cut(forte, 0.11)
    paths = [f"contact{i:02d}.friction.A" for i in (1, 7)]
    options = model.SensitivityOptions(allow_idle=True, output_time_s=short[0][::20])
    every = [f"contact{i:02d}.friction.A" for i in range(1, 14)]
    single = model.sensitivities(action, short, every, options=options)
    law = model.sensitivities(action, short, ["friction"], options=options)
    total = single.d_angles @ single.values
    assert np.max(np.abs(total - law.d_angles[:, :, 0])) < 1e-5 * np.max(np.abs(total))
    assert not {*paths} & {*single.idle} and "contact10.friction.A" in single.idle
    felt = model.sensitivities(action, short, ["felt:contact01"], options=options)
    alone = model.sensitivities(action, short, ["contact01"], options=options)
    np.testing.assert_array_equal(felt.d_angles, alone.d_angles)


@pytest.mark.parametrize(
    ("names", "words"),
    [
        (["hammer.mas"], r"hammer\.mas: no such .*did you mean hammer\.mass"),
        (["fricton"], "fricton: no such .*did you mean friction"),
        (["shank.frequency_hz"], r"shank\.frequency_hz: no effect in this scene"),
        (["hammer.mass", "hammer.mass"], r"hammer\.mass found twice"),
        ([], "found none"),
        ("friction", "found the text 'friction'"),
        (["contact12.friction.B1", "hammer.mass"], r"contact12\.friction\.B1: does nothing in this blow"),
        (["contact12"], "contact12: does nothing in this blow"),
        (["hammer.parent"], r"hammer\.parent: is fixed by the geometry .it says 'ground'"),
        (["contact07.second.shape"], r"contact07\.second\.shape: is fixed by the geometry .it says 'hybrid'"),
    ],
)
def test_names_that_cannot_be_used(action: model.Action, forte: Blow, names: list[str], words: str) -> None:
    with pytest.raises(model.InputError, match=words):
        model.sensitivities(action, cut(forte, 0.09), names)


def test_an_element_that_is_off_has_no_derivative(action: model.Action, forte: Blow) -> None:
    off = action.with_values({"contact12": 0.0})
    with pytest.raises(model.InputError, match=r"contact12\.normal\.c: its element is switched off"):
        model.sensitivities(off, cut(forte, 0.09), ["contact12.normal.c"])
    with pytest.raises(model.InputError, match="a factor on them changes nothing"):
        model.sensitivities(off, cut(forte, 0.09), ["contact12"])


def test_a_contact_that_just_touches_at_rest_is_named() -> None:
    regulated = model.load_action("hirschkorn2004-regulated")
    time = np.linspace(0.0, 0.01, 11)
    assert model.sensitivities(regulated, (time, np.ones(11)), ["key.mass"]).at_kink == ("contact10",)


def test_estimated_error_is_near_the_error(action: model.Action, forte: Blow, found: model.Sensitivities) -> None:
    options = model.SensitivityOptions(tolerance=1e-6, relative_tolerance=1e-4, estimate_error=True)
    rough = model.sensitivities(action, forte, ["hammer.mass", "friction"], options=options)
    truth = found.d_angles[:, :, [NAMES.index("hammer.mass"), NAMES.index("friction")]]
    size = np.max(np.abs(truth), axis=0)
    error = float(np.max(np.max(np.abs(rough.d_angles - truth), axis=0) / size))
    assert 0.3 * error < rough.estimated_error < 3.0 * error


def test_a_contact_on_the_verge_at_rest_does_not_make_steps_small() -> None:
    regulated = model.load_action("hirschkorn2004-regulated")
    options = model.SensitivityOptions(events=False, allow_idle=True)
    names = ["contact07.second.x", "hammer.pivot.x", "friction"]
    found = model.sensitivities(regulated, cut(model.force_table("forte"), 0.1), names, options=options)
    assert found.counters["n_tangent_steps"] + found.counters["n_tangent_rejected"] < 10_000


def test_a_motion_of_too_many_steps_ends(action: model.Action, forte: Blow, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("model.simulation.run.STEPS_AT_LEAST", 500)
    monkeypatch.setattr("model.simulation.run.STEPS_PER_SECOND", 0)
    monkeypatch.setattr("model.sensitivity.tangents.ROWS", 100)  # the limit is of all parts of the record together
    with pytest.raises(model.IntegrationError, match="too many steps"):
        model.sensitivities(action, forte, ["hammer.mass"])


def test_a_kink_of_the_force_in_a_quiet_phase_is_not_stepped_over(action: model.Action) -> None:
    time = np.linspace(0.0, 0.4, 2001)
    force = np.interp(time, [0.0, 0.02, 0.06, 0.3, 0.32], [0.0, 0.5, 4.0, 4.0, 0.0])
    exact = model.SensitivityOptions(tolerance=1e-10, relative_tolerance=1e-7, events=False)
    usual = model.SensitivityOptions(events=False)
    truth, found = (
        model.sensitivities(action, (time, force), ["key.inertia", "contact01"], options=o) for o in (exact, usual)
    )
    for j in range(2):
        assert relative_error(found.d_angles[:, :, j], truth.d_angles[:, :, j]) < 1e-5


def test_the_strongest_kinks_of_an_input() -> None:
    time = np.linspace(0.0, 1.0, 101)
    plain = np.interp(time, [0.0, 0.2, 0.5, 1.0], [0.0, 1.0, 1.0, 0.0])
    np.testing.assert_allclose(input_kinks(time, plain)[np.argsort(input_kinks(time, plain)[:, 0])][:, 0], [0.2, 0.5])
    assert input_kinks(time, np.random.default_rng(0).normal(size=101)).shape == (50, 2)
    assert input_kinks(time[:2], plain[:2]).shape == (0, 2) and input_kinks(time, time).shape == (0, 2)


def test_inputs_beside_parameters_agree_with_differences(action: model.Action) -> None:
    """A part of the force that comes and goes, and one that is there at rest, too."""
    time = np.linspace(0.0, 0.06, 301)
    force = np.interp(time, [0.0, 0.01, 0.05], [0.3, 0.3, 8.0])
    changes = np.column_stack([np.interp(time, [0.02, 0.03, 0.035], [0.0, 1.0, 0.0]), np.ones(time.size)])
    options = model.SensitivityOptions(rest_input=0.3, events=False, tolerance=1e-9)
    rest = np.array([0.0, 1.0])
    found = model.sensitivities(action, (time, force), ["hammer.mass"], options=options, inputs=(changes, rest))
    assert found.parameters == ("hammer.mass", "input 1", "input 2") and found.idle == ()
    alone = model.sensitivities(action, (time, force), ["hammer.mass"], options=options)
    np.testing.assert_allclose(
        found.d_angles[:, :, 0], alone.d_angles[:, :, 0], atol=1e-5 * np.abs(alone.d_angles).max()
    )
    for i in range(2):
        ends = []
        for sign in (1.0, -1.0):
            moved = replace(options, rest_input=options.rest_input + sign * 1e-4 * rest[i])
            ends.append(
                model.sensitivities(action, (time, force + sign * 1e-4 * changes[:, i]), ["hammer.mass"], options=moved)
            )
        difference = (ends[0].angles_rad - ends[1].angles_rad) / 2e-4
        assert relative_error(found.d_angles[:, :, 1 + i], difference) < 1e-3
        np.testing.assert_allclose(
            found.d_rest[:, 1 + i], (ends[0].rest_rad - ends[1].rest_rad) / 2e-4, rtol=1e-4, atol=1e-9
        )


def test_inputs_of_another_shape_are_refused(action: model.Action) -> None:
    time = np.linspace(0.0, 0.01, 11)
    with pytest.raises(
        model.InputError, match=r"inputs: found changes of shape \(10, 1\), \(1,\) at rest, allowed \(11, m\) and"
    ):
        model.sensitivities(action, (time, np.ones(11)), [], inputs=(np.ones((10, 1)), np.ones(1)))
