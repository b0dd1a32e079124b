"""ISO 18571-style score: published numbers, closed forms, an independent implementation."""

from __future__ import annotations

import csv
import json
import os
from pathlib import Path

import numpy as np
import pytest

from validation.scores.iso18571 import find_best_shift, iso_score

EXPECTED = Path(__file__).parents[3] / ".." / "shared" / "data" / "iso18571_annex_expected.json"
ANNEX = os.environ.get("ISO18571_ANNEX", "")


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


def test_equal_curves_score_one():
    test, _ = published_pair()
    score = iso_score(test, test, 1e-4)
    assert (score.corridor, score.phase, score.magnitude, score.slope, score.overall) == pytest.approx((1.0,) * 5)


@pytest.mark.parametrize("factor", [1.05, 1.12, 0.9, 1.5])
def test_a_scaled_curve_keeps_its_phase_and_loses_half_its_excess_of_slope(factor):
    test, _ = published_pair()
    score = iso_score(test, factor * test, 1e-4)
    assert score.phase == 1.0
    assert score.slope == pytest.approx(1 - abs(factor - 1) / 2, abs=1e-12)


def test_an_offset_of_twice_the_peak_keeps_phase_and_slope_only():
    test, _ = published_pair()
    score = iso_score(test, test + 2 * np.abs(test).max(), 1e-4)
    assert (score.corridor, score.magnitude) == (0.0, 0.0)
    assert (score.phase, score.slope) == (1.0, pytest.approx(1.0))


@pytest.mark.parametrize("late", [13, -13, 90, -90])
def test_a_late_or_early_curve_is_found_with_its_sign(late):
    time = np.arange(1000)

    def pulse(centre):
        return np.exp(-(((time - centre) / 40.0) ** 2))

    test, cae = pulse(500), pulse(500 + late)
    assert find_best_shift(test, cae) == late
    assert iso_score(test, cae, 1e-4).phase == pytest.approx(1 - abs(late) / 200)


def cheapest_warp_error(c: np.ndarray, t: np.ndarray, window: int) -> float:
    """Sum of |c − t| over that of |t| along the cheapest warping path: every cell of the band, one by one."""
    n = t.size
    cost, came_from = np.full((n + 1, n + 1), np.inf), {}
    cost[0, 0] = 0.0
    for i in range(n):
        for j in range(max(0, i - window), min(n, i + window + 1)):
            ways = [(cost[i, j + 1], (i - 1, j)), (cost[i + 1, j], (i, j - 1)), (cost[i, j], (i - 1, j - 1))]
            best, came_from[i, j] = min(ways, key=lambda way: way[0])
            cost[i + 1, j + 1] = best + (c[i] - t[j]) ** 2
    at, path = (n - 1, n - 1), []
    while at != (-1, -1):
        path.append(at)
        at = came_from[at]
    i, j = np.array(path).T
    return float(np.abs(c[i] - t[j]).sum() / np.abs(t[j]).sum())


@pytest.mark.parametrize("size", [0.02, 0.3, 1.0])
@pytest.mark.parametrize("seed", range(4))
def test_the_magnitude_is_that_of_the_cheapest_path_of_all_cells(seed, size):
    rng = np.random.default_rng([seed, 18571])
    n = int(rng.integers(40, 90))
    test = np.cumsum(rng.standard_normal(n))
    cae = test + size * np.cumsum(rng.standard_normal(n))
    score = iso_score(test, cae, 1e-3)
    m = abs(score.shift_samples)
    late = score.shift_samples > 0
    t, c = (test[: n - m], cae[m:]) if late else (test[m:], cae[: n - m])
    error = cheapest_warp_error(c, t, int(np.ceil(0.1 * t.size)) - 1)
    assert score.magnitude == pytest.approx(max(0.0, 1.0 - error / 0.5), abs=1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_equal_to_an_independent_implementation(seed):
    rating = pytest.importorskip(
        "objective_rating_metrics.rating", reason="the public ISO 18571 package is a test oracle"
    )
    rng = np.random.default_rng(seed)
    time = np.arange(500) * 1e-4
    test = np.cumsum(rng.normal(size=500)) * 0.1 + np.sin(300 * time)
    cae = 1.1 * np.roll(test, 3 * seed) + 0.05 * np.cumsum(rng.normal(size=500))
    oracle = rating.ISO18571(
        reference_curve=np.column_stack([time, test]), comparison_curve=np.column_stack([time, cae]), dt=1e-4
    )
    mine = iso_score(test, cae, 1e-4)
    theirs = [
        getattr(oracle, f"{name}_rating")(ndigits=15) for name in ("corridor", "phase", "magnitude", "slope", "overall")
    ]
    assert [mine.corridor, mine.phase, mine.magnitude, mine.slope, mine.overall] == pytest.approx(theirs, abs=1e-9)


def test_curves_that_do_not_vary_and_curves_that_cannot_be_scored():
    assert iso_score(np.zeros(20), np.zeros(20), 1e-4).overall == pytest.approx(1.0)
    assert iso_score(np.zeros(20), np.ones(20), 1e-4).corridor == 0.0
    for bad in ((np.ones(8), np.ones(8)), (np.ones(20), np.ones(21)), (np.full(20, np.nan), np.ones(20))):
        with pytest.raises(ValueError, match="curves"):
            iso_score(*bad, 1e-4)


@pytest.mark.skipif(
    not (ANNEX and EXPECTED.is_file()),
    reason="set ISO18571_ANNEX to the unpacked CSV files of ISO/TS 18571 ed. 2, which are not free to ship",
)
def test_the_scores_of_the_specification_s_annex():
    expected = json.loads(EXPECTED.read_text())["cases"]
    checked = 0
    for path in sorted(Path(ANNEX).rglob("*.csv")):
        case = expected.get(path.stem)
        if case is None:
            continue
        with path.open(newline="") as file:
            rows = [row for row in list(csv.reader(file))[2:] if row[2] and row[3]]
        time, test, cae = (np.array([float(row[i]) for row in rows]) for i in (1, 2, 3))
        score = iso_score(test, cae, float(np.mean(np.diff(time))))
        found = {"R": score.overall, "Z": score.corridor, "EP": score.phase, "EM": score.magnitude, "ES": score.slope}
        assert found == pytest.approx(case, abs=1e-3), path.name
        checked += 1
    assert checked > 0


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
