"""Level, coverage and power of the verdict's estimates, by Monte Carlo on distributions that are known.

Other numbers of trials: ``python -m benchmarks verdict_coverage``.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from validation.verdict.estimate import (
    ErrorSample,
    divide_variance,
    draw_trial_scatter,
    estimate_errors,
    interval_by_rank,
    pooled_scale,
    rare_branches,
    strongest_inputs,
)

N, K, QUANTITIES = 199, 20, 6
SESSIONS = 600


def session(
    rng: np.random.Generator, n: int = 5, error: float = 0.0, skewed: bool = False, own_u: float = 0.5
) -> ErrorSample:
    """A session of correlated quantities whose first one has a model error."""
    mixing = np.eye(QUANTITIES) + 0.5

    def common(size: int) -> np.ndarray:
        z = rng.standard_normal((size, QUANTITIES)) @ mixing
        return np.exp(0.8 * z) if skewed else z

    everything, own = common(N + 1), own_u * rng.standard_normal((K, QUANTITIES))
    trials = own_u * rng.standard_normal((n, QUANTITIES))
    found = everything[-1] + trials.mean(axis=0)
    found[0] += error
    return ErrorSample(
        found=found, n_trials=np.full(QUANTITIES, n), residuals=trials - trials.mean(axis=0), common=everything[:-1],
        own=own, condition=np.zeros(QUANTITIES, dtype=int), branch=np.zeros((N, 1), dtype=np.int64),
        branch_found=np.zeros(1, dtype=np.int64), inputs=rng.standard_normal((N, 2)),
        floor=np.full(QUANTITIES, 1e-9), primary=np.ones(QUANTITIES, dtype=bool),
    )  # fmt: skip


@pytest.mark.parametrize(("n", "skewed"), [(1, False), (5, True)])
def test_a_right_model_is_resolved_in_one_session_of_twenty_whatever_the_distribution(n: int, skewed: bool) -> None:
    rng = np.random.default_rng([1, n, skewed])
    hits = sum(estimate_errors(session(rng, n, skewed=skewed)).resolved.any() for _ in range(SESSIONS))
    assert 0.02 < hits / SESSIONS < 0.08  # 5 %; three standard deviations are 2.7 %


@pytest.mark.parametrize(("n", "error"), [(2, 3.0), (5, 0.0)])
def test_individual_intervals_hold_the_error(n: int, error: float) -> None:
    rng = np.random.default_rng([2, n, int(error)])
    found = [estimate_errors(session(rng, n, error)) for _ in range(SESSIONS)]
    held = np.mean([[e.low[0] <= error <= e.high[0], e.low[1] <= 0.0 <= e.high[1]] for e in found])
    assert 0.93 < held < 0.98
    assert all(np.all(e.low < e.low_90) and np.all(e.high_90 < e.high) for e in found)


def test_the_detectable_error_is_resolved_in_four_sessions_of_five() -> None:
    rng = np.random.default_rng(3)
    size = float(np.mean([estimate_errors(session(rng)).detectable_high[0] for _ in range(60)]))
    hits = sum(bool(estimate_errors(session(rng, error=size)).resolved[0]) for _ in range(SESSIONS))
    assert 0.74 < hits / SESSIONS < 0.88


def test_a_quantity_with_a_long_tail_does_not_hide_the_errors_of_the_others() -> None:
    rng = np.random.default_rng(9)
    ratios, hits = [], 0
    for _ in range(60):
        plain = session(rng)
        far = rng.uniform(size=N + 1) < 0.04
        common, found = plain.common.copy(), plain.found.copy()
        common[far[:-1], 0] += 12.0
        found[0] += 12.0 * far[-1]
        tailed = estimate_errors(replace(plain, common=common, found=found))
        ratios.append(tailed.detectable_high[1:] / estimate_errors(plain).detectable_high[1:])
        hits += bool(tailed.resolved.any())
    assert 0.95 < float(np.mean(ratios)) < 1.1
    assert hits <= 9  # of 60 at 5 %: more in 0.1 % of runs


def test_scatter_beyond_what_is_declared_widens_the_interval_and_two_trials_are_wide() -> None:
    rng = np.random.default_rng(4)
    own = 0.1 * rng.standard_normal((K, 1))
    trials = np.array([[-1.0], [1.0], [-1.0], [1.0], [0.0], [0.0]])
    draws, s = draw_trial_scatter(trials, own, np.array([6]), 20_000, rng)
    expected = np.sqrt((4.0 + 3.0 * own.var(ddof=1)) / (3 + 5) / 6)
    assert s[0] == pytest.approx(expected)
    assert draws.std() == pytest.approx(expected * np.sqrt(8 / 6), rel=0.03)  # variance of Student's t of 8
    few, _ = draw_trial_scatter(trials[:2], own, np.array([2]), 20_000, rng)
    assert np.quantile(few, 0.975) > 2 * np.quantile(draws, 0.975)


def test_one_draw_far_away_changes_neither_scale_nor_interval() -> None:
    rng = np.random.default_rng(5)
    sample = session(rng)
    far = sample.common.copy()
    far[3] += 200.0
    before, after = estimate_errors(sample), estimate_errors(replace(sample, common=far))
    assert after.u == pytest.approx(before.u, rel=0.03)
    assert after.high == pytest.approx(before.high, rel=0.1)


def test_draws_on_another_branch_are_a_share_and_no_part_of_u() -> None:
    rng = np.random.default_rng(6)
    sample = session(rng)
    branch = np.zeros((N, 1), dtype=np.int64)
    branch[:60] = 1
    common = sample.common.copy()
    common[:60] += 50.0
    found = estimate_errors(replace(sample, common=common, branch=branch))
    assert found.n_draws == N - 60
    assert found.share == pytest.approx((N - 60) / N)
    assert np.all(found.u < 3.0)


def test_a_branch_that_no_draw_takes_is_resolved_and_one_that_many_take_is_not() -> None:
    rng = np.random.default_rng(7)
    sample = session(rng)
    alone = estimate_errors(replace(sample, branch_found=np.array([9])))
    assert alone.is_branch_resolved
    assert not alone.resolved.any()
    assert np.isnan(alone.low).all()
    half = np.arange(N)[:, None] % 2
    assert not estimate_errors(replace(sample, branch=half)).is_branch_resolved
    assert rare_branches(half, np.array([1]))[1] == pytest.approx(1.0)


def two_conditions(one: ErrorSample, other: ErrorSample) -> ErrorSample:

    def apart(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return np.block([[a, np.full((len(a), QUANTITIES), np.nan)], [np.full((len(b), QUANTITIES), np.nan), b]])

    joined = {
        name: np.concatenate([getattr(one, name), getattr(other, name)])
        for name in ("found", "n_trials", "floor", "primary")
    }
    return replace(
        one, **joined, residuals=apart(one.residuals, other.residuals), own=apart(one.own, other.own),
        common=np.hstack([one.common, other.common]), condition=np.repeat([0, 1], QUANTITIES),
        branch=np.hstack([one.branch, other.branch]), branch_found=np.append(one.branch_found, other.branch_found),
    )  # fmt: skip


def test_two_conditions_are_estimated_each_by_itself_and_tested_together() -> None:
    rng = np.random.default_rng(11)
    hits, held = 0, []
    for _ in range(SESSIONS // 2):
        both = two_conditions(session(rng), session(rng, 2))
        found = estimate_errors(both)
        hits += bool(found.resolved.any())
        held.append([found.low[0] <= 0.0 <= found.high[0], found.low[-1] <= 0.0 <= found.high[-1]])
    assert 0.02 < hits / (SESSIONS // 2) < 0.09
    assert 0.92 < np.mean(held) < 0.98
    wrong = estimate_errors(two_conditions(session(rng), session(rng, error=40.0)))
    assert wrong.resolved.nonzero()[0].tolist() == [QUANTITIES]


def test_a_branch_that_one_condition_never_takes_leaves_the_other_its_intervals() -> None:
    rng = np.random.default_rng(12)
    other = replace(session(rng), branch_found=np.array([5]))
    found = estimate_errors(two_conditions(session(rng), other))
    assert found.is_branch_resolved
    assert found.n_draws.tolist() == [N, 0]
    assert np.isfinite(found.low[:QUANTITIES]).all()
    assert np.isnan(found.low[QUANTITIES:]).all()


def test_interval_of_ranks_is_that_of_the_order_statistics() -> None:
    drawn = np.arange(1.0, 200.0)[:, None]
    low, high = interval_by_rank(np.array([0.0]), drawn, 0.95)
    assert (low[0], high[0]) == (-195.0, -5.0)
    assert np.isnan(interval_by_rank(np.array([0.0]), drawn[:38], 0.95)).all()


def test_variance_is_divided_among_the_inputs_that_make_it() -> None:
    rng = np.random.default_rng(8)
    z = rng.standard_normal((400, 3))
    errors = (3.0 * z[:, 0] - 1.0 * z[:, 1] + 0.5 * rng.standard_normal(400))[:, None]
    parts, other = divide_variance(errors, z, *pooled_scale(errors, np.array([0.0]), np.array([1e-9])))
    assert parts[:, 0] == pytest.approx([3.0, 1.0, 0.0], abs=0.1)
    assert other[0] == pytest.approx(0.5, rel=0.1)


def test_the_input_that_explains_most_is_named_from_the_draws_that_are_known() -> None:
    rng = np.random.default_rng(13)
    inputs = rng.standard_normal((N, 3))
    noise = rng.standard_normal(N)
    errors = np.column_stack([np.exp(2.0 * inputs[:, 1]) + 0.1 * noise, noise, inputs[:, 2], inputs[:, 0]])
    errors[:100, 2] = np.nan
    errors[20:, 3] = np.nan  # too few
    assert strongest_inputs(errors, inputs, ["mass", "friction", "length"]) == ["friction", "", "length", ""]
