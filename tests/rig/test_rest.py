"""Rest: still encoders and force back, for a whole window."""

from __future__ import annotations

import numpy as np
import pytest

from rig.rest import RestDetector


@pytest.fixture
def detector() -> RestDetector:
    return RestDetector(window=100, earliest=200, baseline=50, counts=1, force_n=0.2)


def still(n: int) -> tuple[np.ndarray, np.ndarray]:
    force, count = np.full(n, 0.3), np.zeros((n, 3), dtype=np.int64)
    count[150:] = (40, -7, 3)  # rests somewhere else than it began
    return force, count


def test_at_rest_once_a_whole_window_after_the_blow_is_still(detector) -> None:
    assert not detector.at_rest(*still(299))
    assert detector.at_rest(*still(300))


def test_a_toggling_count_is_rest_and_a_creeping_one_is_not(detector) -> None:
    force, count = still(400)
    count[300:, 1] += np.arange(100) % 3 - 1
    assert detector.at_rest(force, count)
    count[399, 2] += 3
    assert not detector.at_rest(force, count)


def test_force_must_be_back_in_its_band_but_may_be_noisy(detector) -> None:
    force, count = still(400)
    noisy = force + 0.5 * np.where(np.arange(400) % 2, 1, -1)
    assert detector.at_rest(noisy, count)
    force[300:] += 0.25
    assert not detector.at_rest(force, count)
