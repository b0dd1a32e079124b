"""Running a self-test from the command line: permission on hardware, instructions to the operator, the record."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from pathlib import Path

from pianorig.console.failures import Interrupted, how_stopped
from rig import SelftestFinding, SelftestRecord, load_rig, open_backend, run_selftest
from rig.safety.interrupts import termination_as_interrupt
from rig.safety.permission import confirm


def check_bench(
    backend: str,
    rig: str,
    out: Path,
    *,
    operator: str = "unknown",
    yes: bool = False,
    ask: Callable[[str], str | None],
    show: Callable[[SelftestFinding], None] = lambda finding: None,
) -> tuple[Path, SelftestRecord]:
    """Test a bench and write the record into a folder; the motor pushes gently, so hardware needs confirmation.

    Raises
    ------
    rig.errors.InputError : rig file, backend or folder
    rig.errors.NotPermitted : hardware and nobody confirmed; nothing has moved
    Interrupted : Ctrl-C; the message says whether the outputs are safe
    """
    rig_file = load_rig(rig)
    with closing(open_backend(backend, rig_file.config)) as bench:
        hardware = bench.capabilities.hardware

        def prompt(instruction: str) -> None:
            if hardware:
                ask(f"{instruction}. Press Enter to begin: ")

        if hardware:
            confirm(rig_file, backend, yes=yes, ask=ask)
        try:
            with termination_as_interrupt():
                record = run_selftest(rig_file, bench, prompt=prompt, operator=operator, tell=show)  # type: ignore[arg-type]
        except KeyboardInterrupt as interrupt:
            # every step ends with a safe stop; only a second interrupt can have come in the middle of it
            again = isinstance(interrupt.__context__, KeyboardInterrupt)
            outputs = "OUTPUTS NOT CONFIRMED SAFE, cut the drive's power" if again else "outputs safe"
            raise Interrupted(f"{how_stopped(interrupt)}; {outputs}; no record of the self-test was written") from None
    return record.write(out), record
