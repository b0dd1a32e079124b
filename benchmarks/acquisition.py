"""The recorder on the virtual bench: lost samples, memory, processor time, delay to the journal, of eight channels.

The figures cover client, service, device, recorder, journal and sealed files on the bench of `eight_channels`; every
trial is checked against the plant's output, and against the motor command through the input wired to it. Processor time
in real time is split: answering the client's calls counts as the virtual bench, the rest as recording. ``--hours 1`` is
the full measurement.
"""

from __future__ import annotations

import os
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.runner import Run
from rig.configuration.profile import load_profile
from rig.configuration.rig_file import Rig, load_rig, parse_rig
from rig.recording.options import Progress
from rig.recording.recorder import record as record_session
from rig.session import Session, Trial
from rig.session.journal_writer import JournalWriter
from rig.simulated.backend import DEFAULT_BENCH, SimulatedBackend, build_device
from rig.simulated.bench.clock import PacedClock, VirtualClock
from rig.simulated.bench.plant_protocol import PlantBlock
from rig.simulated.bench.sensors import load_sensors

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


IN_ONE_SESSION = 100
LEAST_TRIAL_S = 0.95
"""A forte blow of this plant takes a little longer, to its end at rest."""


def resident_mb() -> float:
    """Memory of this process, MB."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def check_whole(trial: Trial, edges: int) -> int:
    """Return a trial's sample count after checking that none is missing and that each follows from the command."""
    data = trial.read()
    turned = np.concatenate(([0.0], data.motor_command_v[:-1]))[:, None] * RAD_PER_VOLT
    # a lost or repeated sample would shift everything after it
    off = np.abs(data.angle_rad - turned).max(axis=0) / np.abs([e.rad_per_count for e in data.encoders])
    assert off.max() < 40, f"trial {trial.number}: angles are up to {off.max():.0f} counts off what the plant put out"
    readback = data.channel_values[:, 0]  # just before the output changes
    assert np.abs(readback[1:] - data.motor_command_v[:-1]).max() < 1e-3, f"trial {trial.number}: wrong read-back"
    assert np.all(data.channel_values[:, 1:] == [0.0, 0.0, -20.0]), f"trial {trial.number}: open inputs"
    assert data.status == "complete" and np.array_equal(data.time_s, np.arange(data.n_valid) / 5000.0)
    assert edges - 5000 <= data.n_valid <= edges, (data.n_valid, edges)
    return data.n_valid


def long_recording(hours: float) -> None:
    """Record on the virtual clock with the real-time block length; print speed, samples and memory."""
    backend = bench(VirtualClock())
    memory: list[float] = []
    samples: list[int] = []

    def after(trial: Trial) -> None:
        samples.append(check_whole(trial, backend.plant.edge))  # type: ignore[attr-defined]
        memory.append(resident_mb())

    profile = load_profile("forte")
    trials = max(int(np.ceil(hours * 3600 / LEAST_TRIAL_S)), 1)
    wall, cpu = time.perf_counter(), time.process_time()
    try:
        for first in range(0, trials, IN_ONE_SESSION):  # each is deleted afterwards: an hour is a gigabyte
            with tempfile.TemporaryDirectory() as folder:
                record_session(
                    Path(folder) / "s", profile=profile, rig_config=eight(), backend=backend,
                    trials=min(trials - first, IN_ONE_SESSION), after_trial=after,
                )  # fmt: skip
    finally:
        backend.close()
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    bench_s = sum(samples) / 5000.0
    passed = np.cumsum(samples) / 5000.0
    later = np.array(memory)[passed >= min(60.0, bench_s / 2)]
    print(
        f"long recording       : {bench_s / 3600:.3f} h in {len(samples)} trials, {sum(samples)} samples of each "
        f"of 8 channels, 0 lost; {bench_s / wall:.0f} x real time, {bench_s / cpu:.0f} x by CPU time"
    )
    print(f"memory               : {later[0]:.0f} MB after the first minute, then {later.min() - later[0]:+.1f} to "
          f"{later.max() - later[0]:+.1f} MB")  # fmt: skip


class Answering:
    """Processor time that a virtual bench in the same process spends answering calls."""

    def __init__(self, backend: SimulatedBackend) -> None:
        self.cpu_s = 0.0
        self._handle = backend.service.handle
        backend.service.handle = self._timed  # type: ignore[method-assign]

    def _timed(self, call: str, request: Any, *more: Any) -> Any:
        began = time.thread_time()
        try:
            return self._handle(call, request, *more)
        finally:
            self.cpu_s += time.thread_time() - began


def real_time(trials: int) -> tuple[str, float]:
    """Record at wall-clock speed; print and return processor time and the delay from sample to journal (99 %, ms)."""
    backend = bench(PacedClock(1.0))
    answering = Answering(backend)
    behind: list[float] = []
    Timed.log = []

    def see(at: Progress) -> None:
        behind.append(at.time_s - at.committed_s)

    with tempfile.TemporaryDirectory() as folder:
        wall, cpu = time.monotonic(), time.process_time()
        session = record_session(
            Path(folder) / "s", rig_config=eight(), backend=backend, trials=trials, progress=see, open_journal=Timed
        )
        wall, cpu = time.monotonic() - wall, time.process_time() - cpu
        backend.close()
        stored = sum(trial.read().n_valid for trial in Session.open(session.path).trials)
    assert stored == sum(n for _, n, _, _ in Timed.log)
    age_ms = 1e3 * Timed.ages_s()
    share = 100 * answering.cpu_s / wall
    print(
        f"real time            : recording {100 * cpu / wall - share:.1f} % of one core, virtual bench {share:.1f} %, "
        f"together {100 * cpu / wall:.1f} % ({wall:.0f} s)"
    )
    print(
        f"sample to journal    : median {np.median(age_ms):.1f} ms, 99 % within {np.percentile(age_ms, 99):.1f} ms, "
        f"longest {age_ms.max():.1f} ms (a block is 20 ms)"
    )
    print(
        f"read, not committed  : at most {1e3 * max(behind):.0f} ms when an observer is told, and one block under way"
    )
    return f"{100 * cpu / wall - share:.1f} %; {share:.1f} %", float(np.percentile(age_ms, 99))


def main(run: Run) -> None:
    """Print all rows; every sample is checked."""
    long_recording(run.hours)
    load, delay_ms = real_time(run.real_time_trials)
    run.figure("recording-load", load)
    run.figure("recording-delay", f"{delay_ms:.0f} ms")
