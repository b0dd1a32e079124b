"""Names beside their points: none on another name or on a point."""

from __future__ import annotations

import numpy as np
import pytest

from model.inside.animation import LETTER_WIDTH, NAME_HEIGHT, _name_offsets


@pytest.mark.parametrize("seed", range(5))
def test_names_of_a_crowd_do_not_overlap(seed: int) -> None:
    random = np.random.default_rng(seed)
    points = random.uniform(0.0, 60.0, (12, 2))  # thirteen contacts and five bodies stand wider apart
    names = ["01"] * 9 + ["whippen", "jack", "repetition"]
    middle = points + _name_offsets(points, names)
    half = np.column_stack(
        [0.5 * LETTER_WIDTH * np.array([len(name) for name in names]), np.full(12, 0.5 * NAME_HEIGHT)]
    )
    for i in range(12):
        for j in range(i):
            assert np.any(np.abs(middle[i] - middle[j]) >= half[i] + half[j] - 1e-9), (i, j)
        assert np.hypot(*(middle[i] - points[i])) < 50.0


def test_a_name_alone_is_close_to_its_point() -> None:
    assert np.hypot(*_name_offsets(np.zeros((1, 2)), ["07"])[0]) < 12.0
