"""A trial of minutes: memory stays flat from the first block to the seal, and every sample is there.

Rest: still encoders and force back, for a whole window.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from rig import Block, Progress, Rig, Session, load_rig, parse_profile, parse_rig
from rig import record as record_session
from rig.recording.rest_detector import RestDetector
from rig.session.live_view import SessionFollower
from tests.rig.fake_backend import RATE_HZ as RATE
from tests.rig.fake_backend import FakeBackend
from tests.rig.lab_channels import READBACK
from tests.rig.recording.memory_growth import Growth


def samples(first: int, n: int) -> Block:
    """Eight channels: the force and four further voltages, three encoders."""
    k = np.arange(first, first + n)
    force_n = 0.05 + 1e-3 * (k % 7)
    count = np.zeros((n, 3), dtype=np.int64) + (k // 50_000)[:, None]
    return Block(first, force_n, force_n / 50, count, None, np.column_stack([np.sin(k * (1 + c)) for c in range(4)]))


@pytest.fixture
def long_rig() -> Rig:
    tables = [READBACK.replace("motor_readback", f"further_{k}").replace("ai1", f"ai{k}") for k in range(1, 5)]
    text = load_rig("pcie6363").text.replace("block_s = 0.02", "block_s = 0.1")
    return parse_rig(text + "".join(tables))


def record_held(folder: Path, rig: Rig, duration_s: float, progress: Callable[[Progress], None]) -> Session:
    profile = parse_profile(
        f'name = "held"\npoints = [{{time_s=0,force_n=0}},{{time_s=0.1,force_n=1}},'
        f"{{time_s={duration_s - 0.1},force_n=1}},{{time_s={duration_s},force_n=0}}]"
    )
    return record_session(
        folder, profile=profile, rig_config=rig, backend=FakeBackend(samples), trials=1, progress=progress
    )


def checked(session: Session, duration_s: float) -> None:
    data = session.trials[0].read()
    assert data.status == "complete" and data.n_valid >= duration_s * RATE and len(data.channels) == 4
    want = samples(0, data.n_valid)
    np.testing.assert_array_equal(data.raw_force_n, want.force_n)
    np.testing.assert_array_equal(data.channel_values, want.channel_values)
    np.testing.assert_array_equal(data.time_s, np.arange(data.n_valid) / RATE)


def test_memory_does_not_grow_during_a_trial_nor_when_it_is_sealed(tmp_path, long_rig) -> None:
    with Growth(after_s=2.0) as growth:
        session = record_held(tmp_path / "s", long_rig, 35.0, growth)
    samples_mb = 35 * RATE * 8 * 10 / 1e6  # force, its reading, time, three counts, four voltages
    assert growth.mb < 4.0 < samples_mb / 3  # the part that is being sealed
    checked(session, 35.0)


def test_a_live_view_keeps_the_last_half_minute_and_the_angles_from_the_start(tmp_path, long_rig) -> None:
    views = []
    follower: list[SessionFollower] = []

    def progress(at: Progress) -> None:
        follower[:] = follower or [SessionFollower(tmp_path / "s")]
        if at.time_s > 35.0 or round(50 * at.time_s) % 20 == 0:  # each 0.4 s; a look at all there is takes 2 ms
            views.append(follower[0].poll())

    record_held(tmp_path / "s", long_rig, 35.0, progress)
    last = views[-1]
    assert last.time_s[-1] > 35.0 and 29.9 < np.ptp(last.time_s) < 30.2
    assert last.angle_rad[-1, 0] == pytest.approx(3 * 2 * np.pi / 327680)  # a count every 10 s


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
