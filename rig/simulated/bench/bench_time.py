"""The mechanics and sensors of the bench between two edges of the sample clock that runs.

The device says how many edges pass and what volts its analog output is at; the plant answers, and its state becomes
what stands at the terminals: the load cell's millivolts per volt and the encoders' counts. A new trial begins, at rest,
whenever a task with a sample clock of its own starts while nothing else runs. Time moves only when a read needs samples
that have not been acquired yet.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rig.simulated.bench.clock import VirtualClock
from rig.simulated.bench.plant_protocol import Plant
from rig.simulated.bench.sensors import DelayLine, EncoderSignals, ForceSignal, SensorSet
from rig.simulated.bench.virtual_hands import VirtualPianist, is_arm_lifted, press_n


@dataclass(frozen=True)
class PulseTrain:
    """Rising edges at ``first_s + k / rate_hz``, ``count`` of them (may be infinite); high for ``high_s`` each."""

    rate_hz: float
    first_s: float
    count: float
    high_s: float

    def count_edges(self, time_s: NDArray[np.float64]) -> NDArray[np.int64]:
        edges = np.floor((time_s - self.first_s) * self.rate_hz + 1e-9) + 1
        return np.asarray(np.clip(edges, 0, self.count), dtype=np.int64)

    def passed_at(self, time_s: float) -> int:
        return int(self.count_edges(np.array([time_s]))[0])

    def next_after(self, time_s: float) -> float:
        """Return when the next rising edge comes; infinite when there is none."""
        passed = self.passed_at(time_s)
        return self.first_s + passed / self.rate_hz if passed < self.count else float("inf")

    @property
    def end_s(self) -> float:
        last = self.count - 1
        return self.first_s + last / self.rate_hz + self.high_s if np.isfinite(self.count) else float("inf")


_CAMERA_STREAM = 4


class BenchTime:
    """Plant, sensors and clock of the virtual bench, at edge ``edge`` of a trial."""

    def __init__(self, plant: Plant, sensors: SensorSet, clock: VirtualClock) -> None:
        self.plant = plant
        self.sensors = sensors
        self.clock = clock
        self.edge = 0
        self._delay = DelayLine(0.0)
        self._force: ForceSignal | None = None
        self._encoders: EncoderSignals | None = None
        self.operator_acts = False
        """Whether the virtual operator acts in a self-test."""
        self.pianist_plays = False
        """Whether a virtual pianist plays where the motor has no task."""
        self._pianist: VirtualPianist | None = None
        self.hung_n = 0.0
        """Weight that hangs on the load cell, N."""
        self.force_per_volt_n = 12.0  # until the rig file says it
        self._by_operator = False
        self.camera_rate_hz = 0.0
        """Rate of a camera that runs by itself; 0 without one."""
        self.exposures: PulseTrain | None = None
        self._a_passed = np.zeros((1, 3), dtype=np.int64)
        self._a_first = 0
        self._motor_v = np.zeros(1)
        self.quarter = np.zeros((1, 4), dtype=np.int64)
        """Counts at the last edge."""
        self._last_force_n = np.zeros(1)
        self._last_angle_rad = np.zeros((1, 3))
        self._last_lift_m: NDArray[np.float64] | None = None

    @property
    def rate_hz(self) -> float:
        return self.plant.sample_rate_hz

    @property
    def now_s(self) -> float:
        return self.edge / self.rate_hz

    def begin(self, trial: int, rate_hz: float, *, by_operator: bool = False, by_pianist: bool = False) -> None:
        """Begin trial ``trial``, whose number draws the scatter: plant at rest, edge 0, sample edges at ``rate_hz``.
        ``by_operator``, ``by_pianist``: the virtual operator, the virtual pianist acts, where the bench has one."""
        self.edge, self._by_operator = 0, by_operator and self.operator_acts
        self._pianist = VirtualPianist(self.sensors.seed, trial) if by_pianist and self.pianist_plays else None
        self.plant.sample_rate_hz = rate_hz
        self.plant.start_trial(trial)
        self.clock.begin()
        self._force = ForceSignal(self.sensors.force, self.sensors.seed, trial)
        self._encoders = EncoderSignals(self.sensors.encoders, self.sensors.seed, trial)
        self._delay = DelayLine(0.0)
        self._a_passed, self._a_first, self.quarter = np.zeros((1, 3), dtype=np.int64), 0, self.quarter * 0
        self._motor_v = np.zeros(1)
        if self.camera_rate_hz > 0:
            phase = np.random.default_rng([self.sensors.seed, trial, _CAMERA_STREAM]).uniform()
            self.exposures = PulseTrain(self.camera_rate_hz, phase / self.camera_rate_hz, float("inf"), 0.0)

    def delay_force(self, delay_s: float) -> None:
        """Let the force be read so much later from here on, s: the filter of the input that samples it."""
        if delay_s * self.rate_hz != self._delay.delay_samples:
            self._delay = DelayLine(delay_s * self.rate_hz)

    def step(self, command_v: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Let n edges pass under the motor's ``command_v`` (n,), V, each held to the next edge; return at each edge the
        load cell's output (n,), mV/V, and X4 counts since the trial began (n, 4) of key, whippen, hammer and the key's
        second head."""
        if self._force is None or self._encoders is None:
            raise RuntimeError("the bench has no trial yet")
        n = command_v.size
        time_s = (self.edge + np.arange(n)) / self.rate_hz
        if self._by_operator:
            command_v = command_v + press_n(time_s) / self.force_per_volt_n
        if self._pianist is not None:
            command_v = command_v + self._pianist.press_n(time_s) / self.force_per_volt_n
        block = self.plant.advance(command_v)
        felt_n = np.where(is_arm_lifted(time_s), 0.0, block.force_n) if self._by_operator else block.force_n
        felt_n = felt_n + self.hung_n
        cell = self._force.millivolts_per_volt(self._delay.push(felt_n), time_s)
        self._last_force_n, self._last_angle_rad = felt_n[-1:], block.angle_rad[-1:]
        self._last_lift_m = None if block.key_lift_m is None else block.key_lift_m[-1:]
        quarter = self._counts(block.angle_rad, block.key_lift_m)
        self._count_a_edges(quarter)
        self.edge += n
        self.clock.advance(n / self.rate_hz)
        return cell, quarter

    def set_motor_volts(self, volts: NDArray[np.float64]) -> None:
        """Take what the motor's output is at before the next edges and from each on, V, for an input wired to it."""
        self._motor_v = volts

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
        """Set how many rising edges each encoder's A signal has had by each row of ``quarter`` (n, 4), X4 counts of
        key, whippen, hammer, the key's second head (left out); the last row becomes the newest position."""
        line = np.concatenate((self.quarter, quarter))[:, :3]
        step = np.diff(line, axis=0)
        up = line[1:] // 4 - line[:-1] // 4
        down = (line[:-1] - 2) // 4 - (line[1:] - 2) // 4
        passed = np.cumsum(np.where(step > 0, up, np.where(step < 0, down, 0)), axis=0)
        self._a_passed = self._a_passed[-1:] + passed
        self._a_first, self.quarter = self.edge, quarter[-1:]

    def present(self) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Return what stands at the terminals now, (1,) and (1, 4), without letting time pass."""
        if self._force is None or self._encoders is None:
            self.begin(0, self.rate_hz)
            return self.step(np.zeros(1))
        cell = self._force.millivolts_per_volt(self._last_force_n, np.array([self.now_s]))
        return cell, self._counts(self._last_angle_rad, self._last_lift_m)

    def _counts(self, angle_rad: NDArray[np.float64], key_lift_m: NDArray[np.float64] | None) -> NDArray[np.int64]:
        """Counts of key, whippen, hammer, and of a second head on the key's scale, (n, 4)."""
        assert self._encoders is not None
        three = self._encoders.quarter_counts(angle_rad, key_lift_m)
        return np.column_stack((three, self._encoders.opposite_counts(angle_rad, key_lift_m)))
