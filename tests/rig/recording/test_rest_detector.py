"""Rest: still encoders and force back, for a whole window."""

from __future__ import annotations

import numpy as np
import pytest

from rig.recording.trial_run import RestDetector


def ends(force: np.ndarray, count: np.ndarray, block: int = 100) -> int | None:
    """Feed a record in blocks; return the number of samples after which rest is seen."""
    detector = RestDetector(window=100, earliest=200, baseline=50, counts=1, force_n=0.2)
    for start in range(0, force.size, block):
        if detector.add(force[start : start + block], count[start : start + block]):
            return min(start + block, force.size)
    return None


def still(n: int) -> tuple[np.ndarray, np.ndarray]:
    force, count = np.full(n, 0.3), np.zeros((n, 3), dtype=np.int64)
    count[150:] = (40, -7, 3)  # rests somewhere else than it began
    return force, count


@pytest.mark.parametrize(("block", "seen"), [(1, 300), (7, 301), (100, 300), (90, 360), (1000, 1000)])
def test_at_rest_once_a_whole_window_after_the_blow_is_still_however_it_is_read(block, seen) -> None:
    assert ends(*still(1000), block) == seen
    assert ends(*still(299), block) is None


def test_a_toggling_count_is_rest_and_a_creeping_one_is_not() -> None:
    force, count = still(400)
    count[200:, 1] += np.arange(200) % 3 - 1
    assert ends(force, count) == 300
    creeping = still(2000)[1]
    creeping[:, 2] += np.arange(2000) // 20
    assert ends(np.full(2000, 0.3), creeping) is None
    creeping[1000:, 2] = 7
    assert ends(np.full(2000, 0.3), creeping) == 1100


def test_force_must_be_back_in_its_band_but_may_be_noisy() -> None:
    force, count = still(2000)
    noise = 0.5 * np.where(np.arange(2000) % 2, 1, -1)
    assert ends(force + noise, count) == 300
    force[100:1000] += 0.25
    assert ends(force, count) == 1100
    assert ends(force + np.where(np.arange(2000) > 60, 0.25, 0), count) is None
