"""A bounded feed of recorded blocks for live viewers: it drops the oldest and never blocks the recorder."""

from __future__ import annotations

import threading
from collections import deque

from rig.backend import Block


class BlockFeed:
    """At most ``capacity`` blocks waiting for a viewer; thread-safe."""

    def __init__(self, capacity: int = 50) -> None:
        self._blocks: deque[Block] = deque(maxlen=capacity)
        self._lock = threading.Lock()
        self._dropped = 0

    @property
    def dropped(self) -> int:
        """Blocks dropped because no viewer took them in time."""
        return self._dropped

    def publish(self, block: Block) -> None:
        """Add a block; returns at once."""
        with self._lock:
            if len(self._blocks) == self._blocks.maxlen:
                self._dropped += 1
            self._blocks.append(block)

    def take(self) -> list[Block]:
        """Remove and return all waiting blocks, oldest first."""
        with self._lock:
            blocks = list(self._blocks)
            self._blocks.clear()
            return blocks
