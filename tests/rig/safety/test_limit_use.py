"""How much of its limits a trial has used: the interlocks' own values, however the samples come."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rig.backend import Block, Timing
from rig.configuration.rig_file import RigConfig, load_rig
from rig.errors import LimitExceeded
from rig.safety.interlocks import Interlocks, LimitUse, LimitWatch
from rig.session import Session, TrialData

EXAMPLE = Path(__file__).parents[3] / "sessions" / "example_forte"
LIMITS = {
    "force": "force_max_n",
    "force rate": "force_rate_n_per_s",
    "travel": "travel_rad",
    "speed": "speed_rad_per_s",
}


@pytest.fixture(scope="module")
def data() -> TrialData:
    return Session.open(EXAMPLE).trial(1).read()


def uses(config: RigConfig, data: TrialData, size: int) -> dict[str, LimitUse]:
    watch = LimitWatch(config, data.sample_rate_hz, data.encoder_count[0])
    for first in range(0, data.n_valid, size):
        rows = slice(first, first + size)
        watch.add(first, data.force_n[rows], data.encoder_count[rows])
    return {use.what: use for use in watch.uses}


def test_the_values_do_not_depend_on_the_blocks(data: TrialData) -> None:
    config = load_rig("virtual").config
    found = uses(config, data, data.n_valid)
    for size in (3, 100, 333):
        assert uses(config, data, size) == found
    assert set(found) == set(LIMITS)
    assert found["force"].value == data.force_n.max() and found["force"].share == pytest.approx(
        data.force_n.max() / 110
    )
    assert found["force rate"].value == pytest.approx(np.abs(np.diff(data.force_n)).max() * data.sample_rate_hz)
    share = np.abs(data.angle_rad()).max(axis=0) / config.limits.travel_rad
    assert (found["travel"].where, found["travel"].share) == ("key", pytest.approx(share.max()))


@pytest.mark.parametrize("what", LIMITS)
def test_a_share_of_one_is_where_the_interlock_stops(data: TrialData, what: str) -> None:
    given = load_rig("virtual").config
    used = uses(given, data, 100)[what]
    for factor, stops in ((0.999, True), (1.001, False)):
        limit = abs(used.value) * factor
        old = getattr(given.limits, LIMITS[what])
        body = ("key", "whippen", "hammer").index(used.where) if used.where else 0
        new = tuple(limit if i == body else 1e3 for i in range(3)) if isinstance(old, tuple) else limit
        config = given.model_copy(update={"limits": given.limits.model_copy(update={LIMITS[what]: new})})
        assert (uses(config, data, 100)[what].share > 1) == stops
        timing = Timing(data.sample_rate_hz, 0.0)
        interlocks = Interlocks(config, timing, np.zeros(data.n_valid), data.blow_start_s)
        try:
            for first in range(0, data.n_valid - 100, 100):
                rows = slice(first, first + 100)
                interlocks.check(Block(first, data.force_n[rows], data.force_raw[rows], data.encoder_count[rows]))
            stopped = False
        except LimitExceeded as fault:
            stopped = "allowed" in str(fault)
        assert stopped == stops


def test_no_number_is_beyond_every_limit_and_a_gap_is_no_jump() -> None:
    config = load_rig("virtual").config
    watch = LimitWatch(config, 5000.0, np.zeros(3, dtype=np.int64))
    watch.add(0, np.array([1.0, 2.0]), np.zeros((2, 3), dtype=np.int64))
    watch.add(5000, np.array([60.0, 61.0]), np.zeros((2, 3), dtype=np.int64))
    assert {use.what: use.value for use in watch.uses}["force rate"] == pytest.approx(5000.0)
    watch.add(5002, np.array([np.nan]), np.zeros((1, 3), dtype=np.int64))
    force = next(use for use in watch.uses if use.what == "force")
    assert np.isinf(force.share) and force.time_s == 5002 / 5000.0
    watch.add(5003, np.array([-6.0]), np.zeros((1, 3), dtype=np.int64))
    assert np.isinf(next(use for use in watch.uses if use.what == "force").share)
