"""Speed of the recorder on the virtual bench, and the cost of reading a session.

    python benchmarks/acquisition.py [--hours 0.02] [--real-time-trials 10]

Prints bench seconds per wall-clock second for the RPC layer alone, in process and over TCP on loopback, at the 20 ms
block length used in real time, and for five forte trials with the plant. Also prints the size of a trial file, the
time to check its seal and read it, and the cost of a long recording of eight channels (recording_numbers.py): lost
samples, memory, processor time of the recording and of the virtual bench, delay from sample to journal, and the
effect of a stalled disk; `--hours 1` is the full measurement.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from recording_numbers import long_recording, real_time, real_time_elsewhere, stalled_disk

from rig.backend import open_backend
from rig.configuration.rig_file import load_rig
from rig.daq import open_backend as open_remote
from rig.recording.recorder import record_session
from rig.session import Session
from rig.simulated.backend import DEFAULT_BENCH, SimulatedBackend, build_device
from rig.simulated.bench.plant_protocol import PlantBlock
from rig.simulated.bench.sensors import load_sensors
from rig.simulated.rpc.tcp_server import serve

BLOCK, BLOCKS = 100, 500


class StillPlant:
    """A plant without mechanics, so that only client, service and device are measured."""

    sample_rate_hz = 5000.0

    def start_trial(self, trial: int) -> None:
        """Start at edge 0."""
        self.edge = 0

    def advance(self, command_v: np.ndarray) -> PlantBlock:
        """Return a state at rest for n edges."""
        n = command_v.size
        time_s = (self.edge + np.arange(n)) / self.sample_rate_hz
        self.edge += n
        return PlantBlock(time_s, np.zeros(n), np.zeros((n, 3)), np.zeros(n))

    def truth(self) -> None:
        """Return no truth: there is no motion."""


def read_for(backend: Any, config: Any) -> tuple[float, float]:
    """Return (bench seconds per wall-clock second, CPU seconds per bench second) of plain block reading."""
    backend.configure(config, np.zeros(100))
    backend.arm()
    backend.start()
    wall, cpu = time.perf_counter(), time.process_time()
    for _ in range(BLOCKS):
        backend.read_block(BLOCK, 10.0)
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    backend.safe_stop()
    bench_s = BLOCK * BLOCKS / config.device.sample_rate_hz
    return bench_s / wall, cpu / bench_s


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hours", type=float, default=0.02)
    parser.add_argument("--real-time-trials", type=int, default=10)
    asked = parser.parse_args()
    config = load_rig("virtual").config
    sensors = load_sensors(DEFAULT_BENCH)

    near = SimulatedBackend(build_device(config, StillPlant(), sensors))
    speed, cpu = read_for(near, config)
    print(f"RPC layer in process : {speed:6.0f} x real time, {100 * cpu:5.2f} % of one core at real time")

    far = SimulatedBackend(build_device(config, StillPlant(), sensors))
    server, port = serve(far.service)
    remote = open_remote(f"ni-grpc://127.0.0.1:{port}", config)
    speed, cpu = read_for(remote, config)
    remote.close()
    server.stop(None).wait()
    print(f"RPC layer over TCP   : {speed:6.0f} x real time, {100 * cpu:5.2f} % of one core (client and server)")

    with tempfile.TemporaryDirectory() as folder:
        backend = open_backend("sim://", config)
        record_session(Path(folder) / "warm", backend=backend, trials=1)
        start = time.perf_counter()
        session = record_session(Path(folder) / "forte", backend=backend, trials=5)
        wall = time.perf_counter() - start
        backend.close()
        trials = Session.open(session.path).trials
        bench_s = sum(trial.read().n_valid for trial in trials) / config.device.sample_rate_hz
        print(f"five forte trials    : {bench_s / wall:6.0f} x real time, {bench_s:.2f} s in {wall:.2f} s")
        start = time.perf_counter()
        for trial in trials:
            trial.read()
        per_trial_ms = (time.perf_counter() - start) / len(trials) * 1e3
        size = trials[0].path.stat().st_size / 1024
        print(f"trial file           : {size:.0f} KiB, checked and read in {per_trial_ms:.1f} ms")
    long_recording(asked.hours)
    real_time(asked.real_time_trials)
    real_time_elsewhere(asked.real_time_trials)
    stalled_disk()


if __name__ == "__main__":
    main()
