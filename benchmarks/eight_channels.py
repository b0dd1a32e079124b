"""A virtual bench of eight channels at 5 kHz: force, three encoders, four further voltage inputs (:func:`eight`).

The plant is in closed form (force and angles follow the voltage), so that every sample can be checked. It runs in this
process or in a separate one (`bench_elsewhere`). `Timed` is a journal that notes when samples arrived.
"""

from __future__ import annotations

import contextlib
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import grpc
import numpy as np

from benchmarks.runner import ROOT
from rig.backend import Capabilities, Timing
from rig.configuration.rig_file import Rig, RigConfig, load_rig, parse_rig
from rig.daq import NidaqmxBackend
from rig.session.journal import JournalWriter
from rig.simulated.backend import DEFAULT_BENCH, SimulatedBackend, build_device
from rig.simulated.bench.bench_time import PacedClock, VirtualClock
from rig.simulated.bench.plant_protocol import PlantBlock
from rig.simulated.bench.sensors import load_sensors
from rig.simulated.serve import serve

RAD_PER_VOLT = np.array([-0.05, 0.09, -0.4])
FORCE_PER_VOLT_N = 12.0


class FollowingPlant:
    """Plant whose force and angles follow the voltage held before each edge; counts the edges requested."""

    sample_rate_hz = 5000.0

    def start_trial(self, trial: int) -> None:
        """Start at edge 0."""
        self.edge, self.held = 0, 0.0

    def advance(self, command_v: np.ndarray) -> PlantBlock:
        """Return the state at the n edges."""
        felt = np.concatenate(([self.held], command_v[:-1]))
        self.held = float(command_v[-1])
        time_s = (self.edge + np.arange(felt.size)) / self.sample_rate_hz
        self.edge += felt.size
        return PlantBlock(time_s, 0.05 + FORCE_PER_VOLT_N * felt, felt[:, None] * RAD_PER_VOLT, 0.01 * felt)

    def truth(self) -> None:
        """Return no further truth than the samples."""


FURTHER = (
    ("motor_readback", "ai1", "motor command as read back", "V", (0.0, 1.0), (0.0, 1.0), 10.0),
    ("drive_current", "ai2", "current of the motor", "A", (0.0, 1.0), (0.0, 3.0), 20.0),
    ("key_acceleration", "ai3", "acceleration of the key front", "m/s^2", (0.0, 1.0), (0.0, 98.0665), 400.0),
    ("case_temperature", "ai4", "temperature of the motor's case", "degC", (0.0, 10.0), (-20.0, 80.0), 80.0),
)


def eight() -> Rig:
    """The PCIe-6363 example with four further voltage inputs: eight channels with force and encoders."""
    tables = [
        f'''
[[channels]]
name = "{name}"
channel = "Dev1/{channel}"
quantity = "{quantity}"
unit = "{unit}"
sensor = "benchmark"
calibration = "two points"
electrical = {list(electrical)}
physical = {list(physical)}
least = {-most}
most = {most}
'''
        for name, channel, quantity, unit, electrical, physical, most in FURTHER
    ]
    patient = load_rig("pcie6363").text.replace("timeout_s = 0.5", "timeout_s = 5.0")  # other programs run as well
    return parse_rig(patient + "".join(tables), "eight channels")


def bench(clock: VirtualClock) -> SimulatedBackend:
    """A virtual bench of eight channels with the plant in closed form."""
    config = eight().config
    return SimulatedBackend(build_device(config, FollowingPlant(), load_sensors(DEFAULT_BENCH), clock=clock))


class Remote(NidaqmxBackend):
    """A virtual bench in another process: no permission is needed."""

    lengthens = True
    """Blocks are longer while the motor's command is 0 V, as through a server."""

    @property
    def capabilities(self) -> Capabilities:
        """Describe the bench, without hardware."""
        return replace(super().capabilities, simulated=True, hardware=False)

    def configure(self, config: RigConfig, command_v: np.ndarray | None) -> Timing:
        """Configure, with blocks of one length if asked."""
        timing = super().configure(config, command_v)
        return timing if self.lengthens else replace(timing, calm_block_s=0.0)


@contextlib.contextmanager
def bench_elsewhere() -> Iterator[Remote]:
    """The bench in a separate process at wall-clock speed, over TCP on loopback."""
    command = [sys.executable, "-c", "from benchmarks.eight_channels import serve_bench; serve_bench()"]
    with subprocess.Popen(command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as server:
        assert server.stdin is not None and server.stdout is not None
        port = int(server.stdout.readline())
        backend = Remote(grpc.insecure_channel(f"127.0.0.1:{port}"), name="virtual bench elsewhere")
        backend.identify(eight().config)
        try:
            yield backend
        finally:
            backend.close()
            server.stdin.close()


def serve_bench() -> None:
    """Serve the bench until standard input ends; print the port."""
    server, port = serve(bench(PacedClock(1.0)).service)
    print(port, flush=True)
    sys.stdin.read()
    server.stop(None).wait()


class Timed(JournalWriter):
    """A journal that notes when each block arrived and when it was committed."""

    log: list[tuple[int, int, float, float]] = []

    def append(self, block: Any) -> int:
        """Write the block, recording the times before and after."""
        before = time.monotonic()
        committed = super().append(block)
        Timed.log.append((block.first_sample, block.force_n.size, before, time.monotonic()))
        return committed

    @staticmethod
    def ages_s() -> np.ndarray:
        """Delay from sample to journal, s, of every sample in the log."""
        ages: list[np.ndarray] = []
        start = [k for k, entry in enumerate(Timed.log) if entry[0] == 0] + [len(Timed.log)]
        for first, end in zip(start, start[1:], strict=False):
            part = Timed.log[first:end]
            # the block with the shortest delay after its last sample defines the start of the sample clock
            zero = min(came - (at + n) / 5000.0 for at, n, came, _ in part)
            ages += [done - zero - (at + np.arange(n)) / 5000.0 for at, n, _, done in part]
        return np.concatenate(ages)
