"""NI's own component tests of nidaqmx-python, run over gRPC against the virtual device, as a table.

``python -m benchmarks ni_component_tests --checkout CHECKOUT`` takes a checkout of ni/nidaqmx-python by path;
nothing of it is part of this project. Tests that assert the waveforms NI's simulated devices make (a sine on every
analog input, counting bits on digital ones) are left out by name: ``ni_component_tests_left_out.txt``. Tests for
devices that the virtual bench is not (other cards, network modules, saved tasks) skip by themselves.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ElementTree
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.runner import ROOT, Run

LEFT_OUT = Path(__file__).with_name("ni_component_tests_left_out.txt")
PORT = "PIANORIG_COMPONENT_TESTS_PORT"
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


def table(found: list[Outcome]) -> str:
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


def main(run: Run) -> bool:
    """Run the tests and print the table; whether as many pass as are stated."""
    if not run.checkout:
        print("skipped: --checkout is missing: a checkout of ni/nidaqmx-python with its tests/component")
        return True
    found = table(run_tests(Path(run.checkout).resolve(), run.select))
    print(found)
    return int(re.findall(r"\| passed \| (\d+)", found)[0]) >= run.least
