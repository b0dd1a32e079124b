"""Weights of an action: against closed-form changes, virtual work by other equations, and where something jams."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import pytest

import model
from model.touch import Weights, weigh

SETS = ("hirschkorn2004", "hirschkorn2004-regulated")
LEVER = 0.2278  # m, of the force at the key front
MIDDLE = (0.25, 0.60)  # of the dip


@pytest.fixture(scope="module")
def weights(regulated: model.Action) -> Weights:
    return weigh(regulated)


def test_weights_are_those_of_a_grand(weights: Weights) -> None:
    assert 0.40 < weights.down_n < 0.50 and 0.12 < weights.up_n < 0.22  # 45 g and 17 g
    assert weights.friction_n == pytest.approx(0.5 * (weights.down_n - weights.up_n))
    assert weights.let_off_n > 1.5 * weights.down_n


def test_friction_of_the_key_pin_adds_its_torque_over_the_lever(regulated: model.Action, weights: Weights) -> None:
    more = 0.005  # N m
    other = weigh(regulated.with_values({"key.joint_friction.A": regulated["key.joint_friction.A"] + more}))
    # at 5 mm/s the smoothed law gives tanh(omega / omega_t) of it
    share = math.tanh(0.005 / 0.2278 / regulated["friction_threshold.omega_t"])
    assert other.friction_n - weights.friction_n == pytest.approx(share * more / 0.2278, abs=0.0015)


def test_lead_in_the_key_lowers_both_weights_by_its_moment(regulated: model.Action, weights: Weights) -> None:
    lead = 0.010  # kg at the key's centre of mass, 51.4 mm in front of the pin
    other = weigh(regulated.with_values({"key.mass": regulated["key.mass"] + lead}))
    less = lead * 9.81 * 0.0514 / 0.2278
    assert weights.down_n - other.down_n == pytest.approx(less, abs=0.002)
    assert weights.up_n - other.up_n == pytest.approx(less, abs=0.002)


def test_curve_goes_down_and_up(weights: Weights) -> None:
    (down, force), (up, force_up) = weights.curve()
    assert np.all(np.diff(down) > 0.0) and np.all(np.diff(up) < 0.0)
    assert down[-1] == pytest.approx(0.010, abs=2e-4) and up[-1] < 2e-4
    assert np.interp(3e-3, down, force) > np.interp(-3e-3, -up, force_up) + 0.15
    assert force.max() == pytest.approx(weights.let_off_n)


def with_friction(name: str, share: float) -> model.Action:
    """A built-in set with all friction of contacts and joints scaled."""
    action = model.load_action(name)
    paths = [f"{b}.joint_friction.A" for b in model.BODIES] + [f"contact{i:02d}.friction.A" for i in range(1, 14)]
    return action.with_values({path: share * action[path] for path in paths})


def potential_j(action: model.Action, angle_rad: Mapping[str, float]) -> float:
    """Energy of weight and of the two springs at angles of the bodies, from the parameters alone."""
    at = {"ground": (0j, 0.0)}
    energy = 0.0
    for body in model.BODIES:
        pivot, turned = at[action.structure[f"{body}.parent"]]
        pivot += complex(action[f"{body}.pivot.x"], action[f"{body}.pivot.y"]) * np.exp(1j * turned)
        turned += angle_rad[body]
        at[body] = pivot, turned
        own = complex(action[f"{body}.center_of_mass.x"], action[f"{body}.center_of_mass.y"])
        energy += action[f"{body}.mass"] * action["gravity.g"] * (pivot + own * np.exp(1j * turned)).imag
    for body in ("jack", "repetition"):
        torque, stiffness, free = (action[f"{body}_spring.{k}"] for k in ("torque", "stiffness", "angle"))
        turned = angle_rad[body]
        energy += 0.5 * stiffness * (turned - free) ** 2 - torque * turned
    return energy


def virtual_work_n(action: model.Action, weights: Weights) -> float:
    """What weight and springs take along the way down, over the way, N; felt stores next to nothing more there."""
    press = weights.press
    inside = (press.dip_m > MIDDLE[0] * weights.dip_m) & (press.dip_m < MIDDLE[1] * weights.dip_m) & (press.leg == 0)
    ends = np.flatnonzero(inside)[[0, -1]]
    first, last = (potential_j(action, dict(zip(model.BODIES, press.angle_rad[k].tolist(), strict=True))) for k in ends)
    return (last - first) / float(press.dip_m[ends[1]] - press.dip_m[ends[0]])


@pytest.mark.parametrize("name", SETS)
def test_without_friction_all_weights_are_virtual_work(name: str) -> None:
    action = with_friction(name, 0.0)
    found = weigh(action)
    expected = virtual_work_n(action, found)
    assert [found.balance_n, found.down_n, found.up_n] == pytest.approx([expected] * 3, rel=0.005)
    assert found.friction_n == pytest.approx(0.0, abs=1e-4)  # 0.01 g
    assert found.friction_n == pytest.approx(0.0, abs=4.0 * found.u_friction_n + 1e-6)
    assert max(found.u_down_n, found.u_up_n, found.u_balance_n) < 1e-3


@pytest.mark.parametrize("name", SETS)
def test_balance_does_not_hang_on_friction(name: str) -> None:
    expected = virtual_work_n(without := with_friction(name, 0.0), weigh(without))
    assert weigh(model.load_action(name)).balance_n == pytest.approx(expected, rel=0.005)


@pytest.mark.parametrize("name", SETS)
def test_friction_weight_is_in_proportion_to_friction(name: str) -> None:
    whole = weigh(model.load_action(name)).friction_n
    for share in (0.05, 0.5):
        assert weigh(with_friction(name, share)).friction_n == pytest.approx(share * whole, rel=0.04)


@pytest.mark.parametrize(("name", "grams", "newtons"), [(SETS[0], 20, 1.2), (SETS[1], 30, 2.5)])
def test_a_jam_is_named_and_not_weighed(name: str, grams: float, newtons: float) -> None:
    found = weigh(model.load_action(name).with_values({"hammer.mass": 1e-3 * grams}))
    assert found.let_off_n == pytest.approx(newtons, rel=0.07)
    (jam,) = (remark for remark in found.remarks if remark.startswith("jam: "))
    assert (
        "back check (contact04) presses with" in jam and "mm of dip" in jam and jam.endswith("not weighed as let-off")
    )


def test_where_something_jams_in_the_middle_nothing_is_weighed(regulated: model.Action) -> None:
    """The wire 3.7 mm nearer presses on the hammer over the whole of the dip."""
    found = weigh(regulated.with_values({"contact04.second.x": -0.2155}))
    assert math.isnan(found.down_n) and math.isnan(found.up_n) and math.isnan(found.let_off_n)
    assert any(r.startswith("down weight: jam, back check (contact04)") for r in found.remarks)


def test_a_jack_that_does_not_let_go_has_no_let_off_peak(regulated: model.Action) -> None:
    found = weigh(regulated.with_values({"contact08.second.y": 0.2}))
    assert math.isnan(found.let_off_n)
    assert "let-off peak: the jack does not let go before the key is down" in found.remarks


def test_a_weight_in_the_let_off_is_not_steady(regulated: model.Action) -> None:
    """The button so low that the jack sticks and slips on it in the middle of the dip."""
    found = weigh(regulated.with_values({"contact08.second.y": 0.06}))
    assert any(r.startswith("down weight: not steady, the press oscillates; u 0.0") for r in found.remarks)


def test_balance_in_a_scene(regulated: model.Action, weights: Weights) -> None:
    """A key that lifts and gives moves by what its front is led: joints give some 10 um."""
    giving = model.load_scene("giving-joints").on(regulated)
    assert weigh(giving).balance_n == pytest.approx(weights.balance_n, rel=0.01)
