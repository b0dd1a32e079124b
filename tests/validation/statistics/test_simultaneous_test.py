"""The simultaneous test: its level on skewed, correlated curves, its power, and when the trials' scatter enters."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from validation.statistics.paired_difference import MOST_NUMBERS, log_evidence, simultaneous_test

FLOOR = np.full(2, 1e-6)
TIME = np.linspace(0, 1, 60)


def curves(rng: np.random.Generator, count: int, n_trials: int) -> np.ndarray:
    """Differences common to the trials: smooth, skewed, with a spike of random place, two proportional channels."""
    z = rng.standard_normal((count, 3))
    skewed = np.exp(0.6 * z[:, 0])[:, None] * np.sin(3 * TIME) - 1.0
    spike = np.exp(-(((TIME - 0.6 - 0.02 * z[:, 1:2]) / 0.01) ** 2)) * z[:, 2:3]
    one = skewed + 5 * spike
    own = 0.05 * rng.standard_normal((count, n_trials, 1))
    both = np.stack([one, 2.5 * one], axis=-1)[:, None] + own[..., None]
    return 1e-3 * both


@pytest.mark.parametrize("sessions, least, most", [(100, 1, 11), pytest.param(400, 10, 31, marks=pytest.mark.slow)])
def test_right_models_are_rejected_in_five_percent_of_sessions(sessions: int, least: int, most: int) -> None:
    """99 % of tests at 5 % reject so often."""
    rng = np.random.default_rng(41)
    rejected = 0
    for _ in range(sessions):
        every = curves(rng, 60, 3)
        outcome = simultaneous_test(every[0], every[1:], FLOOR)
        assert outcome is not None and outcome.draws == 59
        rejected += outcome.rejected
        assert outcome.rejected == (outcome.p <= 0.05)
    assert least <= rejected <= most


def test_trials_that_scatter_as_drawn_add_nothing_and_others_do() -> None:
    rng = np.random.default_rng(5)
    sessions = [curves(rng, 60, 6) for _ in range(100)]
    outcomes = [simultaneous_test(every[0], every[1:], FLOOR) for every in sessions]
    added = [bool(outcome is not None and outcome.excess_scatter) for outcome in outcomes]
    assert sum(added) <= 12  # 5 % by design
    every = sessions[added.index(False)]
    usual = outcomes[added.index(False)]
    loose = every[0] + 1e-3 * rng.standard_normal((6, 1, 1)) * np.sin(9 * TIME)[None, :, None]
    wide = simultaneous_test(loose, every[1:], FLOOR)
    few = simultaneous_test(loose[:3], every[1:, :3], FLOOR)
    assert usual is not None and wide is not None and few is not None
    assert wide.excess_scatter and np.all(wide.u >= 0.99 * usual.u) and wide.u.mean() > usual.u.mean()
    assert not few.excess_scatter  # three trials say nothing of their scatter


def test_a_shift_of_five_standard_uncertainties_is_found_in_its_channel() -> None:
    rng = np.random.default_rng(6)
    found = 0
    for _ in range(60):
        every = np.cumsum(rng.standard_normal((60, 1, 60, 2)), axis=2) * 1e-4
        every -= every[:, :, :1]
        base = simultaneous_test(every[0], every[1:], FLOOR)
        assert base is not None
        moved = every[0].copy()
        moved[..., 1] += 5 * base.u[:, 1]
        outcome = simultaneous_test(moved, every[1:], FLOOR)
        assert outcome is not None
        found += bool(outcome.reached[1] > outcome.factor)
    assert found >= 54


def test_lost_samples_and_channels_are_left_out() -> None:
    rng = np.random.default_rng(7)
    every = curves(rng, 40, 3)
    every[0, :, 10:20, 0] = np.nan
    every[0, 1, :, 1] = np.nan
    outcome = simultaneous_test(every[0], every[1:], FLOOR)
    assert outcome is not None
    assert np.isnan(outcome.difference[10:20, 0]).all() and np.isfinite(outcome.difference[:, 1]).all()
    assert outcome.difference[:, 1] == pytest.approx(every[0, [0, 2], :, 1].mean(axis=0))
    nothing = np.full_like(every[0], np.nan)
    assert simultaneous_test(nothing, every[1:], FLOOR) is None
    assert simultaneous_test(every[0], every[1:15], FLOOR) is None


def test_the_evidence_is_the_density_of_the_mean_angles_and_a_proper_score() -> None:
    """Its many-draws limit is the normal density; on average no other spread or place scores better than the true."""
    rng = np.random.default_rng(11)
    root = np.tril(rng.standard_normal((MOST_NUMBERS, MOST_NUMBERS))) + 2.0 * np.eye(MOST_NUMBERS)

    def drawn(count: int, spread: float = 1.0, away: float = 0.0) -> np.ndarray:
        numbers = 1e-3 * (away + spread * rng.standard_normal((count, MOST_NUMBERS)) @ root.T)
        return np.repeat(numbers, 5, axis=1)[:, :, None]  # one channel, each part of five samples

    data, nothing = drawn(400), np.zeros(1)
    exact = stats.multivariate_normal(cov=1e-6 * root @ root.T)
    many, u = log_evidence(data[0], drawn(4000), nothing)
    assert many == pytest.approx(exact.logpdf(data[0, ::5, 0]), abs=4.0 * u) and u < 0.3

    def score(**other: float) -> float:
        return float(np.mean([log_evidence(one, drawn(59, **other), nothing)[0] for one in data[:30]]))

    true = score()
    assert all(true > score(**other) + 0.5 for other in ({"spread": 0.5}, {"spread": 2.0}, {"away": 2.0}))
    by_channel = data.reshape(400, MOST_NUMBERS, 5).transpose(0, 2, 1)  # the same numbers, one in each channel
    same = log_evidence(by_channel[0], by_channel[1:], np.zeros(MOST_NUMBERS))
    assert same == pytest.approx(log_evidence(data[0], data[1:], nothing))
