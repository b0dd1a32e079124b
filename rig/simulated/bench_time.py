"""The mechanics and sensors of the bench between two edges of the sample clock that runs.

Place in the data flow: the device says how many edges pass and what its analog output holds at each; this asks the
plant and turns its state into what stands at the terminals: the load cell's millivolts per volt and the scales'
counts. A new trial begins, at rest, each time a task with a clock of its own starts.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rig.simulated.clock import Clock
from rig.simulated.contract import Plant
from rig.simulated.converters import DelayLine
from rig.simulated.sensors import EncoderSignals, ForceSignal, SensorSet


class BenchTime:
    """Plant, sensors and clock of the virtual bench; ``trial`` and ``edge`` tell where it is."""

    def __init__(self, plant: Plant, sensors: SensorSet, clock: Clock) -> None:
        self.plant = plant
        self.sensors = sensors
        self.clock = clock
        self.trial = 0
        self.edge = 0
        self._delay = DelayLine(0.0)
        self._force: ForceSignal | None = None
        self._encoders: EncoderSignals | None = None
        self._last_force_n = np.zeros(1)
        self._last_angle_rad = np.zeros((1, 3))
        self._last_lift_m: NDArray[np.float64] | None = None

    @property
    def rate_hz(self) -> float:
        """Rate of the edges, Hz."""
        return self.plant.sample_rate_hz

    def begin(self, trial: int, rate_hz: float, input_delay_s: float) -> None:
        """Put the bench at rest for a new trial whose edges come at ``rate_hz``."""
        self.trial, self.edge = trial, 0
        self.plant.sample_rate_hz = rate_hz
        self.plant.start_trial(trial)
        self._force = ForceSignal(self.sensors.force, self.sensors.seed, trial)
        self._encoders = EncoderSignals(self.sensors.encoders, self.sensors.seed, trial)
        self._delay = DelayLine(input_delay_s * rate_hz)

    def step(self, command_v: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Let n edges pass; return the cell's output at each, mV/V (n,), and the counts (n, 3)."""
        if self._force is None or self._encoders is None:
            raise RuntimeError("the bench has no trial yet")
        block = self.plant.advance(command_v)
        n = command_v.size
        time_s = (self.edge + np.arange(n)) / self.rate_hz
        cell = self._force.millivolts_per_volt(self._delay.push(block.force_n), time_s)
        self._last_force_n, self._last_angle_rad = block.force_n[-1:], block.angle_rad[-1:]
        self._last_lift_m = None if block.key_lift_m is None else block.key_lift_m[-1:]
        self.edge += n
        self.clock.advance(n / self.rate_hz)
        return cell, self._encoders.quarter_counts(block.angle_rad, block.key_lift_m)

    def present(self) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Return what stands at the terminals now, (1,) and (1, 3), without letting time pass."""
        if self._force is None or self._encoders is None:
            self.begin(0, self.rate_hz, 0.0)
            return self.step(np.zeros(1))
        cell = self._force.millivolts_per_volt(self._last_force_n, np.array([self.edge / self.rate_hz]))
        return cell, self._encoders.quarter_counts(self._last_angle_rad, self._last_lift_m)
