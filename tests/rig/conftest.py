"""A bench whose mechanics are known in closed form and differ in every channel, so that a swap cannot pass unseen."""

from __future__ import annotations

import io
import json
import re
import runpy
import shutil
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rig import Profile, Rig, RigConfig, Session, load_rig, parse_profile, parse_rig
from rig import record as record_session
from rig.daq import nidaqmx_backend
from rig.session.journal_records import END, encode, read_records
from rig.session.journal_writer import JournalWriter
from rig.simulated.backend import DEFAULT_BENCH, SimulatedBackend, build_device
from rig.simulated.bench.plant_protocol import PlantBlock
from rig.simulated.bench.sensors import EncoderSensor, ForceSensor, SensorSet
from tests.rig.fake_backend import FORCE_PER_VOLT_N, RAD_PER_VOLT, REST_FORCE_N, FakeBackend

REST_RAD = np.array([0.011, -0.007, 0.25])
SERVE_SIM = Path(__file__).parents[2] / "examples" / "serve_sim.py"


class AlgebraicPlant:
    """State at edge k follows from the volts held before it: force 12 N/V, angles -0.05, 0.02, 0.3 rad/V about rest."""

    def __init__(self, sample_rate_hz: float = 5000.0) -> None:
        self.sample_rate_hz = sample_rate_hz
        self.trials: list[int] = []
        self.commands: list[np.ndarray] = []

    def start_trial(self, trial: int) -> None:
        self.trials.append(trial)
        self.commands.append(np.empty(0))

    def advance(self, command_v: np.ndarray) -> PlantBlock:
        done = self.commands[-1]
        before = done[-1] if done.size else 0.0
        felt = np.concatenate(([before], command_v[:-1]))
        time_s = (done.size + np.arange(command_v.size)) / self.sample_rate_hz
        self.commands[-1] = np.concatenate((done, command_v))
        return PlantBlock(
            time_s=time_s,
            force_n=REST_FORCE_N + FORCE_PER_VOLT_N * felt,
            angle_rad=REST_RAD + felt[:, None] * RAD_PER_VOLT,
            motor_rad=0.01 * felt,
        )

    def truth(self) -> Any:
        return self.commands[-1]


def sensors(*, noise_n: float = 0.0, seed: int = 7, **force: Any) -> SensorSet:
    cell = ForceSensor(sensitivity_mv_per_v=2.0, full_scale_n=111.2, noise_n=noise_n, **force)
    scales = (
        EncoderSensor(counts_per_revolution=327680, sign=1),
        EncoderSensor(counts_per_revolution=327680, sign=1),
        EncoderSensor(counts_per_revolution=163840, sign=-1),
    )
    return SensorSet(cell, scales, seed)


@pytest.fixture
def bench_with(tmp_path) -> Callable[[str], str]:
    """Write a bench file with what its ``[wiring]`` plants; returns the address of such a bench."""

    def write(wiring: str) -> str:
        bench = tmp_path / "bench.toml"
        bench.write_text(f"{DEFAULT_BENCH.read_text('utf-8')}\n[wiring]\n{wiring}\n", encoding="utf-8")
        return f"sim://?bench={bench.as_posix()}"

    return write


@pytest.fixture
def rig() -> Rig:
    return load_rig("virtual")


@pytest.fixture
def config(rig: Rig) -> RigConfig:
    return rig.config


@pytest.fixture
def make_backend() -> Iterator[Any]:
    opened: list[SimulatedBackend] = []

    def make(config: RigConfig, *, noise_n: float = 0.0, clock: Any = None, **force: Any) -> SimulatedBackend:
        device = build_device(
            config, AlgebraicPlant(config.device.sample_rate_hz), sensors(noise_n=noise_n, **force), clock=clock
        )
        backend = SimulatedBackend(device)
        opened.append(backend)
        return backend

    yield make
    for backend in opened:
        backend.close()


@pytest.fixture
def begin(config: RigConfig, command: np.ndarray) -> Callable[..., None]:
    """Configure, arm and start a backend, and read so many samples; by default with the fixtures' rig and command."""

    def run(backend: Any, samples: int = 0, config: RigConfig = config, command: np.ndarray = command) -> None:
        backend.configure(config, command)
        backend.arm()
        backend.start()
        if samples:
            backend.read_block(samples, 1.0)

    return run


@pytest.fixture
def served() -> Iterator[Callable[..., tuple[Any, str]]]:
    """Serve the device of a backend on the loopback: (server, address); it is stopped with the test."""
    serve, servers = runpy.run_path(str(SERVE_SIM))["serve"], []

    def start(backend: SimulatedBackend, **options: Any) -> tuple[Any, str]:
        server, port = serve(backend.service, **options)
        servers.append(server)
        return server, f"ni-grpc://127.0.0.1:{port}"

    yield start
    for server in servers:
        server.stop(None).wait()


@pytest.fixture
def record_steps(tmp_path: Path, step_profile: Profile) -> Callable[..., Session]:
    """Record trials of the step profile by a rig file, by default one on a bench of its own, into a named folder."""

    def record(rig: Rig, name: str = "s", **changes: Any) -> Session:
        changes.setdefault("backend", FakeBackend(noise_n=0.02))
        return record_session(tmp_path / name, **{"profile": step_profile, "rig_config": rig, "trials": 1, **changes})

    return record


@pytest.fixture
def on_any_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    """Calls over a socket take no time, also where the machine has other work."""
    measure = nidaqmx_backend.measure_call_delay
    monkeypatch.setattr(nidaqmx_backend, "measure_call_delay", lambda call, now_s: measure(call, lambda: 0.0))


@pytest.fixture
def intercept() -> Any:
    """Let a function see each call of a client (name, request) before it is answered; it may raise instead."""

    @contextmanager
    def calls(backend: SimulatedBackend, before: Callable[[str, Any], None]) -> Iterator[None]:
        handle = backend.service.handle

        def intercepted(call: str, request: Any, *waiting: Any) -> Any:
            before(call, request)
            return handle(call, request, *waiting)

        backend.service.handle = intercepted
        try:
            yield
        finally:
            backend.service.handle = handle

    return calls


@pytest.fixture
def edited_rig(rig: Rig) -> Any:
    """The virtual rig file with one text replaced by another."""

    def edit(*pairs: tuple[str, str]) -> Rig:
        text = rig.text
        for old, new in pairs:
            assert old in text
            text = text.replace(old, new)
        return parse_rig(text, "edited.toml")

    return edit


@pytest.fixture
def unwatched(edited_rig: Any) -> RigConfig:
    """The virtual rig without its watchdog."""
    return edited_rig(("[watchdog]\ntimeout_s = 0.5\n", "")).config


@pytest.fixture
def step_profile() -> Profile:
    """Up to 6 N within 10 ms, held 50 ms, down within 10 ms."""
    points = [(0.0, 0), (0.01, 0), (0.02, 6), (0.07, 6), (0.08, 0)]
    rows = "".join(f"  {{ time_s = {t}, force_n = {f} }},\n" for t, f in points)
    return parse_profile(f'name = "step"\npoints = [\n{rows}]\n', "step.toml")


@pytest.fixture
def command(config: RigConfig) -> np.ndarray:
    """0.1 s of volts: a triangle to 2 V on irregular steps, distinct at every sample, zero at both ends."""
    k = np.arange(500)
    volts = 2.0 * np.interp(k, [0, 100, 300, 499], [0.0, 0.0, 1.0, 0.0]) ** 1.1
    volts[-1] = 0.0
    return volts


@pytest.fixture
def assert_safe() -> Any:
    """Checks the virtual device: motor at 0 V, drive disabled, nothing reserved."""

    def check(backend: Any) -> None:
        device = backend.device
        assert device.output_v == {device.inventory.full_name(device.wiring.motor): 0.0}
        assert device.lines == {device.inventory.full_name(device.wiring.drive_enable): False}
        assert {name: task.state for name, task in device.tasks.items() if task.state != "unreserved"} == {}

    return check


@pytest.fixture
def keyboard() -> Iterator[None]:
    """Python's own handler of Ctrl-C: a test run started in the background inherits SIGINT ignored."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture(scope="session")
def stated_s() -> dict[str, float]:
    """Within how long each fault must have the outputs safe, from the table of the safety page."""
    page = (Path(__file__).parents[2] / "docs" / "safety.md").read_text(encoding="utf-8")
    return {name: float(within) for name, within in re.findall(r"^\| (.+?) \| .+ \| ([\d.]+) s \|$", page, re.M)}


@pytest.fixture(scope="session")
def undeleted_journal() -> type[JournalWriter]:
    """A journal that stays beside its sealed trial, as a program that died in between leaves it."""

    class Undeleted(JournalWriter):
        def remove(self) -> None:
            pass

    return Undeleted


@pytest.fixture
def died_then(tmp_path: Path) -> Any:
    """A session as it is when the program dies with the fault: no closing record, nothing sealed."""

    def cut_off(folder: Path, number: int) -> Path:
        target = tmp_path / "died"
        shutil.copytree(folder, target)
        journal = target / f"trial_{number:04d}.journal"
        open_records = [r for r in read_records(io.BytesIO(journal.read_bytes())) if r.kind != END]
        journal.write_bytes(b"".join(encode(r.kind, r.sequence, r.first_sample, r.n, r.payload) for r in open_records))
        (target / f"trial_{number:04d}.h5").unlink()
        return target

    return cut_off


@pytest.fixture
def recover(capsys: Any) -> Any:
    """The command, run twice: what it found; the second time there must be nothing to do, and `info` must read it."""

    from tests.command_line import run

    def twice(folder: Path) -> list[dict[str, Any]]:
        found = []
        for command in ("recover", "recover", "info"):
            code, said = run(command, folder, "--json"), capsys.readouterr()
            assert code == 0, said.err
            found.append(json.loads(said.out)["trials"])
        assert found[1] == [] and not Session.open(folder).journals
        return found[0]

    return twice
