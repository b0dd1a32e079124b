"""``pianorig selftest``: test a bench before the first blow and write the dated record that recording demands."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pianorig import workflows
from pianorig.console.options import SELFTESTS, AsJson, Backend, Operator, Rig, Yes
from pianorig.console.output import tell
from pianorig.console.terminal import type_answer


def command(
    backend: Backend = "sim://?hand=yes",
    rig: Rig = "virtual",
    out: Annotated[Path, typer.Option("--out", help="Folder for the record.")] = SELFTESTS,
    operator: Operator = "unknown",
    yes: Yes = False,
    as_json: AsJson = False,
) -> None:
    """Test a bench with gentle pushes before the first blow.

    Wiring, signs, scales, delay, bridge, camera, drive-enable and watchdog.

    Example:  pianorig selftest --backend ni://local --rig my_rig.toml --operator ana
    """

    def show(finding: workflows.SelftestFinding) -> None:
        if not as_json:
            passed = "ok  " if finding.passed else "FAIL"
            print(f"{passed} {finding.check:<24} {finding.found:<36} allowed {finding.allowed}")
            if finding.advice:
                print(f"     {finding.advice}")

    path, record = workflows.check_bench(backend, rig, out, operator=operator, yes=yes, ask=type_answer, show=show)
    failed = "" if record.passed else "; it did not pass, recording on hardware will refuse it"
    tell(as_json, {"record": path, **record.model_dump(mode="json")}, [f"record: {path}{failed}"])
    if not record.passed:
        raise typer.Exit(3)
