"""The mechanics and sensors of the bench between two edges of the sample clock that runs.

The device says how many edges pass and what volts its analog output is at; the plant answers, and its state becomes
what stands at the terminals: the load cell's millivolts per volt and the encoders' counts. A new trial begins, at rest,
whenever a task with a sample clock of its own starts while nothing else runs.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rig.simulated.bench import virtual_operator
from rig.simulated.bench.adc import DelayLine
from rig.simulated.bench.clock import Clock
from rig.simulated.bench.plant_protocol import Plant
from rig.simulated.bench.pulse_train import PulseTrain
from rig.simulated.bench.sensors import EncoderSignals, ForceSignal, SensorSet
from rig.simulated.bench.virtual_pianist import VirtualPianist

_CAMERA_STREAM = 4


class BenchTime:
    """Plant, sensors and clock of the virtual bench, at edge ``edge`` of trial ``trial``."""

    def __init__(self, plant: Plant, sensors: SensorSet, clock: Clock) -> None:
        self.plant = plant
        self.sensors = sensors
        self.clock = clock
        self.trial = 0
        self.edge = 0
        self._delay = DelayLine(0.0)
        self._force: ForceSignal | None = None
        self._encoders: EncoderSignals | None = None
        self.operator_acts = False
        """Whether the virtual operator acts in a self-test (:mod:`rig.simulated.bench.virtual_operator`)."""
        self.pianist_plays = False
        """Whether a virtual pianist plays where the motor has no task (:mod:`rig.simulated.bench.virtual_pianist`)."""
        self._pianist: VirtualPianist | None = None
        self.hung_n = 0.0
        """Weight that hangs on the load cell, N."""
        self.force_per_volt_n = 12.0
        self._by_operator = False
        self.camera_rate_hz = 0.0
        """Rate of a camera that runs by itself; 0 without one."""
        self.exposures: PulseTrain | None = None
        self._a_passed = np.zeros((1, 3), dtype=np.int64)
        self._a_first = 0
        self._motor_v = np.zeros(1)
        self._quarter = np.zeros((1, 3), dtype=np.int64)
        self._last_force_n = np.zeros(1)
        self._last_angle_rad = np.zeros((1, 3))
        self._last_lift_m: NDArray[np.float64] | None = None

    @property
    def rate_hz(self) -> float:
        """Rate of the edges, Hz."""
        return self.plant.sample_rate_hz

    @property
    def now_s(self) -> float:
        """Time since the trial began, s."""
        return self.edge / self.rate_hz

    def begin(
        self, trial: int, rate_hz: float, input_delay_s: float, *, by_operator: bool = False, by_pianist: bool = False
    ) -> None:
        """Put the bench at rest for a new trial whose edges come at ``rate_hz``."""
        self.trial, self.edge, self._by_operator = trial, 0, by_operator and self.operator_acts
        self._pianist = VirtualPianist(self.sensors.seed, trial) if by_pianist and self.pianist_plays else None
        self.plant.sample_rate_hz = rate_hz
        self.plant.start_trial(trial)
        self.clock.begin()
        self._force = ForceSignal(self.sensors.force, self.sensors.seed, trial)
        self._encoders = EncoderSignals(self.sensors.encoders, self.sensors.seed, trial)
        self._delay = DelayLine(input_delay_s * rate_hz)
        self._a_passed, self._a_first, self._quarter = np.zeros((1, 3), dtype=np.int64), 0, self._quarter[:1] * 0
        self._motor_v = np.zeros(1)
        if self.camera_rate_hz > 0:
            phase = np.random.default_rng([self.sensors.seed, trial, _CAMERA_STREAM]).uniform()
            self.exposures = PulseTrain(self.camera_rate_hz, phase / self.camera_rate_hz, float("inf"), 0.0)

    def step(self, command_v: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Let n edges pass; return the cell's output at each, mV/V (n,), and the counts (n, 4)."""
        if self._force is None or self._encoders is None:
            raise RuntimeError("the bench has no trial yet")
        n = command_v.size
        time_s = (self.edge + np.arange(n)) / self.rate_hz
        if self._by_operator:
            command_v = command_v + virtual_operator.press_n(time_s) / self.force_per_volt_n
        if self._pianist is not None:
            command_v = command_v + self._pianist.press_n(time_s) / self.force_per_volt_n
        block = self.plant.advance(command_v)
        felt_n = np.where(virtual_operator.lifted(time_s), 0.0, block.force_n) if self._by_operator else block.force_n
        cell = self._force.millivolts_per_volt(self._delay.push(felt_n + self.hung_n), time_s)
        self._last_force_n, self._last_angle_rad = block.force_n[-1:], block.angle_rad[-1:]
        self._last_lift_m = None if block.key_lift_m is None else block.key_lift_m[-1:]
        quarter = self._counts(block.angle_rad, block.key_lift_m)
        self._count_a_edges(quarter)
        self.edge += n
        self.clock.advance(n / self.rate_hz)
        return cell, quarter

    def set_motor_volts(self, command_v: NDArray[np.float64]) -> None:
        """Take what the motor's output is at from each of the next edges on, V, for an input wired to it."""
        self._motor_v = np.concatenate((self._motor_v[-1:], command_v))

    def settle_motor_volts(self, volts: float) -> None:
        """Take what the motor's output is at now, V: a reading on demand comes after it has settled."""
        self._motor_v = np.append(self._motor_v[:-1], volts)

    def motor_volts_before(self, edge: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return what the motor's output was at just before each of the last edges, V: a DAC settles after its edge."""
        return self._motor_v[np.clip(edge - self._a_first, 0, self._motor_v.size - 1)]

    def a_edges(self, body: int, edge: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the rising edges on an encoder's A signal by each of the last edges of the bench."""
        rows = np.clip(edge - self._a_first, 0, self._a_passed.shape[0] - 1)
        return self._a_passed[rows, body]

    def _count_a_edges(self, quarter: NDArray[np.int64]) -> None:
        # A rises where the position passes a multiple of 4 upwards, or 2 more than one downwards
        quarter = quarter[:, :3]
        line = np.concatenate((self._quarter, quarter))
        step = np.diff(line, axis=0)
        up = line[1:] // 4 - line[:-1] // 4
        down = (line[:-1] - 2) // 4 - (line[1:] - 2) // 4
        passed = np.cumsum(np.where(step > 0, up, np.where(step < 0, down, 0)), axis=0)
        self._a_passed = self._a_passed[-1:] + passed
        self._a_first, self._quarter = self.edge, quarter[-1:]

    def present(self) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Return what stands at the terminals now, (1,) and (1, 4), without letting time pass."""
        if self._force is None or self._encoders is None:
            self.begin(0, self.rate_hz, 0.0)
            return self.step(np.zeros(1))
        cell = self._force.millivolts_per_volt(self._last_force_n, np.array([self.now_s]))
        return cell, self._counts(self._last_angle_rad, self._last_lift_m)

    def _counts(self, angle_rad: NDArray[np.float64], key_lift_m: NDArray[np.float64] | None) -> NDArray[np.int64]:
        """Counts of key, whippen, hammer, and of a second head on the key's scale, (n, 4)."""
        assert self._encoders is not None
        three = self._encoders.quarter_counts(angle_rad, key_lift_m)
        return np.column_stack((three, self._encoders.opposite_counts(angle_rad, key_lift_m)))
