"""``pianorig selftest``: test a bench before the first blow and write the dated record that recording demands."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pianorig.console.options import Backend, Rig, Yes


def command(
    backend: Backend = "sim://?hand=yes",
    rig: Rig = "virtual",
    out: Annotated[Path, typer.Option("--out", help="Folder for the record.")] = Path("selftests"),
    operator: Annotated[str, typer.Option("--operator", help="Who tests.")] = "unknown",
    yes: Yes = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the findings as JSON.")] = False,
) -> None:
    """Test wiring, signs, scales, delay, bridge, camera, drive-enable and watchdog; gentle pushes, no blow.

    Example:  pianorig selftest --backend ni://local --rig my_rig.toml --operator ana
    """
    from pianorig.console.output import print_json
    from pianorig.console.prompt import type_answer
    from pianorig.workflows.bench.selftest import check_bench

    def show(check: str, passed: bool, found: str, allowed: str, advice: str) -> None:
        if not as_json:
            print(f"{'ok  ' if passed else 'FAIL'} {check:<24} {found:<36} allowed {allowed}")
            if advice:
                print(f"     {advice}")

    path, record = check_bench(backend, rig, out, operator=operator, yes=yes, ask=type_answer, show=show)
    if as_json:
        print_json({"record": path, **record.model_dump(mode="json")})
    else:
        print(f"record: {path}" + ("" if record.passed else "; it did not pass, recording on hardware will refuse it"))
    if not record.passed:
        raise typer.Exit(3)
