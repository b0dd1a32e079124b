"""Reading of the bench while the motor is off."""

from __future__ import annotations

from collections.abc import Callable

from rig.backend import CALL_TIMEOUT_S, Backend, Block
from rig.configuration.rig_file import RigConfig


def read_quiet(
    backend: Backend, config: RigConfig, block_s: float, longest_s: float, take: Callable[[Block, float], bool]
) -> None:
    """Read blocks of ``block_s``, the motor off, until ``take(block, sample_rate_hz)`` returns True, at most for
    ``longest_s``; the backend is stopped safely in any case."""
    timing = backend.configure(config.model_copy(update={"camera": None, "watchdog": None}), None)
    rate = timing.sample_rate_hz
    size = max(int(block_s * rate), 1)
    try:
        backend.arm(enable_drive=False)
        backend.start()
        for _ in range(int(longest_s * rate) // size):
            if take(backend.read_block(size, CALL_TIMEOUT_S), rate):
                break
    finally:
        backend.safe_stop()
