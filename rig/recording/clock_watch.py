"""Notice that the computer's wall clock was set while a session is recorded."""

from __future__ import annotations

from collections.abc import Callable

JUMP_S = 1.0  # a wall clock that goes wrong by more against the monotonic one has been set


class ClockWatch:
    """Compares the computer's wall clock with its monotonic one; both are read by ``wall_s`` and ``monotonic_s``."""

    def __init__(self, wall_s: Callable[[], float], monotonic_s: Callable[[], float]) -> None:
        self._wall_s, self._monotonic_s = wall_s, monotonic_s
        self._off_s = wall_s() - monotonic_s()

    def jump(self) -> str:
        """Return in words by how much the wall clock was set, against the monotonic one, since the last call; empty
        where that is not more than 1 s."""
        off_s = self._wall_s() - self._monotonic_s()
        jump_s, self._off_s = off_s - self._off_s, off_s
        if abs(jump_s) <= JUMP_S:
            return ""
        return (
            f"the computer's clock went {'forward' if jump_s > 0 else 'back'} by {abs(jump_s):.1f} s; times of day "
            "before and after do not compare, the samples' times are those of the device and not affected"
        )
