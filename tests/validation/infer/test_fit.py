"""Fits of a made-up model with known truth: values, intervals, what cannot be told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.optimize import minimize

from tests.validation.infer import toy
from validation.conventions import Array
from validation.infer.blocks import residuals
from validation.infer.estimates import IDENTIFIED, NOT_IDENTIFIABLE, estimate_all, profiles
from validation.infer.fit import fit, starts
from validation.infer.scatter import factors, jackknife, measure_lack, widen_by_jackknife

TRUTH = np.array([0.8, -0.5, 0.3])


def silent(text: str) -> None:
    """Nobody listens."""


def test_truth_comes_out_within_its_uncertainty() -> None:
    off = []
    for seed in range(1, 7):
        p = toy.problem(toy.made(TRUTH, 6, np.random.default_rng(seed)))
        found = fit(p)
        width = np.sqrt(np.diag(found.covariance))
        assert found.converged and np.all(width < 0.1)
        off.append((found.z - TRUTH) / width)
    assert 0.6 < np.sqrt(np.mean(np.square(off))) < 1.5  # neither too narrow nor too wide
    assert np.abs(off).max() < 3.5  # the largest of eighteen
    estimates = estimate_all(p, found, None, silent)
    assert [e.verdict for e in estimates] == [IDENTIFIED] * 3
    for e in estimates:
        assert e.low < e.value < e.high
        assert e.interval == "two-sided" and e.profiled


def test_what_the_model_lacks_is_learnt_and_widens() -> None:
    rng = np.random.default_rng(5)
    right = fit(toy.problem(toy.made(TRUTH, 6, rng)))
    wrong = fit(toy.problem(toy.made(TRUTH, 6, rng, lacking=5e-3)))
    assert measure_lack(wrong) > 5 * measure_lack(right)
    assert np.all(np.diag(wrong.covariance) > 2 * np.diag(right.covariance))


def test_a_flat_profile_is_called_open_and_its_parameter_not_identified() -> None:
    p = toy.problem(toy.made(np.array([0.8, -0.5, 0.0]), 6, np.random.default_rng(2)), alike=True)
    found = fit(p)
    factor = factors(found)
    told, flat = profiles(p, found, {0: float(factor[0]), 2: float(factor[2])})
    assert flat.interval.startswith("open") and told.interval == "two-sided"
    verdicts = {e.name: e.verdict for e in estimate_all(p, found, None, silent)}
    assert verdicts["contact07.friction.A"] == NOT_IDENTIFIABLE and verdicts["key.joint_friction.A"] == IDENTIFIED


def test_jackknife_sees_the_scatter_of_trials() -> None:
    found = fit(toy.problem(toy.made(TRUTH, 8, np.random.default_rng(4), scatter=0.2)))
    assert np.all(jackknife(found) > 0.2 / np.sqrt(8) / 3) and np.all(jackknife(found) < 0.2 / np.sqrt(8) * 3)
    two = fit(toy.problem(toy.made(TRUTH, 2, np.random.default_rng(4))))
    assert np.all(np.isnan(jackknife(two)))


def test_trials_that_pull_apart_by_more_than_chance_widen_an_interval() -> None:
    u = np.array([0.1, 0.1, 0.1])
    np.testing.assert_allclose(widen_by_jackknife(u, np.array([0.15, 0.25, np.nan]), 5), [0.1, 0.25, 0.1])
    np.testing.assert_allclose(widen_by_jackknife(u, np.array([0.15, 0.25, 0.05]), 40), [0.15, 0.25, 0.1])
    trials = toy.made(TRUTH, 5, np.random.default_rng(4), scatter=0.01)
    trials[2] = replace(trials[2], change_rad=toy.Toy([]).curve(TRUTH + np.array([0.9, 0.0, 0.0])))
    p = toy.problem(trials)
    for e in estimate_all(p, fit(p), (), silent):
        assert e.z_u > e.u_jackknife / 1.83  # 99 % of chi square with four degrees of freedom


def test_few_trials_need_a_larger_factor() -> None:
    few = fit(toy.problem(toy.made(TRUTH, 3, np.random.default_rng(6), scatter=0.2)))
    many = fit(toy.problem(toy.made(TRUTH, 12, np.random.default_rng(6), scatter=0.2)))
    assert factors(few).max() > 2.5 > factors(many).max() > 1.95


def test_other_starts_find_the_same_minimum() -> None:
    p = toy.problem(toy.made(TRUTH, 5, np.random.default_rng(7)))
    found = [fit(p, z) for z in starts(p, 3)]
    assert np.ptp([f.objective for f in found]) < 4.0
    assert max(np.abs(f.z - found[0].z).max() for f in found) < 0.05


def test_a_profile_is_the_least_objective_over_all_others() -> None:
    p = toy.problem(toy.made(TRUTH, 4, np.random.default_rng(9)))
    found = fit(p)
    (made,) = profiles(p, found, {0: 2.5})
    for z0, rise in list(zip(made.z, made.rise, strict=True))[::2]:

        def objective(rest: Array, z0: float = z0) -> float:
            z = np.array([z0, *rest])
            here = residuals(p.trials, p.response.curves([z])[0] or [])
            return found.marginal.objective(here, z) - found.objective

        best = minimize(objective, found.z[1:], method="Nelder-Mead", options={"xatol": 1e-4, "fatol": 1e-3}).fun
        assert abs(rise - best) < 0.1 + 0.02 * best
