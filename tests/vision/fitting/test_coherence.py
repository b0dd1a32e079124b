"""Which blocks of a template tell how coherent residuals are."""

from __future__ import annotations

import numpy as np
import pytest

from vision.fitting.assessment import LEAST_BLOCKS, N_LEVELS, build_blocks, coherence_ratios
from vision.fitting.template import build_template


def _median_ratio(width: int, height: int, draws: int = 60) -> np.ndarray:
    """Median ratio (3, 3) of least squares on white noise for a body of so many pixels."""
    rng = np.random.default_rng(width)
    picture = rng.normal(120.0, 30.0, (height + 20, width + 20))
    mask = np.zeros(picture.shape, dtype=bool)
    mask[10:-10, 10:-10] = True
    template = build_template("small", picture, mask, 10, noise_grey=1.0)
    design = np.vstack([template.columns.astype(float), np.ones(template.n_pixels)])
    inverse, blocks = np.linalg.inv(template.normal), build_blocks(template.offset_px)
    found = []
    for _ in range(draws):
        residual = rng.standard_normal(template.n_pixels)
        residual -= (inverse @ (design @ residual)) @ design
        work = np.ones((3, template.n_pixels), dtype=np.float32)
        work[2] = residual
        white = np.diag(inverse)[:3] * np.mean(residual**2)
        weight = np.ones(template.n_pixels, dtype=np.float32)
        found.append(coherence_ratios(blocks, template.columns, work, weight, inverse[:3], white).ratio)
    return np.asarray(np.median(found, axis=0))


@pytest.mark.parametrize(("width", "height"), [(96, 64), (34, 30)])
def test_white_noise_is_white_on_large_and_small_bodies(width: int, height: int) -> None:
    ratio = _median_ratio(width, height)
    assert np.all((ratio > 0.5) & (ratio < 1.3))


def test_levels_with_too_few_blocks_are_left_to_smaller_ones() -> None:
    x, y = np.meshgrid(np.arange(34.0), np.arange(30.0))
    blocks = build_blocks(np.stack([x.ravel(), y.ravel()]).astype(np.float32))
    count = blocks.groups.max(axis=1) + 1
    assert count[0] >= LEAST_BLOCKS and len(count) == N_LEVELS
    assert np.all(count >= LEAST_BLOCKS) and np.all(np.isfinite(blocks.freedom))


def test_a_body_of_a_few_blocks_says_nothing_of_coherence() -> None:
    """Five blocks, whose sums the five parameters make vanish: their ratio is rounding over rounding."""
    assert np.all(_median_ratio(13, 12) == 0.0)
