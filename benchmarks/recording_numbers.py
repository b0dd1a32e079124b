"""What a long recording costs: samples lost, memory, speed, processor time, delay to the journal, stalls.

Used by acquisition.py. The plant is in closed form (force and angles follow the volts): the figures are those of
client, service, device, recorder, journal and sealed files; every trial is checked against what the plant put out.
"""

from __future__ import annotations

import os
import tempfile
import time
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from rig.config import load_rig
from rig.profile import load_profile
from rig.recorder import record_session
from rig.session import Session, Trial
from rig.session.journal import JournalWriter
from rig.simulated.backend import DEFAULT_BENCH, SimulatedBackend, build_device
from rig.simulated.clock import Clock, PacedClock, VirtualClock
from rig.simulated.contract import PlantBlock
from rig.simulated.sensors import load_sensors
from rig.trial_run import Progress

RAD_PER_VOLT = np.array([-0.05, 0.09, -0.4])
FORCE_PER_VOLT_N = 12.0


class FollowingPlant:
    """Force and angles follow the volts held before each edge; counts the edges it was asked for."""

    sample_rate_hz = 5000.0

    def start_trial(self, trial: int) -> None:
        """Begin at edge 0."""
        self.edge, self.held = 0, 0.0

    def advance(self, command_v: np.ndarray) -> PlantBlock:
        """State at the n edges."""
        felt = np.concatenate(([self.held], command_v[:-1]))
        self.held = float(command_v[-1])
        time_s = (self.edge + np.arange(felt.size)) / self.sample_rate_hz
        self.edge += felt.size
        return PlantBlock(time_s, 0.05 + FORCE_PER_VOLT_N * felt, felt[:, None] * RAD_PER_VOLT, 0.01 * felt)

    def truth(self) -> None:
        """Nothing beside what was read."""


def bench(clock: Clock) -> SimulatedBackend:
    """A virtual bench with the plant in closed form."""
    config = load_rig("virtual").config
    return SimulatedBackend(build_device(config, FollowingPlant(), load_sensors(DEFAULT_BENCH), clock=clock))


def resident_mb() -> float:
    """Memory of this process, MB."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def check_whole(trial: Trial, edges: int) -> int:
    """Return a trial's samples after checking that none is missing and that each follows from the command."""
    data = trial.read()
    turned = np.concatenate(([0.0], data.motor_command_v[:-1]))[:, None] * RAD_PER_VOLT
    # a sample lost or twice would shift everything behind it
    off = np.abs(data.angle_rad() - turned).max(axis=0) / np.abs([e.rad_per_count for e in data.encoders])
    assert off.max() < 40, f"trial {trial.number}: angles are up to {off.max():.0f} counts off what the plant put out"
    assert data.status == "complete" and np.array_equal(data.time_s, np.arange(data.n_valid) / 5000.0)
    assert edges - 5000 <= data.n_valid <= edges, (data.n_valid, edges)
    return data.n_valid


def long_recording(hours: float) -> None:
    """Record with the virtual clock at the block length of real time; print speed, samples and memory."""
    backend = bench(VirtualClock())
    memory: list[float] = []
    samples: list[int] = []

    def after(trial: Trial) -> None:
        samples.append(check_whole(trial, backend.plant.edge))  # type: ignore[attr-defined]
        memory.append(resident_mb())
        trial.path.unlink()  # an hour is a gigabyte

    profile = load_profile("forte")
    trials = max(int(hours * 3600 / 1.1), 1)
    with tempfile.TemporaryDirectory() as folder:
        wall, cpu = time.perf_counter(), time.process_time()
        try:
            record_session(Path(folder) / "s", profile=profile, backend=backend, trials=trials, after_trial=after)
        finally:
            backend.close()
        wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    bench_s = sum(samples) / 5000.0
    passed = np.cumsum(samples) / 5000.0
    later = np.array(memory)[passed >= min(60.0, bench_s / 2)]
    print(
        f"long recording       : {bench_s / 3600:.3f} h in {len(samples)} trials, {sum(samples)} samples of each "
        f"channel, 0 lost; {bench_s / wall:.0f} x real time, {bench_s / cpu:.0f} x by CPU time"
    )
    print(f"memory               : {later[0]:.0f} MB after the first minute, then {later.min() - later[0]:+.1f} to "
          f"{later.max() - later[0]:+.1f} MB")  # fmt: skip


class Timed(JournalWriter):
    """A journal that notes when each block came and when it was committed."""

    log: list[tuple[int, int, float, float]] = []

    def append(self, block: Any) -> int:
        """Hand on, with the times before and after."""
        before = time.monotonic()
        committed = super().append(block)
        Timed.log.append((block.first_sample, block.force_n.size, before, time.monotonic()))
        return committed


def real_time(trials: int) -> None:
    """Record at the speed of the wall clock; print processor time and the delay from sample to journal."""
    backend = bench(PacedClock(1.0))
    behind: list[float] = []
    Timed.log = []

    def see(at: Progress) -> None:
        behind.append(at.time_s - at.committed_s)

    with tempfile.TemporaryDirectory() as folder:
        wall, cpu = time.monotonic(), time.process_time()
        session = record_session(Path(folder) / "s", backend=backend, trials=trials, progress=see, open_journal=Timed)
        wall, cpu = time.monotonic() - wall, time.process_time() - cpu
        backend.close()
        stored = sum(trial.read().n_valid for trial in Session.open(session.path).trials)
    assert stored == sum(n for _, n, _, _ in Timed.log)
    ages: list[np.ndarray] = []
    start = [k for k, entry in enumerate(Timed.log) if entry[0] == 0] + [len(Timed.log)]
    for first, end in zip(start, start[1:], strict=False):
        part = Timed.log[first:end]
        # the sample clock began when the block that came soonest after its last sample says it did
        zero = min(came - (at + n) / 5000.0 for at, n, came, _ in part)
        ages += [done - zero - (at + np.arange(n)) / 5000.0 for at, n, _, done in part]
    age_ms = 1e3 * np.concatenate(ages)
    print(f"real time            : {100 * cpu / wall:.1f} % of one core, virtual bench included ({wall:.0f} s)")
    print(
        f"sample to journal    : median {np.median(age_ms):.1f} ms, 99 % within {np.percentile(age_ms, 99):.1f} ms, "
        f"longest {age_ms.max():.1f} ms (a block is 20 ms)"
    )
    print(
        f"read, not committed  : at most {1e3 * max(behind):.0f} ms when an observer is told, and one block under way"
    )


def stalled_disk(stall_s: float = 2.0) -> None:
    """Let the disk take nothing for a while in the middle of a trial; print what became of it."""
    stalled: list[float] = []
    began = time.monotonic()

    def write(descriptor: int, data: Any) -> int:
        if not stalled and time.monotonic() - began > 0.5:
            stalled.append(time.monotonic() - began)
            time.sleep(stall_s)
        return os.write(descriptor, data)

    backend = bench(PacedClock(1.0))
    with tempfile.TemporaryDirectory() as folder:
        session = record_session(
            Path(folder) / "s", backend=backend, trials=1, open_journal=partial(JournalWriter, write=write)
        )
        edges = backend.plant.edge  # type: ignore[attr-defined]
        backend.close()
        n = check_whole(session.trials[0], edges)
    assert stalled
    print(f"disk stall of {stall_s:g} s    : trial complete, {n} samples, 0 lost")
