"""Running a self-test from the command line: permission on hardware, instructions to the operator, the record."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rig.selftest.record import SelftestFinding, SelftestRecord


def check_bench(
    backend: str,
    rig: str,
    out: Path,
    *,
    operator: str = "unknown",
    yes: bool = False,
    ask: Callable[[str], str | None],
    show: Callable[[str, bool, str, str, str], None] = lambda *finding: None,
) -> tuple[Path, SelftestRecord]:
    """Test a bench and write the record into a folder; the motor pushes gently, so hardware needs confirmation.

    Raises
    ------
    InputError : rig file, backend or folder
    rig.errors.NotPermitted : hardware and nobody confirmed; nothing has moved
    """
    from rig.backend import open_backend
    from rig.configuration.rig_file import load_rig
    from rig.safety.interrupts import termination_as_interrupt
    from rig.safety.permission import confirm
    from rig.selftest.run import run_selftest

    rig_file = load_rig(rig)
    bench = open_backend(backend, rig_file.config)

    def prompt(instruction: str) -> None:
        if bench.capabilities.hardware:
            ask(f"{instruction}. Press Enter to begin: ")

    def tell(finding: SelftestFinding) -> None:
        show(finding.check, finding.passed, finding.found, finding.allowed, finding.advice)

    try:
        if bench.capabilities.hardware:
            confirm(rig_file, backend, yes=yes, ask=ask)
        with termination_as_interrupt():
            record = run_selftest(rig_file, bench, prompt=prompt, operator=operator, tell=tell)  # type: ignore[arg-type]
    finally:
        bench.close()
    return record.write(out), record
