"""``pianorig simulate``: predict the motion of the action under a force table."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def command(
    force: Annotated[Path, typer.Option("--force", help="CSV file with the columns time_s,force_n.")],
    out: Annotated[Path, typer.Option("--out", help="File to write: .csv or .h5.")],
    action: Annotated[str, typer.Option("--action", help="Built-in action or a TOML file.")] = "hirschkorn2004",
    set_: Annotated[
        list[str] | None, typer.Option("--set", help="Parameter to change, path=value; may be repeated.")
    ] = None,
    tolerance: Annotated[float, typer.Option("--tolerance", help="Largest error of any angle wanted, rad.")] = 1e-5,
    output_rate: Annotated[
        float | None, typer.Option("--output-rate", help="Rows per second, Hz; default: the force table's times.")
    ] = None,
    forces: Annotated[
        bool, typer.Option("--forces", help="Also write normal and friction force of each contact.")
    ] = False,
    scene: Annotated[
        str, typer.Option("--scene", help="What takes part: whole, without-string, key, key-whippen, or a TOML file.")
    ] = "whole",
    method: Annotated[str, typer.Option("--method", help="Integration method.")] = "rodas4p",
    as_json: Annotated[bool, typer.Option("--json", help="Print a JSON summary.")] = False,
) -> None:
    """Predict all five bodies under a force on the key.

    Example:  pianorig simulate --force forte.csv --set contact04.friction=0 --forces --out forte_angles.csv
    """
    import model

    from ..output import check_writable, print_json, write_columns
    from ..settings import read_settings

    if out.suffix in (".csv", ".h5"):
        check_writable(out)
    overrides = read_settings(set_ or [])
    chosen = model.load_action(action, overrides)
    times, values = model.read_force_table(force)
    outputs = None if output_rate is None else model.output_times(times[0], times[-1], output_rate)
    solution = model.simulate(
        chosen,
        times,
        values,
        tolerance=tolerance,
        output_time_s=outputs,
        contact_forces=forces,
        scene=scene,
        method=method,
    )
    write_columns(
        out,
        solution.columns(),
        {
            "action": chosen.name,
            "changed": ", ".join(f"{k}={v!r}" for k, v in chosen.changed.items()),
            "tolerance_rad": tolerance,
            "method": method,
            "scene": scene,
            "force_table": str(force),
        },
    )
    if as_json:
        print_json({"out": out, "rows": len(solution.time_s), "tolerance_rad": tolerance, **solution.counters})
    else:
        print(f"{out}: {len(solution.time_s)} rows, {solution.counters['n_steps']} steps")
