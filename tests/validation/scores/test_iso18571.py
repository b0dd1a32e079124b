"""ISO 18571-style score: published numbers, an independent implementation, sign of the shift, refusals."""

from __future__ import annotations

import numpy as np
import pytest

from validation.scores.iso18571 import find_best_shift, iso_score


def published_pair():
    """The example pair of the public implementation yeonsoo-p/ISO18571 (600 samples at 10 kHz)."""
    tau = np.arange(600) / 600
    s = tau - 0.012
    test = 0.65 * np.sin(6 * np.pi * tau) + 0.2 * np.sin(18 * np.pi * tau + 0.25) + 0.1 * np.tanh((tau - 0.42) / 0.035)
    cae = 0.62 * np.sin(6 * np.pi * s) + 0.18 * np.sin(18 * np.pi * s + 0.25) + 0.09 * np.tanh((tau - 0.44) / 0.04)
    return test, cae + 0.025


def test_the_published_example():
    score = iso_score(*published_pair(), 1e-4)
    assert score.corridor == pytest.approx(0.6528907169, abs=1e-9)
    assert score.phase == pytest.approx(0.9416666667, abs=1e-9)
    assert score.magnitude == pytest.approx(0.9506540193, abs=1e-9)
    assert score.slope == pytest.approx(0.9566865092, abs=1e-9)
    assert score.overall == pytest.approx(0.8309577258, abs=1e-9)
    assert score.shift_samples == 7


@pytest.mark.parametrize("late", [13, -13, 90, -90])
def test_a_late_or_early_curve_is_found_with_its_sign(late):
    time = np.arange(1000)

    def pulse(centre):
        return np.exp(-(((time - centre) / 40.0) ** 2))

    test, cae = pulse(500), pulse(500 + late)
    assert find_best_shift(test, cae) == late
    assert iso_score(test, cae, 1e-4).phase == pytest.approx(1 - abs(late) / 200)


# corridor, phase, magnitude, slope and overall rating by the public package objective_rating_metrics 1.3
RATINGS = (
    (0.61269762726, 1.0, 0.67428415743, 0.79062426001, 0.73806073439),
    (0.38404050954, 0.97, 0.54887432682, 0.74753404845, 0.60689787887),
    (0.66011868057, 0.94, 0.85849903138, 0.80492376768, 0.78473203204),
    (0.61477983968, 0.91, 0.76983443822, 0.80631845065, 0.74314251365),
)


@pytest.mark.parametrize(("seed", "ratings"), list(enumerate(RATINGS)))
def test_equal_to_an_independent_implementation(seed, ratings):
    rng = np.random.default_rng(seed)
    test = np.cumsum(rng.normal(size=500)) * 0.1 + np.sin(300 * np.arange(500) * 1e-4)
    cae = 1.1 * np.roll(test, 3 * seed) + 0.05 * np.cumsum(rng.normal(size=500))
    mine = iso_score(test, cae, 1e-4)
    assert (mine.corridor, mine.phase, mine.magnitude, mine.slope, mine.overall) == pytest.approx(ratings, abs=1e-9)


def test_curves_that_do_not_vary_and_curves_that_cannot_be_scored():
    assert iso_score(np.zeros(20), np.zeros(20), 1e-4).overall == pytest.approx(1.0)
    assert iso_score(np.zeros(20), np.ones(20), 1e-4).corridor == 0.0
    for bad in ((np.ones(8), np.ones(8)), (np.ones(20), np.ones(21)), (np.full(20, np.nan), np.ones(20))):
        with pytest.raises(ValueError, match="curves"):
            iso_score(*bad, 1e-4)


def correlations(test, cae):
    """Pearson's correlation of the parts that overlap, by shift, in the order of the specification."""
    out, test, cae = {}, test - test.mean(), cae - cae.mean()
    for m in range(int(0.2 * test.size) + 1):
        for shift in (m, -m):
            a, b = (test[: test.size - m], cae[m:]) if shift >= 0 else (test[m:], cae[:-m])
            still = min(np.ptp(a), np.ptp(b)) == 0.0
            out[shift] = float(np.array_equal(a, b)) if still else float(np.corrcoef(a, b)[0, 1])
    return out


@pytest.mark.parametrize("kind", ["noise", "walk", "period", "step", "rounded", "still"])
def test_the_shift_is_that_of_the_highest_correlation_of_all(kind):
    rng = np.random.default_rng(2)
    for n in (9, 40, 301):
        t = np.linspace(0.0, 1.0, n)
        test, cae = {
            "noise": rng.standard_normal((2, n)),
            "walk": np.cumsum(rng.standard_normal((2, n)), axis=1),
            "period": np.array([np.sin(30.0 * t), np.sin(30.0 * (t - 0.013))]),
            "step": np.array([t > 0.5, t > 0.56], dtype=float),
            "rounded": np.round([np.exp(-(((t - 0.5) / 0.05) ** 2)), np.exp(-(((t - 0.55) / 0.05) ** 2))], 3),
            "still": np.array([t > 0.95, np.zeros(n)], dtype=float),
        }[kind]
        by_shift = correlations(test, cae)
        highest = max(by_shift.values())
        found = find_best_shift(test, cae)
        assert by_shift[found] == pytest.approx(highest, abs=1e-9)
        assert abs(found) == min(abs(shift) for shift, r in by_shift.items() if r > highest - 1e-12)
