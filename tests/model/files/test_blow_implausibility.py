"""A force table that cannot be a blow is told from one that can, by duration, rise and peak."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import model
from model.files.force_library import KNOTS

PRESS = np.array([0.0, 0.01, 0.15]), np.array([0.0, 7.0, 7.0])


@pytest.mark.parametrize(
    ("scale_s", "scale_n", "words"),
    [
        (1e3, 1.0, "pressed for 149 s without a pause, blows up to 10 s; are its times in ms? give s"),
        (1e-3, 1.0, "pressed for 0.149 ms, blows from 2 ms; are its times in s?"),
        (1.0, 101.97, "largest force 714 N, blows up to 300 N; is the force in N?"),
        (1.0, 1e-3, "largest force 0.007 N, a key needs 0.2 N or more; is the force in N?"),
        (1.0, -1.0, "the force never presses (largest 0 N, smallest -7 N); down is positive"),
    ],
)
def test_a_table_in_another_unit_is_named(scale_s: float, scale_n: float, words: str) -> None:
    said = model.blow_implausibility(scale_s * PRESS[0], scale_n * PRESS[1] + 0.0, "f.csv")
    assert said == f"f.csv: cannot be a blow: {words}"


def test_a_rise_of_seconds_is_named() -> None:
    said = model.blow_implausibility([0.0, 5.0, 6.0, 7.0], [0.0, 5.0, 0.0, 0.0])
    assert "the force takes 4 s to rise, blows up to 2 s" in said


def test_repeated_blows_may_last() -> None:
    time_s = np.linspace(0.0, 60.0, 6001)
    assert model.blow_implausibility(time_s, 4.0 * np.sin(np.pi * 2.0 * time_s) ** 2) == ""


@pytest.mark.parametrize("name", KNOTS)
def test_library_blows_pass(name: str) -> None:
    assert model.blow_implausibility(*model.force_table(name)) == ""


@given(rise_s=st.floats(1e-3, 1.0), held_s=st.floats(0.02, 5.0), peak_n=st.floats(0.5, 100.0))
def test_real_blows_pass_and_milliseconds_do_not(rise_s: float, held_s: float, peak_n: float) -> None:
    time_s = np.array([0.0, 0.05, 0.05 + rise_s, 0.05 + rise_s + held_s, 0.1 + rise_s + held_s])
    force_n = peak_n * np.array([0.0, 0.0, 1.0, 0.8, 0.0])
    assert model.blow_implausibility(time_s, force_n) == ""
    assert "are its times in ms?" in model.blow_implausibility(1e3 * time_s, force_n)
