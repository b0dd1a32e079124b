"""What a self-test asks of a backend beside the recorder's contract (:mod:`rig.backend`)."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rig.backend import Backend, Expiry
from rig.configuration.rig_file import RigConfig


class SelftestBackend(Backend, Protocol):
    """A backend with the calls only a self-test makes (:mod:`rig.daq.bench_checks`)."""

    def shunt_step(self, config: RigConfig) -> float:
        """Return the change of the bridge's reading with its shunt resistor, mV/V."""

    def count_edges(self, config: RigConfig, counter: str, terminal: str, duration_s: float, pulses: bool) -> int:
        """Return the rising edges on a terminal."""

    def loopback_read(self, config: RigConfig, channel: str, command_v: ArrayLike) -> NDArray[np.float64]:
        """Return what an input wired to the motor's output reads, V."""

    def let_watchdog_expire(self, n_samples: int, blocks: int) -> Expiry:
        """Read without resetting the watchdog; the blocks, in which it expired, and whether the device ended it."""
