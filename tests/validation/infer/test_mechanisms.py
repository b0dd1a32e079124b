"""Each part of the noise model by itself, with planted truth, and the step in the box."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import lsq_linear

import model
from tests.validation.infer import toy
from validation.conventions import Array
from validation.infer.blocks import make_blocks, residuals, rows
from validation.infer.estimates import estimate_all
from validation.infer.fit import fit, fit_multistart
from validation.infer.noise import Marginal, Sizes, box_step, learn
from validation.infer.observations import ObservedTrial, encoder_noise, observe_driven
from validation.infer.problem import Problem
from validation.infer.response import Case, ModelResponse, noise_knots, slow_noise_n
from validation.infer.scatter import jackknife, widen_by_jackknife
from validation.infer.sources import IdentifyOptions, collect
from validation.infer.unknowns import unknowns

EXAMPLE = Path(__file__).parents[3] / "sessions" / "example_forte"


def test_phases_are_samples_of_each_trial() -> None:
    for t in collect([EXAMPLE], model.load_action(), IdentifyOptions(phases=40)).fitted:
        step = float(np.median(np.diff(t.force_time_s)))
        assert np.abs(t.time_s / step - np.round(t.time_s / step)).max() < 1e-6
        assert np.diff(t.time_s).min() > 0.9 * step


def test_a_stroke_is_driven_from_its_preload_however_few_phases_are_compared() -> None:
    """Few phases begin late: the force until then was cut off, and a fit ended 4 u off."""
    few, many = (collect([EXAMPLE], model.load_action(), IdentifyOptions(phases=n)).fitted for n in (8, 120))
    for a, b in zip(few, many, strict=True):
        assert a.time_s[0] > b.time_s[0] + 0.01
        until = b.force_time_s <= a.force_time_s[-1]
        assert np.array_equal(a.force_time_s, b.force_time_s[until])
        assert np.array_equal(a.force_n, b.force_n[until]) and a.force_n[0] == a.preload_n
        moves = a.force_time_s[np.flatnonzero(a.force_n != a.preload_n)[0]]
        assert noise_knots(a)[1] == moves < a.time_s[0]  # what it moved before the first phase had noise, too


def test_a_key_drives_from_rest_however_few_phases_are_compared() -> None:
    measured = collect([EXAMPLE], model.load_action(), IdentifyOptions(phases=8)).measured[:1]
    (trial,) = observe_driven("one", 0, measured, 8)
    assert trial.key is not None
    (rests, moves), _ = trial.key.evaluate([trial.key.time_s[0], trial.time_s[0]])
    assert abs(rests[0]) < 1e-5 < 1e-3 < abs(moves[0])


def test_the_zero_of_an_encoder_is_rounded_once_in_a_trial_and_jitter_in_each_sample() -> None:
    """Counted as noise of each sample, the zero left the mean of a channel over its phases five times too certain.

    Where a body rests alike it is rounded alike in all trials: counted as each trial's own alone, the mean of three
    trials was a third too certain (zero errors of six sessions 1.7 u off).
    """
    count, still, rng = np.array([1e-4, 3e-4, 2e-4]), 4000, np.random.default_rng(4)
    at, jitter = np.linspace(0.02, 0.3, 60)[:, None] * [1.0, -2.1, 3.7], np.array([0.0, 4e-4, 1e-4])
    rest = jitter * rng.standard_normal((still, 3))
    u = np.hypot(np.hypot(count / np.sqrt(12), rest.std(axis=0, ddof=1)), np.hypot(count / np.sqrt(12), 2e-5))
    m = SimpleNamespace(resolution_rad=count, quiet=SimpleNamespace(stop=still), change_rad=rest, u_rad=u)
    noise = encoder_noise(m)  # type: ignore[arg-type]
    np.testing.assert_allclose(noise["u_white_rad"], np.hypot(count / np.sqrt(12), jitter), rtol=0.03)
    np.testing.assert_allclose(noise["u_steady_rad"], np.hypot(count / np.sqrt(12), 2e-5), rtol=1e-6)
    many = 4000
    begins = rng.uniform(size=(many, 1, 3))
    read = count * (np.floor(at / count + begins) - np.floor(begins)) + jitter * rng.standard_normal((many, 60, 3))
    mean = (read - at).mean(axis=1).std(axis=0)
    trial = replace(toy.trial(1, at), time_s=np.linspace(0.0, 0.3, 60), **noise)
    nothing = np.zeros((60, 3, 1))
    (block,) = make_blocks([trial], [nothing], [nothing], np.ones(1, dtype=bool))
    stated = (np.diag(block.white) + block.own @ block.own.T).reshape(3, 60, 3, 60)
    np.testing.assert_allclose(np.sqrt([stated[c, :, c].mean() for c in range(3)]), mean, rtol=0.05)


def test_parts_of_force_noise_begin_with_the_force_and_keep_its_impulse() -> None:
    for t in collect([EXAMPLE], model.load_action(), IdentifyOptions(phases=40)).fitted:
        knots = noise_knots(t)
        hammer = np.abs(t.change_rad[:, 2])
        up = t.time_s[int(np.argmax(hammer > 0.9 * hammer.max()))]
        assert np.sum(knots <= up + 1e-9) >= 0.3 * knots.size and np.all(np.diff(knots) > 0)
        step = float(np.median(np.diff(t.force_time_s)))
        held = 0.5 * (np.append(knots[2:], knots[-1]) - knots[:-1])
        white = t.noise_n**2 * step * (knots[-1] - 0.5 * (knots[0] + knots[1]))
        assert np.sum((slow_noise_n(t) * held) ** 2) == pytest.approx(white, rel=1e-9)


def test_force_noise_of_a_double_stroke_is_told_from_what_the_action_does() -> None:
    """With long parts in the second rise chi-square of force noise alone was 8.6 of its degrees of freedom."""
    start, rng = model.load_action(), np.random.default_rng(8)
    when = np.arange(0.0, 0.45, 2e-4)
    corners = 0.02 + np.array([0, 0.055, 0.06, 0.11, 0.13, 0.19, 0.25, 0.26, 0.42])
    force = np.interp(when, corners, [0, 9, 10, 10, 0, 0, 8, 11, 9])
    measured = force + np.where(when > 0.02, 0.02 * rng.standard_normal(when.size), 0.0)
    blank = replace(
        toy.trial(1, np.zeros((when.size, 3))), force_time_s=when, force_n=force, time_s=when, noise_n=0.02,
        u_offset_n=0.0, u_white_rad=np.full(3, 1e-5),
    )  # fmt: skip
    (true,) = ModelResponse(start, (), [blank], 1e-8).curves([np.zeros(0)])[0] or []
    passed = np.cumsum(np.abs(np.diff(true, axis=0, prepend=0.0)) @ (1.0 / np.ptp(true, axis=0)))
    at = np.unique(np.searchsorted(passed, np.linspace(0.01, 0.99, 60) * passed[-1]))
    trial = replace(blank, force_n=measured, time_s=when[at], change_rad=true[at])
    runs = ModelResponse(start, (), [trial])
    left = residuals([trial], runs.curves([np.zeros(0)])[0] or [])[0]
    noise = rows(runs.jacobian(np.zeros(0), (), driven=True)[0])
    assert np.sqrt(np.mean(left**2)) > 5e-5
    assert left @ np.linalg.solve(noise @ noise.T + 1e-10 * np.eye(left.size), left) < 1.5 * left.size


@pytest.fixture(scope="module")
def pressed() -> ObservedTrial:
    """A stroke of 0.1 s, without curves."""
    when = np.linspace(0.0, 0.12, 121)
    force = 0.05 + np.interp(when, [0.02, 0.05, 0.12], [0.0, 8.0, 9.0])
    hammer = np.interp(when[20::5], [0.02, 0.08], [0.0, 1.0])
    return replace(
        toy.trial(1, np.column_stack(3 * [hammer])), force_time_s=when, force_n=force, time_s=when[20::5],
        preload_n=0.05, u_preload_n=0.01, u_offset_n=0.0, u_gain=5e-3, u_delay_s=1e-4, noise_n=1e-4,
    )  # fmt: skip


def test_planted_errors_of_the_force_are_found_beside_a_friction(pressed: ObservedTrial) -> None:
    start = model.load_action()
    free = unknowns(start, ["contact07.friction"], ["*"])
    planted = Case(free.asked[0].values(start, 0.5), gain=-1.0, level=2.0, delay=0.7)
    (curve,) = ModelResponse(start, free.moved, [pressed], 1e-8).run([[planted]])[0] or []
    noise = 1e-6 * np.random.default_rng(1).standard_normal(curve.shape)
    trial = replace(pressed, change_rad=curve + noise, u_white_rad=np.full(3, 1e-6), u_scale=np.full(3, 1e-6))
    found = fit(Problem(start, free, (trial,), ModelResponse(start, free.moved, (trial,))))
    width = np.sqrt(np.diag(found.covariance))
    assert found.converged
    assert np.all(np.abs(found.z - [0.5, -1.0, 2.0, 0.7]) < 3 * width)
    assert found.z[2] > 1.0 and width[2] < 0.6  # the level is known, and was moved


def test_the_scatter_of_a_fixed_law_is_learnt() -> None:
    rng = np.random.default_rng(3)
    trials = toy.made(np.zeros(3), 10, rng, scatter=0.0)
    p = toy.problem(trials)
    zero = np.zeros(3)
    law = np.stack([np.sin(31 * toy.TIME), np.cos(11 * toy.TIME), np.sin(5 * toy.TIME)], axis=1)[:, :, None] * 0.01
    p = replace(p, held=tuple(law for _ in trials))
    from_law = 0.3 * rng.standard_normal(10)
    residuals = [toy.rows_of(t.change_rad - c + s * law[:, :, 0]) for t, c, s in zip(
        trials, p.response.curves([zero])[0] or [], from_law, strict=True)]  # fmt: skip
    learnt = learn(toy.blocks_of(p, zero), residuals, Sizes.start(p.families, p.seen), 40)
    assert 0.15 < learnt.sizes.scatter[3] < 0.6
    assert np.all(learnt.sizes.scatter[:2] < 0.1)  # joints; the third is of the fixed law's family


class Kinked(toy.Toy):
    """A toy with a kink where its first value is 0.8."""

    def curve(self, z: Array) -> Array:
        return super().curve(z) + 4e-3 * abs(z[0] - 0.8) * np.cos(31 * toy.TIME)[:, None]

    def slope(self, z: Array) -> Array:
        out = super().slope(z)
        out[:, :, 0] += 4e-3 * np.sign(z[0] - 0.8 + 1e-12) * np.cos(31 * toy.TIME)[:, None]
        return out


def test_a_fit_settles_at_a_kink() -> None:
    truth = np.array([0.8, -0.5, 0.3])
    trials = toy.made(truth, 5, np.random.default_rng(2), scatter=0.02)
    found = fit(Problem(model.load_action(), toy.free(), tuple(trials), Kinked(trials)))
    width = np.sqrt(np.diag(found.covariance))
    assert found.converged and np.all(np.abs(found.z - truth) < 4 * width)


def test_a_step_that_no_run_confirmed_is_part_of_u() -> None:
    p = toy.problem(toy.made(np.array([0.8, -0.5, 0.3]), 5, np.random.default_rng(5), scatter=0.02))
    step = np.array([0.02, 0.0, 0.05])
    found = replace(fit(p), remaining=step)
    width = widen_by_jackknife(np.sqrt(np.diag(found.covariance)), jackknife(found), 5)
    u = [e.z_u for e in estimate_all(p, found, (), lambda text: None)]
    assert u == pytest.approx(np.hypot(width, step), rel=1e-9)


def test_the_step_ends_at_the_least_value_in_the_box() -> None:
    p = toy.problem(toy.made(np.array([0.8, -0.5, 0.3]), 3, np.random.default_rng(4)))
    zero = np.zeros(3)
    here = [toy.rows_of(t.change_rad - c) for t, c in zip(p.trials, p.response.curves([zero])[0] or [], strict=True)]
    marginal = Marginal(toy.blocks_of(p, zero), Sizes.start(p.families, p.seen))
    low, high = np.array([-4.0, -0.1, -4.0]), np.array([0.3, 4.0, 4.0])
    step = box_step(marginal, here, zero, (low, high), 0.0)
    root = np.linalg.cholesky(marginal.curvature).T
    best = lsq_linear(root, np.linalg.solve(root.T, marginal.slope(here, zero)), (low, high), tol=1e-12).x
    np.testing.assert_allclose(step, best, atol=1e-6)
    assert step[0] == 0.3 and step[1] == -0.1


def test_a_model_that_lacks_something_is_fitted_without_discrepancy_too_and_the_likelier_kept() -> None:
    truth = np.array([0.8, -0.5, 0.3])
    right = fit_multistart(toy.problem(toy.made(truth, 4, np.random.default_rng(1))))
    assert len(right) == 1 and right[0].converged and right[0].is_slight
    said: list[str] = []
    found = fit_multistart(toy.problem(toy.made(truth, 4, np.random.default_rng(1), lacking=5e-3)), 1, said.append)
    assert sum("without discrepancy" in line for line in said) == 3 and len(found) == 2
    assert found[0].converged and not found[0].is_slight
    assert not found[1].converged or found[0].badness <= found[1].badness
