"""NI's own component tests and example programs of nidaqmx-python against the virtual device, as tables.

``--checkout`` is a checkout of ni/nidaqmx-python; nothing of it is part of this project.
"""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import tempfile
import time
import xml.etree.ElementTree as ElementTree
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from benchmarks.runner import ROOT, Run

LEFT_OUT = Path(__file__).with_name("ni_left_out.txt")
PORT = "PIANORIG_NI_PORT"
TIMEOUT_S = 1500


@dataclass(frozen=True)
class Outcome:
    """A test or a program: its name, what came of it, and the line that says why."""

    name: str
    result: str
    why: str = ""


def pytest_configure(config: Any) -> None:
    """Let NI's fixtures find the virtual device instead of starting NI's server; called where this is their plugin."""
    import tests._grpc_utils as utils  # type: ignore[import-not-found]  # platform: NI's package, not ours

    def init(self: Any) -> None:
        self.server_port = int(os.environ[PORT])

    utils.GrpcServerProcess.__init__ = init
    utils.GrpcServerProcess.__exit__ = lambda self, *exception: None


@contextmanager
def served() -> Iterator[tuple[Any, int]]:
    """A virtual device of its own, and the port that it is served at."""
    from rig.configuration.rig_file import load_rig  # start-up: the plugin must not import the bench
    from rig.simulated.backend import open_backend
    from rig.simulated.serve import serve

    backend = open_backend("sim://?clock=real", load_rig("pcie6363").config)
    server, port = serve(backend.service)
    try:
        yield backend, port
    finally:
        server.stop(None).wait()
        backend.close()


def run_tests(checkout: Path, select: str) -> list[Outcome]:
    """Run NI's component tests against a device of its own; return what came of each."""
    with served() as (_, port), tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.xml"
        found = {**os.environ, "PYTHONPATH": os.pathsep.join(map(str, (checkout, ROOT))), PORT: str(port)}
        command = [
            sys.executable, "-m", "pytest", "tests/component", "-q", "-p", __name__, "-p", "no:cacheprovider",
            "-k", select, "--continue-on-collection-errors",
            f"--junitxml={report}", "-o", "faulthandler_timeout=60", "-W", "ignore",
        ]  # fmt: skip
        subprocess.run(
            command, cwd=checkout, env=found, timeout=TIMEOUT_S, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
            check=False,
        )  # fmt: skip
        return outcomes(report)


def outcomes(report: Path) -> list[Outcome]:
    """Read a JUnit report."""
    found = []
    for case in ElementTree.parse(report).getroot().iter("testcase"):
        name = f"{case.get('classname')}::{case.get('name')}"
        said = {kind: element for kind in ("failure", "error", "skipped") if (element := case.find(kind)) is not None}
        for kind, element in said.items():
            result = "skipped" if kind == "skipped" else "failed"
            found.append(Outcome(name, result, reason(f"{element.get('message') or ''}\n{element.text or ''}")))
            break
        else:
            found.append(Outcome(name, "passed"))
    return found


def reason(text: str) -> str:
    """Return a failure in one line: status code or gRPC status with its detail, else the assertion."""
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    detail = lines[0] if lines else ""
    if code := re.search(r"Status Code: (-?\d+)", text):
        return f"{code[1]}: {re.sub('^[A-Za-z_.]*Error: ', '', detail)}"
    return detail[:160]


def left_out() -> list[re.Pattern[str]]:
    """Return the patterns of the names that are left out."""
    lines = (line.partition("#")[0].strip() for line in LEFT_OUT.read_text(encoding="utf-8").splitlines())
    return [re.compile(line) for line in lines if line]


def table_of_tests(found: list[Outcome]) -> str:
    """Return counts, and what fails by reason, as Markdown."""
    patterns = left_out()
    kept = [outcome for outcome in found if not any(p.search(outcome.name) for p in patterns)]
    count = Counter(outcome.result for outcome in kept)
    ran = count["passed"] + count["failed"]
    lines = [
        f"| NI's component tests over gRPC | {len(found)} |", "|---|---:|",
        f"| left out (they assert NI's simulated waveforms) | {len(found) - len(kept)} |",
        f"| skipped by NI's fixtures (another device) | {count['skipped']} |",
        f"| ran | {ran} |",
        f"| passed | {count['passed']} ({count['passed'] / max(ran, 1):.1%}) |",
        f"| failed | {count['failed']} |",
        "", "| fails | reason |", "|---|---|",
    ]  # fmt: skip
    for outcome in kept:
        if outcome.result == "failed":
            name = outcome.name.removeprefix("tests.component.").replace("[grpc_init_kwargs]", "")
            lines.append(f"| `{name}` | {outcome.why.replace('|', '/')} |")
    return "\n".join(lines) + "\n"


def ni_component_tests(run: Run) -> bool:
    """NI's component tests over gRPC against the virtual device; whether as many pass as are stated.

    Tests that assert the waveforms NI's simulated devices make (a sine on every analog input, counting bits on digital
    ones) are left out by name: ``ni_left_out.txt``. Tests for devices that the virtual bench is not (other cards,
    network modules, saved tasks) skip by themselves.
    """
    if not run.checkout:
        print("skipped: --checkout is missing: a checkout of ni/nidaqmx-python with its tests/component")
        return True
    found = table_of_tests(run_tests(Path(run.checkout).resolve(), run.select))
    print(found)
    return int(re.findall(r"\| passed \| (\d+)", found)[0]) >= run.least


SIGNAL_HZ, FED = 1000.0, ("PFI0", "PFI8", "PFI9")
INTERRUPT_S, PATIENCE_S = 14.0, 75.0
"""Later than the ten seconds after which a read of the client gives up."""
RAN, OTHER_DEVICE, NO_SIGNAL, LACKS, REFUSED = "ran", "another device", "no signal", "lacks a package", "refused"
MEANING = {
    RAN: "to its end, or until Enter or Ctrl-C",
    OTHER_DEVICE: "names a device that a PCIe-6363 is not",
    NO_SIGNAL: "waits for a signal or trigger that nothing is wired to, and times out as hardware does (-200284)",
    LACKS: "imports what is not installed",
    REFUSED: "needs what the virtual device does not have",
}
RUNNER = """
import builtins, os, runpy, signal, sys, time
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background jobs ignore Ctrl-C
import grpc, nidaqmx, nidaqmx.system, nidaqmx.task
channel = grpc.insecure_channel("127.0.0.1:" + os.environ["PIANORIG_NI_PORT"])
made = nidaqmx.Task.__init__
def init(self, new_task_name="", *, grpc_options=None):
    made(self, new_task_name, grpc_options=grpc_options or nidaqmx.GrpcSessionOptions(channel, new_task_name))
nidaqmx.Task.__init__ = init
remote = nidaqmx.system.System.remote
options = nidaqmx.GrpcSessionOptions(channel, "")
nidaqmx.system.System.local = staticmethod(lambda: remote(options))
def enter(prompt=""):
    time.sleep(1.0)
    return ""
builtins.input = enter
sys.argv = sys.argv[1:]
runpy.run_path(sys.argv[0], run_name="__main__")
"""


def run_programs(examples: Path, only: str = "") -> list[Outcome]:
    """Run the programs below a folder one after the other, each against a device of its own."""
    programs = sorted(path for path in examples.rglob("*.py") if only in path.name)
    return [_with_and_without_signal(examples, program) for program in programs]


def _with_and_without_signal(examples: Path, program: Path) -> Outcome:
    """Run a program; one that waits for a signal is run again with pulses on the terminals the programs name."""
    bare = _run_one(examples, program)
    if bare.result != NO_SIGNAL:
        return bare
    fed = _run_one(examples, program, signal_hz=SIGNAL_HZ)
    why = f"with pulses of {SIGNAL_HZ:g} Hz on {', '.join(FED)}; without: {bare.why}"
    return Outcome(fed.name, fed.result, why if fed.result == RAN else fed.why)


def _run_one(examples: Path, program: Path, signal_hz: float = 0.0) -> Outcome:
    name = program.relative_to(examples).as_posix()
    with (
        served() as (backend, port),
        _pulses(backend, signal_hz) if signal_hz else nullcontext(),
        tempfile.TemporaryDirectory() as folder,
    ):
        found = {**os.environ, PORT: str(port), "MPLBACKEND": "Agg", "PYTHONUNBUFFERED": "1"}
        process = subprocess.Popen(
            [sys.executable, "-c", RUNNER, str(program)],
            cwd=os.getcwd() if "tdms" in name else folder,  # the server logs into its own folder
            env=found, text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        )  # fmt: skip
        found_out = _outcome(name, *_wait(process))
    for_others = _for_other_devices(program)
    refused = found_out.result == REFUSED and for_others
    return Outcome(name, OTHER_DEVICE, f"is for {for_others}, it says") if refused else found_out


@contextmanager
def _pulses(backend: Any, hz: float) -> Iterator[None]:
    """Wire the last counter's output to the terminals that the programs take signals from, and let it run."""
    import nidaqmx  # start-up: not needed for --help
    from nidaqmx.constants import AcquisitionType  # start-up: as above

    device = backend.device
    device.wiring = replace(device.wiring, wires={terminal: "PFI15" for terminal in FED})
    with nidaqmx.Task("signal", grpc_options=nidaqmx.GrpcSessionOptions(backend._channel, "signal")) as task:
        task.co_channels.add_co_pulse_chan_freq("Dev1/ctr3", freq=hz)
        task.timing.cfg_implicit_timing(sample_mode=AcquisitionType.CONTINUOUS)
        task.start()
        yield


def _for_other_devices(program: Path) -> str:
    """Return the devices a program says it is for; empty where it names none."""
    listed = re.search(r"Supported Devices:\s*((?:- .*\n)+)", program.read_text("utf-8-sig"))
    names = ", ".join(line[2:].split(" (")[0] for line in listed[1].splitlines()) if listed else ""
    return "" if "6363" in names or "X Series" in names else names


def _wait(process: subprocess.Popen[str]) -> tuple[int, str, bool]:
    """Return exit code and output, and whether it had to be interrupted."""
    interrupted = False
    end = time.monotonic() + PATIENCE_S
    try:
        said, _ = process.communicate(timeout=INTERRUPT_S)
    except subprocess.TimeoutExpired:
        interrupted = True
        process.send_signal(signal.SIGINT)
        try:
            said, _ = process.communicate(timeout=max(end - time.monotonic(), 1.0))
        except subprocess.TimeoutExpired:
            process.kill()
            said, _ = process.communicate()
    return process.returncode, said, interrupted


def _outcome(name: str, code: int, said: str, interrupted: bool) -> Outcome:
    lines = [line.strip() for line in said.splitlines() if line.strip()]
    last = lines[-1] if lines else ""
    if code == 0:
        return Outcome(name, RAN)
    if interrupted and "KeyboardInterrupt" in said:
        return Outcome(name, NO_SIGNAL, "still waiting when Ctrl-C came")
    error = next((line for line in reversed(lines) if re.match(r"[\w.]+(Error|Exception)\b", line)), last)
    status = re.findall(r"(?:Status Code: |NI-DAQmx )(-\d+)", said)
    why = f"{status[-1]}: {error}" if status else error
    if "ModuleNotFoundError" in error or "ImportError" in error:
        return Outcome(name, LACKS, why)
    if status and status[-1] == "-200220":
        return Outcome(name, OTHER_DEVICE, why)
    if status and status[-1] in ("-200284", "-200474"):
        return Outcome(name, NO_SIGNAL, why)
    return Outcome(name, REFUSED, why)


def table(outcomes: list[Outcome]) -> str:
    """Return the counts and the programs as Markdown."""
    counts = Counter(outcome.result for outcome in outcomes)
    lines = ["| NI's example programs | | |", "|---|---:|---|"]
    lines += [f"| {result} | {counts[result]} | {meaning} |" for result, meaning in MEANING.items()]
    lines += ["", "| program | result | why |", "|---|---|---|"]
    lines += [f"| `{o.name}` | {o.result} | {o.why.replace('|', '/')[:160]} |" for o in outcomes]
    return "\n".join(lines) + "\n"


def ni_examples(asked: Run) -> bool:
    """NI's example programs, each as it stands, against the virtual device; whether as many run as are stated.

    A program runs in a process of its own; its tasks are given the virtual device's channel where it names none, Enter
    is pressed after a second, Ctrl-C after some. The device is a PCIe-6363, so that examples for other devices end with
    the driver's refusal.
    """
    if not asked.checkout:
        print("skipped: --checkout is missing: a checkout of ni/nidaqmx-python with its examples")
        return True
    found = run_programs((Path(asked.checkout) / "examples").resolve(), asked.only)
    print(table(found))
    return sum(one.result == RAN for one in found) >= asked.least
