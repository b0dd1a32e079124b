"""The paced clock takes its time in every acquisition, however long nothing ran before."""

from __future__ import annotations

import pytest

from rig.simulated.bench.clock import PacedClock, VirtualClock


@pytest.mark.parametrize("speed", [1.0, 4.0])
def test_idle_time_is_not_made_up_for(speed) -> None:
    wall, waited = [100.0], []

    def wait(duration_s: float) -> None:
        waited.append(duration_s)
        wall[0] += duration_s

    clock = PacedClock(speed, wall_s=lambda: wall[0], wait=wait)
    wall[0] += 30.0  # a server that idles
    clock.begin()
    for _ in range(10):
        clock.advance(0.02)
    assert sum(waited) == pytest.approx(0.2 / speed)
    wall[0] += 0.01  # somebody is a little late within the acquisition: that is made up for
    clock.advance(0.02)
    clock.advance(0.08)
    assert sum(waited) == pytest.approx(0.3 / speed - 0.01)
    assert clock.elapsed_s == pytest.approx((wall[0] - 100.0) * min(speed, 1.0))


def test_virtual_time_only_counts() -> None:
    clock = VirtualClock()
    clock.begin()
    clock.advance(0.5)
    assert clock.now_s == clock.elapsed_s == 0.5
