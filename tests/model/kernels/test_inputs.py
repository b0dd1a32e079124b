"""The input table of a run: what kernels read of it around a jump."""

from __future__ import annotations

import numpy as np
import pytest

import model
from model.kernels.inputs import JUMP, interpolate_input
from model.kernels.signatures import InputTable

AT = 0.12


@pytest.mark.parametrize("apart", [1e-12, 5e-11, 1e-10])
@pytest.mark.parametrize("ends", [False, True])
def test_before_a_jump_and_behind_it_nothing_else_is_read(apart: float, ends: bool) -> None:
    """The line through both rows, carried on to the 1e-10 s before them, gave 800 N of a table from 0 to 8 N."""
    time, value = np.array([0.0, AT, AT + apart, 0.3]), np.array([2.0, 8.0, 1.0, 3.0])
    if ends:
        time, value = time[:-1], value[:-1]
    table, last = InputTable(time, value, False), len(time) - 1
    for start in range(last):  # wherever the search begins
        for share in np.linspace(-1.5, 0.9, 49):
            u, slope, k = interpolate_input(AT + share * JUMP, start, 0, last, table)
            assert abs(u - (8.0 if share < -1.0 else 1.0)) < 1e-6 and abs(slope) < 60.0, share
            assert 0 <= k < last


def test_a_jump_of_the_force_is_crossed_at_a_tight_tolerance() -> None:
    """The motion stopped there, and the message spoke of bodies that overlap."""
    action = model.load_action("hirschkorn2004-regulated")
    time, force = [0.1, 0.2, 0.25, 0.25 + 5e-11, 0.27], [0.0, 5.0, 12.0, 3.0, 3.0]
    ramp = [0.1, 0.2, 0.25, 0.25 + 1e-9, 0.27]
    found, other = (
        model.simulate(action, at, force, tolerance=1e-9, output_time_s=[0.2, 0.26, 0.27]) for at in (time, ramp)
    )
    np.testing.assert_allclose(found.angle_rad, other.angle_rad, rtol=0, atol=2e-8)
