"""Ten planted directions that data say nothing of: all named, none wrongly."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import null_space

from validation.conventions import Array
from validation.infer.identifiability import directions, warnings_of

NAMES = tuple(f"p{i:02d}" for i in range(30))
# only these are seen of their members: products, ratios, sums with weights; then what is not seen at all
SEEN = (
    {0: 1.0, 1: 1.0}, {2: 1.0, 3: -1.0}, {4: 1.0, 5: 0.6}, {6: 0.7, 7: -1.0}, {8: 1.0, 9: 1.0, 10: 0.8},
    {11: 1.0, 12: -0.9, 13: 1.0, 14: 0.7},
)  # fmt: skip
UNSEEN = (15,)
FREE = range(16, 30)


def planted(rng: np.random.Generator) -> tuple[Array, Array]:
    """Covariance (30, 30) after some data, and a basis (30, 10) of what they say nothing of."""
    rows = [np.zeros(30) for _ in SEEN]
    for row, members in zip(rows, SEEN, strict=True):
        for i, weight in members.items():
            row[i] = weight
    seen = np.array(rows + [np.eye(30)[i] for i in FREE])
    data = rng.standard_normal((60, len(seen))) * 10 ** rng.uniform(0.3, 2.0, len(seen))
    x = data @ seen
    return np.linalg.inv(np.eye(30) + x.T @ x), null_space(seen)


@pytest.mark.parametrize("seed", range(12))
def test_ten_planted_null_directions_are_named_and_no_other(seed: int) -> None:
    covariance, null = planted(np.random.default_rng(seed))
    assert null.shape[1] == 10
    undetermined, determined = directions(NAMES, covariance)
    assert len(undetermined) == 10 and len(determined) == 20
    groups = [{NAMES[i] for i in members} for members in SEEN] + [{NAMES[i]} for i in UNSEEN]
    found = np.zeros((30, 10))
    for column, d in zip(found.T, undetermined, strict=True):
        assert sum(set(d.weights) <= group for group in groups) == 1, d.words
        for name, weight in d.weights.items():
            column[NAMES.index(name)] = weight
        column /= np.linalg.norm(column)
        assert np.linalg.norm(null.T @ column) > 0.999, d.words
        assert d.left > 0.95
    assert np.linalg.matrix_rank(found, tol=1e-3) == 10
    said = " ".join(warnings_of(NAMES, covariance))
    assert all(any(NAMES[i] in line for line in said.split("these strokes")) for g in SEEN for i in g)
    assert not any(NAMES[i] in said for i in FREE)


def test_where_all_is_known_nothing_is_named() -> None:
    assert directions(NAMES[:4], 0.01 * np.eye(4))[0] == [] and warnings_of(NAMES[:4], 0.01 * np.eye(4)) == []
