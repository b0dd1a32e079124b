"""How far a stroke lies from those fitted, and whether a rival is nearer."""

from __future__ import annotations

import math

import numpy as np
import pytest

from validation.statistics.domain import extract_features, locate_stroke
from validation.statistics.skill import compute_skill, describe_skills

TIME_S = np.arange(0.0, 2.0, 2e-4)


def stroke(rise_s=0.03, hold_s=0.3, fall_s=0.06, depth=0.01, notes=1, peak_n=20.0):
    at, value = [0.1], [0.0]
    for _ in range(notes):
        for length, to in ((rise_s, depth), (hold_s, depth), (fall_s, 0.0), (0.05, 0.0)):
            at.append(at[-1] + length)
            value.append(to)
    key = np.interp(TIME_S, at, value)
    return extract_features(TIME_S, key, "rad", peak_n * key / depth)


FITTED = {"soft": stroke(0.06, peak_n=8.0), "forte": stroke(0.03), "long": stroke(0.04, hold_s=0.6)}


def test_properties_are_those_of_the_motion():
    found = stroke(notes=2, hold_s=0.1)
    assert found["speed"] == pytest.approx(0.01 / 0.03, rel=0.01) and found["depth"] == pytest.approx(0.01)
    assert found["release"] == pytest.approx(0.01 / 0.06, rel=0.01) and found["force"] == pytest.approx(20.0)
    assert found["rate"] == pytest.approx(1 / 0.24, rel=0.05) and found["return"] == pytest.approx(0.0, abs=0.02)
    assert found["phases"] == ["strike", "release", "repetition"] and "rate" not in stroke()
    up = extract_features(TIME_S, -np.interp(TIME_S, [0.1, 0.13, 0.4, 0.46], [0, 0.01, 0.01, 0]), "rad")
    assert up["speed"] == pytest.approx(0.01 / 0.03, rel=0.01)  # whichever way an encoder turns
    assert extract_features(TIME_S, np.full(TIME_S.size, np.nan), "rad") == {}


def test_inside_is_between_those_fitted_and_a_little_beyond():
    fitted = list(FITTED.values())
    for new in (*fitted, stroke(0.045, 0.4, peak_n=15.0), stroke(0.027, peak_n=22.0)):
        assert not locate_stroke(new, fitted).outside


@pytest.mark.parametrize(
    ("changed", "word"),
    [
        ({"rise_s": 0.015}, "fastest way down"),
        ({"rise_s": 0.12}, "fastest way down"),
        ({"depth": 0.008}, "deepest place"),
        ({"hold_s": 0.0}, "time the key is down"),
        ({"fall_s": 0.02}, "fastest way up"),
        ({"peak_n": 40.0}, "largest force"),
    ],
)
def test_what_sets_a_stroke_outside_is_said(changed, word):
    found = locate_stroke(stroke(**{"peak_n": 20.0} | changed), list(FITTED.values()))
    assert found.outside and 1.0 < found.distance < math.inf and word in found.why and "fitted" in found.why


def test_a_repetition_that_was_never_fitted_has_no_distance():
    double = stroke(notes=2)
    found = locate_stroke(double, list(FITTED.values()))
    assert found.outside and found.distance == math.inf and found.why == "repetition: no fitted stroke has it"
    assert not locate_stroke(double, [*FITTED.values(), double]).outside


def test_what_is_not_known_has_no_place():
    assert (
        locate_stroke({}, [stroke()]) is None
        and locate_stroke(stroke(), []) is None
        and locate_stroke(stroke(), [{}]) is None
    )
    assert locate_stroke(stroke(), [stroke() | {"unit": "m"}]) is None


def test_skill_is_against_the_best_rival_paired_by_stroke():
    model, size = np.array([1.0, 2.0, 3.0, 4.0, 5.0]), np.array([1.0, 1.1, 0.9, 1.0, 1.0])
    found = compute_skill(model, {"null": 4 * model, "fir": 2 * model * size, "unfitted": np.full(5, np.nan)})
    assert found.rival == "fir" and found.strokes == 5
    assert found.skill == pytest.approx(0.5, abs=0.01) and found.low < 0.48 < 0.52 < found.high
    few = compute_skill(model[:3], {"fir": 0.5 * model[:3]})
    assert few.skill == pytest.approx(-1.0) and np.isnan(few.low)
    assert "100 % larger than that of the FIR filter" in few.words and "3 strokes: no interval" in few.words
    (line,) = describe_skills(
        {"key": found, "jack": few}, "the other trials"
    )  # of a film in fewer trials than the encoder
    assert line.endswith(f": key 0.50{found.interval} (FIR filter), jack −1.00 (FIR filter; 3 trials: no interval).")
    assert compute_skill(model, {}) is None and compute_skill(np.full(2, np.nan), {"fir": model[:2]}) is None
