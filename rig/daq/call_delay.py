"""How long one call of the driver takes, and whether the bench can be watched over at that speed.

A block needs a number of calls one after the other, and the watchdog is reset between them. Both must fit: the calls of
a block into the block's own time, or the program falls behind the motor; and the longest time between two resets into
the watchdog's timeout. It is measured before anything moves. Blocks are lengthened up to 50 ms for a slow connection;
what needs more is refused, because limits would act too late.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from rig.configuration.rig_file import RigConfig
from rig.errors import NotSupported

PROBES = 5
CALLS_BETWEEN_RESETS = 4
"""Most calls between two resets of the watchdog before the master starts, the reset among them."""
RESERVE = 0.5
"""Part of the watchdog's timeout that those calls may use."""
RESETS_IN_TIMEOUT = 8
"""While blocks are read the watchdog is reset about so often in its timeout."""


LENGTHENED_S = 0.05
"""Longest block that replaces a shorter ``recording.block_s`` without being asked for, s."""


DEAR = 0.05
"""Part of a block's time that its calls may take before blocks are lengthened while the motor's command is 0 V."""


LONGEST_USEFUL_S = 0.4
"""A longer block is not proposed: limits that act so late protect nothing."""


@dataclass(frozen=True)
class CallDelay:
    """Time one driver call takes, s: the median, and the longest of a few."""

    usual_s: float
    longest_s: float


def measure(call: Callable[[], object], now_s: Callable[[], float]) -> CallDelay:
    """Time a cheap call of the driver a few times on the clock that the device's watchdog runs by."""
    taken = []
    for _ in range(PROBES):
        began = now_s()
        call()
        taken.append(now_s() - began)
    return CallDelay(float(np.median(taken)), max(taken))


def calls_per_block(config: RigConfig) -> int:
    """Return the driver calls of one block: one read a task, the state of the generation, the watchdog's reset."""
    counted = config.camera is not None and config.camera.mode == "counted"
    further = int(counted) + int(config.key_opposite is not None)
    return 1 + len(config.encoders) + further + 1 + int(config.watchdog is not None)


def calm_block_s(config: RigConfig, delay: CallDelay) -> float:
    """Return the length of blocks in which the motor's command is 0 V, s: 0 where calls are cheap.

    Through a server each call costs processor time at both ends; where nothing is commanded the limits may act as late
    as on a slow connection.
    """
    cheap = calls_per_block(config) * delay.usual_s <= DEAR * config.recording.block_s
    return 0.0 if cheap or config.recording.block_s >= LENGTHENED_S else LENGTHENED_S


def shortest_block_s(config: RigConfig, delay: CallDelay) -> float:
    """Return the shortest block the bench can be read in, s: 0 where ``recording.block_s`` will do.

    Raises
    ------
    NotSupported
        When driver calls are too slow for the longest block or for the watchdog, with the delay measured, what is
        allowed, and what to change.
    """
    calls, block_s = calls_per_block(config), config.recording.block_s
    longest_s = max(block_s, LENGTHENED_S)
    needed_s = calls * delay.usual_s
    allowed = {f"blocks of at most {longest_s:g} s": longest_s / calls}
    remedy = [f"recording.block_s from {1.2 * needed_s:.2g} s"]
    if config.watchdog is not None:
        timeout_s = config.watchdog.timeout_s
        between_s = max(CALLS_BETWEEN_RESETS * delay.longest_s, calls * delay.longest_s + max(block_s, needed_s))
        allowed["the watchdog's timeout"] = min(
            RESERVE * timeout_s / CALLS_BETWEEN_RESETS, max(0.8 * timeout_s - block_s, 0.0) / calls
        )
        remedy.append(f"watchdog.timeout_s from {max(timeout_s, between_s / RESERVE, 2.4 * needed_s):.2g} s")
    slow = [
        f"{least * 1e3:.3g} ms by {name}"
        for name, least in allowed.items()
        if (delay.longest_s if "watchdog" in name else delay.usual_s) > least
    ]
    if slow:
        advice = "use a faster link"
        if 1.2 * needed_s <= LONGEST_USEFUL_S:
            advice += f", or set {' and '.join(remedy)}: limits then act that much later"
        raise NotSupported(
            f"device {config.device.name}: a driver call takes {delay.usual_s * 1e3:.3g} ms, at most "
            f"{delay.longest_s * 1e3:.3g} ms; allowed {' and '.join(slow)} ({calls} calls a block); nothing has moved; "
            f"{advice}",
            phase="configure",
        )
    return needed_s if needed_s > block_s else 0.0
