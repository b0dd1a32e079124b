"""Hammer height and key dip levels against the thesis's numbers."""

from __future__ import annotations

import numpy as np
import pytest

from validation import InputError
from validation.conventions import HAMMER, KEY
from validation.measurement.geometry import geometry_of, touch_dip


@pytest.fixture(scope="module")
def geometry():
    model = pytest.importorskip("model")
    action = model.load_action("hirschkorn2004")
    return geometry_of(action, model.rest_state(action).angle_rad)


def circle_under_string_m(theta):
    """Hand calculation from Tables A.2 and A.3: circle Ph4 about pivot Pg3 under the string line."""
    return 0.1706 - (0.1166 - 0.1321 * np.sin(theta) + 0.0356 * np.cos(theta) + 0.0102)


def test_hammer_height_is_that_of_the_circle_under_the_string(geometry):
    theta = np.array([0.2950879164, 0.1, -0.0626])
    angle = geometry.absolute({HAMMER: theta - geometry.rest_angle_rad[HAMMER]})
    np.testing.assert_allclose(geometry.hammer_height_m(angle), circle_under_string_m(theta), atol=1e-12)
    assert geometry.rest_height_m == pytest.approx(0.048157, abs=1e-6)


def test_the_key_touches_its_felt_at_the_dip_of_the_regulation_table(geometry):
    assert geometry.key_touch_dip_m == pytest.approx(9.34e-3, abs=0.01e-3)


def test_bodies_that_were_not_measured_stay_at_rest(geometry):
    angle = geometry.absolute({KEY: np.array([0.0, -0.01])})
    np.testing.assert_array_equal(angle[0], geometry.rest_angle_rad)
    assert geometry.key_dip_m(angle)[1] > 0
    assert geometry.hammer_height_m(angle)[1] == pytest.approx(geometry.rest_height_m)


def test_sensitivity_is_the_derivative(geometry):
    expected = 0.1321 * np.cos(0.2950879164) + 0.0356 * np.sin(0.2950879164)
    assert geometry.sensitivity(geometry.hammer_height_m, HAMMER) == pytest.approx(expected, rel=1e-6)
    assert geometry.sensitivity(geometry.hammer_height_m, KEY) == 0.0


@pytest.mark.parametrize("gap", [lambda angle: angle[:, KEY] * 0 + 1.0, lambda angle: angle[:, KEY] - 0.5])
def test_a_key_front_that_never_or_always_touches_is_refused(gap):
    with pytest.raises(InputError, match="gap under the key front"):
        touch_dip(np.zeros(5), lambda angle: -0.2 * angle[:, KEY], gap)
