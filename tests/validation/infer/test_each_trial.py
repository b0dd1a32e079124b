"""Trials whose scatter bends the model: each is followed to where its own laws took it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from tests.validation.infer import toy
from validation.conventions import Array
from validation.infer.estimates import profiles
from validation.infer.fit import fit, fit_conditional, fit_multistart
from validation.infer.noise import FLOOR, ROUGH_FLOOR
from validation.infer.problem import Problem, curves_at, residuals_there
from validation.infer.response import Own
from validation.infer.scatter import measure_lack

TRUTH = np.array([0.8, -0.5, 0.3])


class Bent(toy.Toy):
    """A toy that bends ten times as far."""

    def curve(self, z: Array) -> Array:
        total = self.parts(z).sum(axis=2)
        return np.asarray(0.1 * np.sin(12 * toy.TIME)[:, None] + total + 20.0 * total**2)

    def slope(self, z: Array) -> Array:
        return np.asarray(self.parts(np.ones(z.size)) * (1.0 + 40.0 * self.parts(z).sum(axis=2)[:, :, None]))


def played(seed: int, scatter: float = 0.3) -> tuple[Problem, list[Array]]:
    """Six trials, and where the laws of each were."""
    rng = np.random.default_rng(seed)
    own = [scatter * rng.standard_normal(3) for _ in range(6)]
    trials = [
        toy.trial(k + 1, Bent([]).curve(TRUTH + d) + 1e-5 * rng.standard_normal((toy.M, 3))) for k, d in enumerate(own)
    ]
    return replace(toy.problem(trials), response=Bent(trials)), own


def test_scatter_that_bends_the_model_is_found_and_no_noise_is_made_of_it() -> None:
    problem, own = played(0)
    before = fit(problem)
    after = fit_conditional(problem, before)
    assert after.own is not None
    assert after.converged and after.badness < before.badness - 100.0
    assert after.marginal.sizes.own[:, :3].max() < 0.5 * before.marginal.sizes.own[:, :3].max()
    found = np.array([o.laws for o in after.own])
    assert np.abs(found + after.z - own - TRUTH).max() < 0.02
    curves = curves_at(problem, after.z, after.own) or []
    left = residuals_there(problem, after.marginal.blocks, curves, after.own)
    assert after.marginal.objective(left, after.z) == pytest.approx(after.objective, rel=1e-9)


def test_a_trial_that_the_model_cannot_follow_leaves_the_fit_unsettled() -> None:
    class Lost(Bent):
        def curves(
            self, points: Sequence[Array], own: Sequence[Sequence[Own]] | None = None
        ) -> list[list[Array] | None]:
            return super().curves(points) if own is None else [None for _ in points]

    problem, _ = played(1)
    found = fit_conditional(replace(problem, response=Lost(problem.trials)), fit(problem))
    assert found.own is None and not found.converged


def test_a_profile_and_a_sampler_see_each_trial_where_it_was() -> None:
    problem, _ = played(0)
    after = fit_conditional(problem, fit(problem))
    width = np.sqrt(after.covariance[1, 1])
    (made,) = profiles(problem, after, {1: 1.96})
    assert made.rise.min() > -0.05 and made.interval == "two-sided"
    # held at the trials' common values the model would miss every trial, and the profile rise a hundredfold
    assert made.high - made.low == pytest.approx(2 * 1.96 * width, rel=0.3)


def test_what_a_trial_does_after_a_fork_is_left_out_and_the_rest_settles_on_the_truth() -> None:
    first = 2

    class Forked(Bent):
        """The second trial meets a stop in the stroke, or misses it, by where a value just is."""

        def curves(
            self, points: Sequence[Array], own: Sequence[Sequence[Own]] | None = None
        ) -> list[list[Array] | None]:
            out = super().curves(points, own)
            for i, (z, curves) in enumerate(zip(points, out, strict=True)):
                laws = 0.0 if own is None else own[i][1].laws[0]
                if curves is not None and z[0] + laws > met:
                    curves[1] = curves[1] + 5e-3 * (np.arange(toy.M) >= first)[:, None]
            return out

    problem, own = played(0)
    met = TRUTH[0] + own[1][0] - 0.02  # it passed by the stop that the model meets
    found = fit_conditional(replace(problem, response=Forked(problem.trials)), fit(problem))
    assert found.bifurcations == {1: first} and found.converged
    assert np.all(np.abs(found.z - TRUTH) < 3.0 * np.sqrt(np.diag(found.covariance)))


def test_a_discrepancy_that_is_not_there_shrinks_to_the_error_of_runs_and_u_with_it() -> None:
    """What stood at 0.2 % of the response made u of felts and springs twice as large."""
    problem, own = played(1)
    alike = fit(problem)
    rough, fine = fit_conditional(problem, alike, rough=True), fit_conditional(problem, alike)
    assert measure_lack(rough) == pytest.approx(ROUGH_FLOOR) and FLOOR <= measure_lack(fine) < 0.2 * ROUGH_FLOOR
    wide, narrow = (np.sqrt(np.diag(f.covariance))[:3] for f in (rough, fine))
    assert fine.converged and np.all(narrow < wide)
    middle = TRUTH + np.mean(own, axis=0)  # of the laws that the trials had
    assert np.all(np.abs(fine.z[:3] - middle) < 3.5 * narrow)


@pytest.mark.parametrize(("trials", "first"), [(6, True), (3, False)])
def test_two_typical_trials_are_followed_before_all_where_they_are_no_more_than_half(trials: int, first: bool) -> None:
    problem, own = played(2, scatter=0.05)
    problem, said = problem.of_trials(list(range(trials))), []
    best, *_ = fit_multistart(problem, 1, said.append)
    assert (f"fit of 2 of {trials} trials" in said) == first
    width = np.sqrt(np.diag(best.covariance))[:3]
    assert best.converged and np.all(np.abs(best.z[:3] - TRUTH - np.mean(own[:trials], axis=0)) < 3.5 * width)
