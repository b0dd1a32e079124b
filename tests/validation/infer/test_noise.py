"""Sizes of noise: derivatives, pooling by family, a discrepancy like laws, strokes kept aside."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.random import Generator
from scipy.stats import multivariate_normal

from validation.conventions import Array
from validation.infer.blocks import INSTRUMENT, Block
from validation.infer.noise import FLOOR, Marginal, Sizes, held_out_score, scores, select_noise_model

SMALL = 9  # phases


def made_blocks(rng: Generator, sessions: int, trials: int, laws: int) -> list[Block]:
    """Blocks of a made-up action: two parameters are free, all other laws fixed."""
    t = np.linspace(0.0, 0.05, SMALL)
    shapes = rng.standard_normal((sessions, 3 * SMALL, laws))
    out = []
    for s in range(sessions):
        for _ in range(trials):
            law = shapes[s] * (1 + 0.1 * rng.standard_normal(laws))
            size = np.sqrt((law**2).sum(axis=1)).reshape(3, SMALL)
            instrument = 1e-3 * rng.standard_normal((3 * SMALL, len(INSTRUMENT)))
            own = 1e-3 * rng.standard_normal((3 * SMALL, 2))
            out.append(
                Block(s, t, law[:, :2], law[:, 2:], instrument, own, np.full(3 * SMALL, 1e-6), size, t / t.max())
            )
    return out


def families(laws: int) -> Array:
    """Contacts' friction, then stiffness, half and half."""
    return np.where(np.arange(laws) < laws // 2, 0, 3)


def drawn(blocks: list[Block], sizes: Sizes, rng: Generator) -> list[Array]:
    """Residuals at z = 0 as the model of these sizes has them."""
    marginal = Marginal(blocks, sizes)
    shared = np.concatenate(
        [rng.standard_normal(marginal.shared), *(rng.standard_normal(len(r)) for r in marginal.roots.values())]
    )
    out = []
    for b, (lower, _) in zip(blocks, marginal.white, strict=True):
        out.append(
            marginal.design(b) @ shared[marginal.columns_of(b.session)] + lower @ rng.standard_normal(len(lower))
        )
    return out


def planted(blocks: list[Block], contacts: float, felts: float, common: float) -> Sizes:
    """Sizes with these scatters and this discrepancy."""
    sessions = 1 + max(b.session for b in blocks)
    start = Sizes.start(families(blocks[0].moved.shape[1] + blocks[0].held.shape[1]), np.ones((sessions, 3)))
    by_family = np.array([contacts, 0.05, 0.05, felts, 0.05])
    return replace(
        start, by_family=by_family, own=np.full((sessions, 3), 3e-3), common=np.full_like(start.common, common)
    )


def test_derivatives_of_the_likelihood_and_shares_are_those_of_differences() -> None:
    rng = np.random.default_rng(1)
    blocks = made_blocks(rng, 2, 2, 6)
    sizes = planted(blocks, 0.1, 0.03, 0.2)
    y = drawn(blocks, sizes, rng)
    found, log, h = scores(Marginal(blocks, sizes), y), sizes.log(), 3e-4
    for i in (0, 3, 5, 9, 11, 14, 20, 22, 23, 36):
        ends = [Marginal(blocks, sizes.at(log + sign * h * (np.arange(log.size) == i))) for sign in (1, -1)]
        up, down = (m.log_likelihood(y) for m in ends)
        assert found.slope[i] == pytest.approx(-(up - down) / (2 * h), rel=1e-3, abs=1e-3)
        wide = [np.log(np.diag(m.covariance)[:2]) for m in ends]
        np.testing.assert_allclose(found.shares[:, i], (wide[0] - wide[1]) / (4 * h), rtol=1e-3, atol=1e-7)


def test_families_that_scatter_and_those_that_do_not_are_told_apart() -> None:
    rng = np.random.default_rng(2)
    for contacts, felts in ((0.07, 0.003), (0.003, 0.07)):
        blocks = made_blocks(rng, 1, 5, 12)
        y = drawn(blocks, planted(blocks, contacts, felts, FLOOR), rng)
        start = planted(blocks, 0.05, 0.05, 0.1)
        found = select_noise_model(blocks, y, start, 40).sizes
        assert found.by_family[0] == pytest.approx(contacts, rel=0.6)
        assert found.by_family[3] == pytest.approx(felts, rel=0.6)
        np.testing.assert_array_equal(found.scatter[:6], found.by_family[0])


def test_a_discrepancy_like_laws_is_found_and_kept_in_the_intervals() -> None:
    rng = np.random.default_rng(3)
    for _ in range(3):
        blocks = made_blocks(rng, 1, 4, 12)
        sizes = planted(blocks, 0.02, 0.02, 0.01)
        other = 0.6 * rng.standard_normal(12)  # every law is another one in this session
        y = [r + np.hstack([b.moved, b.held]) @ other for r, b in zip(drawn(blocks, sizes, rng), blocks, strict=True)]
        found = select_noise_model(blocks, y, planted(blocks, 0.05, 0.05, 0.3), 40)
        like_laws = found.sizes.common[0, -1]
        assert like_laws > 0.1
        assert np.all(np.sqrt(np.diag(found.covariance)[:2]) > 0.7 * like_laws)


def test_strokes_kept_aside_are_scored_by_what_the_others_predict() -> None:
    rng = np.random.default_rng(4)
    blocks = made_blocks(rng, 2, 2, 6)
    sizes = planted(blocks, 0.1, 0.03, 0.2)
    y = drawn(blocks, sizes, rng)
    marginal = Marginal(blocks, sizes)
    n = y[0].size
    design = np.zeros((4 * n, marginal.q))
    own = np.zeros((4 * n, 4 * n))
    for k, (b, (lower, _)) in enumerate(zip(blocks, marginal.white, strict=True)):
        part = slice(k * n, (k + 1) * n)
        design[part, marginal.columns_of(b.session)] = marginal.design(b)
        own[part, part] = lower @ lower.T
    whole, data = design @ design.T + own, np.concatenate(y)
    total = 0.0
    for aside in (slice(0, 2 * n), slice(2 * n, 4 * n)):
        rest = np.setdiff1d(np.arange(4 * n), np.arange(4 * n)[aside])
        gain = whole[aside][:, rest] @ np.linalg.inv(whole[np.ix_(rest, rest)])
        spread = whole[aside, aside] - gain @ whole[rest][:, aside]
        total += multivariate_normal.logpdf(data[aside], gain @ data[rest], 0.5 * (spread + spread.T))
    constant = -0.5 * data.size * np.log(2 * np.pi)
    assert held_out_score(marginal, y) + constant == pytest.approx(total, rel=1e-6)


def test_a_discrepancy_that_one_kind_hides_is_made_larger_by_the_kind_kept_aside() -> None:
    rng = np.random.default_rng(5)
    blocks = made_blocks(rng, 2, 3, 6)
    true = planted(blocks, 0.02, 0.02, 0.2)
    y = drawn(blocks, true, rng)
    marginal = Marginal(blocks, true)
    right = held_out_score(marginal, y)
    for factor in (0.1, 10.0):
        assert held_out_score(Marginal(blocks, true.grown(factor)), y) < right


def test_what_a_trial_has_of_its_own_is_in_each_channel_as_large_as_stated() -> None:
    blocks = made_blocks(np.random.default_rng(7), 1, 1, 4)
    sizes = planted(blocks, 0.1, 0.03, 0.2)
    (plain, _), (wide, _) = (
        Marginal(blocks, replace(sizes, own=np.array([own]))).white[0] for own in ((3e-3,) * 3, (3e-3, 3e-2, 3e-3))
    )
    change = np.diag(wide @ wide.T - plain @ plain.T).reshape(3, SMALL)
    np.testing.assert_allclose(change[1], (3e-2**2 - 3e-3**2) * blocks[0].size[1] ** 2, rtol=1e-5)
    np.testing.assert_allclose(change[[0, 2]], 0.0, atol=1e-12 * change.max())
