"""``pianorig selftest``: test a bench before the first blow and write the dated record that recording demands."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Annotated

import typer

import rig
from pianorig import workflows
from pianorig.console.column_file import FIGURE_ENDINGS, check_writable
from pianorig.console.failures import Interrupted, how_stopped
from pianorig.console.options import SELFTESTS, AsJson, Backend, Figure, Operator, Rig, Yes
from pianorig.console.output import file_lines, tell
from pianorig.console.terminal import type_answer


def command(
    backend: Backend = "sim://?hand=yes",
    rig_name: Rig = "virtual",
    out: Annotated[Path, typer.Option("--out", help="Folder for the record.")] = SELFTESTS,
    operator: Operator = "unknown",
    yes: Yes = False,
    figure: Figure = None,
    as_json: AsJson = False,
) -> None:
    """Test a bench with gentle pushes before the first blow.
    Wiring, signs, scales, delay, bridge, camera, drive-enable and watchdog. A record is written; exit code 3 where a
    check did not pass.

    Example:  pianorig selftest --backend ni://local --rig my_rig.toml --operator ana
    """

    check_writable(figure, *FIGURE_ENDINGS)

    def show(finding: rig.SelftestFinding) -> None:
        if not as_json:
            passed = "ok  " if finding.passed else "FAIL"
            print(f"{passed} {finding.check:<24} {finding.found:<36} allowed {finding.allowed}")
            if finding.advice:
                print(f"     {finding.advice}")

    path, record = check_bench(backend, rig_name, out, operator=operator, yes=yes, ask=type_answer, show=show)
    if figure is not None:
        workflows.draw_checks(record.findings, figure)
    failed = "" if record.passed else "; it did not pass, recording on hardware will refuse it"
    tell(
        as_json, {"record": path, **record.model_dump(mode="json")}, [*file_lines([figure]), f"record: {path}{failed}"]
    )
    if not record.passed:
        raise typer.Exit(3)


def check_bench(
    backend: str,
    rig_name: str,
    out: Path,
    *,
    operator: str = "unknown",
    yes: bool = False,
    ask: Callable[[str], str | None],
    show: Callable[[rig.SelftestFinding], None] = lambda finding: None,
) -> tuple[Path, rig.SelftestRecord]:
    """Test a bench by gentle pushes of its motor, ``show`` each finding, write the record into the folder ``out``;
    return its path and the record. Hardware moves only after ``ask`` confirmed it, or ``yes``."""
    from rig.safety.interrupts import termination_as_interrupt  # start-up: 0.2 s of nidaqmx that --help does not need
    from rig.safety.permission import confirm  # start-up: as above

    rig_file = rig.load_rig(rig_name)
    with closing(rig.open_backend(backend, rig_file.config)) as bench:
        hardware = bench.capabilities.hardware

        def prompt(instruction: str) -> None:
            if hardware:
                ask(f"{instruction}. Press Enter to begin: ")

        if hardware:
            confirm(rig_file, backend, yes=yes, ask=ask)
        try:
            with termination_as_interrupt():
                record = rig.run_selftest(rig_file, bench, prompt=prompt, operator=operator, tell=show)  # type: ignore[arg-type]
        except KeyboardInterrupt as interrupt:
            # every step ends with a safe stop; only a second interrupt can have come in the middle of it
            again = isinstance(interrupt.__context__, KeyboardInterrupt)
            outputs = "OUTPUTS NOT CONFIRMED SAFE, cut the drive's power" if again else "outputs safe"
            raise Interrupted(f"{how_stopped(interrupt)}; {outputs}; no record of the self-test was written") from None
    return record.write(out), record
