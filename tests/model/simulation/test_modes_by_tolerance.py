"""Modes of a string that cannot matter at the requested tolerance are left out; a choir in tune."""

from __future__ import annotations

import numpy as np
import pytest

import model
from model.scene.string_terms import LEFT_OUT_ERROR, modes_asked

ACTION = model.load_action("hirschkorn2004-regulated")
FORTE = model.force_table("forte")
AT = np.linspace(0.0, 0.69, 691)


def played(modes: float, tolerance: float, blow: str = "forte", **keywords: bool) -> model.Solution:
    action = ACTION.with_effects({"string.modes": modes})
    table = model.force_table(blow)
    at = np.linspace(table[0][0], table[0][-1], 691)
    return model.simulate(action, *table, scene="string", tolerance=tolerance, output_time_s=at, **keywords)


def test_the_number_of_modes_follows_the_tolerance_and_is_said() -> None:
    counts = [modes_asked(ACTION, 10.0**-k) for k in (2, 3, 4, 5, 6, 9)]
    assert counts == [8, 8, 24, 75, 100, 100]
    assert played(0.0, 1e-4).counters["string_modes"] == 24
    assert played(12.0, 1e-4).counters["string_modes"] == 12  # asked for outright
    assert "string_modes" not in model.simulate(ACTION, *FORTE, output_time_s=AT[:2]).counters
    members = model.simulate_many(ACTION, {"forte": FORTE}, scene="string", tolerance=1e-3, output_time_s=AT[:2])
    assert members[0].solution is not None and members[0].solution.counters["string_modes"] == 8


def test_what_the_modes_left_out_are_worth_is_within_the_request_or_said() -> None:
    """Against all modes there are, at a tighter tolerance; the estimate knows what was left out."""
    exact = played(100.0, 1e-7)
    for tolerance in (1e-3, 1e-4):
        found = played(0.0, tolerance, estimate_error=True)
        error = float(np.max(np.abs(found.angle_rad - exact.angle_rad)))
        assert error < 10.0 * tolerance and found.error_rad is not None
        assert error < 1.5 * found.error_rad and not found.misses_tolerance
    # all modes there are: three quarters of the error is asked for, the estimate says what they cannot give
    assert played(0.0, 1e-7, estimate_error=True).misses_tolerance


def test_the_error_of_what_is_left_out_falls_with_the_square_of_their_number() -> None:
    exact = played(100.0, 1e-7)
    for modes in (10, 40):
        error = float(np.max(np.abs(played(modes, 1e-7).angle_rad - exact.angle_rad)))
        assert 0.5 * 0.055 < error * modes**2 < 1.4 * 0.055
        assert error * modes**2 < 3.0 * LEFT_OUT_ERROR


def test_a_choir_in_tune_is_one_string_of_its_weight() -> None:
    three = model.simulate(ACTION.with_effects({"string.unisons": 3}), *FORTE, scene="string", output_time_s=AT)
    heavy = {"string.mass": 3.0 * ACTION["string.mass"], "string.tension": 3.0 * ACTION["string.tension"]}
    one = model.simulate(ACTION.with_effects(heavy), *FORTE, scene="string", output_time_s=AT)
    assert np.array_equal(three.angle_rad, one.angle_rad)
    alone = model.simulate(ACTION, *FORTE, scene="string", output_time_s=AT)
    assert np.max(np.abs(three.angle_rad - alone.angle_rad)) > 1e-3
    with pytest.raises(model.InputError, match=r"string.unisons: found 4, allowed from 1 to 3"):
        ACTION.with_values({"string.unisons": 4})
