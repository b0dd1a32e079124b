"""NI's own component tests of nidaqmx-python that use only calls which the virtual device answers, against it.

``--checkout`` is a checkout of ni/nidaqmx-python; nothing of it is part of this project but the names of those tests.
"""

from __future__ import annotations

import os
import runpy
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from benchmarks.runner import ROOT, Run

ANSWERED = Path(__file__).with_name("ni_answered.txt")
PORT = "PIANORIG_NI_PORT"
TIMEOUT_S = 1500


def pytest_configure(config: Any) -> None:
    """Let NI's fixtures find the virtual device instead of starting NI's server; called where this is their plugin."""
    import tests._grpc_utils as utils  # type: ignore[import-not-found]  # platform: NI's package, not ours

    def init(self: Any) -> None:
        self.server_port = int(os.environ[PORT])

    utils.GrpcServerProcess.__init__ = init
    utils.GrpcServerProcess.__exit__ = lambda self, *exception: None


@contextmanager
def served() -> Iterator[int]:
    """The port of a virtual PCIe-6363."""
    from rig.configuration.rig_file import load_rig  # start-up: the plugin must not import the bench
    from rig.simulated.backend import open_backend

    backend = open_backend("sim://?clock=real", load_rig("pcie6363").config)
    server, port = runpy.run_path(str(ROOT / "examples" / "serve_sim.py"))["serve"](backend.service)
    try:
        yield port
    finally:
        server.stop(None).wait()
        backend.close()


def run_tests(checkout: Path) -> dict[str, str]:
    """Run NI's component tests over gRPC; return why each that was run did not pass, "" where it did."""
    with served() as port, tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.xml"
        found = {**os.environ, "PYTHONPATH": os.pathsep.join(map(str, (checkout, ROOT))), PORT: str(port)}
        command = [
            sys.executable, "-m", "pytest", "tests/component", "-q", "-p", __name__, "-p", "no:cacheprovider",
            "-k", "grpc_init_kwargs", "--continue-on-collection-errors",
            f"--junitxml={report}", "-o", "faulthandler_timeout=60", "-W", "ignore",
        ]  # fmt: skip
        subprocess.run(
            command, cwd=checkout, env=found, timeout=TIMEOUT_S, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
            check=False,
        )  # fmt: skip
        return outcomes(report)


def outcomes(report: Path) -> dict[str, str]:
    """Read a JUnit report: by test, without the name of the package, the first line that says why it did not pass."""
    found = {}
    for case in ElementTree.parse(report).getroot().iter("testcase"):
        name = f"{case.get('classname')}::{case.get('name')}".removeprefix("tests.component.")
        said = [case.find(kind) for kind in ("failure", "error", "skipped")]
        reasons = [str(element.get("message")).splitlines()[0] for element in said if element is not None]
        found[name.replace("[grpc_init_kwargs]", "")] = reasons[0] if reasons else ""
    return found


def ni_component_tests(run: Run) -> bool:
    """NI's component tests over gRPC that use only calls which the virtual device answers; whether all of them pass."""
    if not run.checkout:
        print("skipped: --checkout is missing: a checkout of ni/nidaqmx-python with its tests/component")
        return True
    lines = ANSWERED.read_text(encoding="utf-8").splitlines()
    named = {line for line in lines if not line.startswith("#")}
    cases = {case: why for case, why in run_tests(Path(run.checkout).resolve()).items() if case.split("[")[0] in named}
    missing = named - {case.split("[")[0] for case in cases}
    failed = {case: why for case, why in cases.items() if why} | dict.fromkeys(missing, "was not found")
    print(f"{len(cases)} cases of {len(named)} tests use only calls that are answered; {len(failed)} did not pass")
    for case, why in failed.items():
        print(f"  {case}: {why}")
    return not failed
