"""The feed drops the oldest and counts what it dropped."""

from __future__ import annotations

import numpy as np

from rig.backend import Block
from rig.recording.options import BlockFeed


def test_a_viewer_that_sleeps_loses_the_oldest_blocks_only() -> None:
    feed = BlockFeed(capacity=3)
    for k in range(5):
        feed.publish(Block(k, np.zeros(1), np.zeros(1), np.zeros((1, 3), dtype=np.int64)))
    assert feed.dropped == 2
    assert [block.first_sample for block in feed.take()] == [2, 3, 4]
    assert feed.take() == []
