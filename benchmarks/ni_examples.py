"""NI's example programs of nidaqmx-python, each run as it stands against the virtual device, as a table.

``python -m benchmarks ni_examples --checkout CHECKOUT [--only NAME]`` takes a checkout of ni/nidaqmx-python by
path; nothing of it is part of this project. A program runs in a process of its own; its tasks are given the virtual
device's channel where it names none, Enter is pressed after a second, Ctrl-C after some. The device is a card with the
rig file's name, so that examples for other devices end with the driver's refusal.
"""

from __future__ import annotations

import contextlib
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from benchmarks.ni_component_tests import Outcome, served
from benchmarks.runner import Run

PORT = "PIANORIG_EXAMPLES_PORT"
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
channel = grpc.insecure_channel("127.0.0.1:" + os.environ["PIANORIG_EXAMPLES_PORT"])
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


def run(examples: Path, only: str = "") -> list[Outcome]:
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
        _pulses(backend, signal_hz) if signal_hz else contextlib.nullcontext(),
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


@contextlib.contextmanager
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


def main(asked: Run) -> bool:
    """Run the programs and print the table; whether as many run as are stated."""
    if not asked.checkout:
        print("skipped: --checkout is missing: a checkout of ni/nidaqmx-python with its examples")
        return True
    found = run((Path(asked.checkout) / "examples").resolve(), asked.only)
    print(table(found))
    return sum(one.result == RAN for one in found) >= asked.least
