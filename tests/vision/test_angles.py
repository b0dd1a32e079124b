"""The sign of angles and axes turns once."""

from __future__ import annotations

import numpy as np
import pytest

from vision import ccw_to_picture, ground_to_picture, picture_to_ccw
from vision.angles import relative_angle


def test_signs_of_angles_and_axes() -> None:
    assert picture_to_ccw(0.25) == -0.25 and ccw_to_picture(-0.5) == 0.5
    np.testing.assert_allclose(ground_to_picture([[0.01, 0.02]], 1000.0, (5.0, 50.0)), [[15.0, 30.0]])
    angle, u = relative_angle(
        np.array([0.3, np.nan]), np.array([0.1, 0.1]), np.array([3e-4, 1.0]), np.array([4e-4, 1.0])
    )
    assert angle[0] == pytest.approx(0.2) and u[0] == pytest.approx(5e-4) and np.isnan(angle[1])
