"""Axes and the order of names do not hang on what LAPACK leaves open."""

from __future__ import annotations

import numpy as np
import pytest

from validation.infer.identifiability import directions
from validation.prediction.posterior import make_posterior, order_by_size, principal_axes

NAMES = ("a", "b", "c")
ALIKE = np.array([[0.5, -0.499, 0.0], [-0.499, 0.5, 0.0], [0.0, 0.0, 0.1]])
"""Of a and b the strokes tell the sum, and nothing of the difference: components of equal size."""


@pytest.fixture(params=[(1.0, 0.0), (-1.0, 0.0), (1.0, 1e-13), (-1.0, -1e-13)])
def other_lapack(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Another sign of every axis, and rounding that makes one of two equal components larger."""
    sign, more = request.param
    eigh = np.linalg.eigh

    def rounded(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        values, axes = eigh(matrix)
        return values, sign * (axes + more * np.arange(len(axes))[:, None])

    monkeypatch.setattr(np.linalg, "eigh", rounded)


def test_axes_are_the_same_for_any_sign(other_lapack: None) -> None:
    values, axes = principal_axes(ALIKE)
    np.testing.assert_allclose(values, [0.001, 0.1, 0.999], atol=1e-12)
    half = np.sqrt(0.5)
    np.testing.assert_allclose(axes, [[half, 0.0, half], [half, 0.0, -half], [0.0, 1.0, 0.0]], atol=1e-9)


def test_names_come_in_the_same_order(other_lapack: None) -> None:
    undetermined, determined = directions(NAMES, ALIKE)
    assert undetermined and all(list(d.weights) == sorted(d.weights) for d in (*undetermined, *determined))


def test_what_a_posterior_draws_along_is_the_same(other_lapack: None) -> None:
    moved = [(name, (name,), 1.0, False) for name in NAMES]
    axes = make_posterior(moved, ALIKE, {}).directions
    assert np.all(axes[np.arange(len(axes)), [order_by_size(axis)[0] for axis in axes]] > 0.0)
