"""``pianorig simulate``: predict the motion of the action under a force table, and look inside it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pianorig.console.options import Scale


def command(
    out: Annotated[Path, typer.Option("--out", help="File to write: .csv or .h5.")],
    force: Annotated[
        Path | None, typer.Option("--force", help="CSV file with the columns time_s,force_n: the motion is the answer.")
    ] = None,
    key_motion: Annotated[
        Path | None,
        typer.Option("--key-motion", help="CSV file with the columns time_s,key_rad: the force is the answer."),
    ] = None,
    from_rest: Annotated[
        bool, typer.Option("--from-rest", help="Angles of --key-motion are changes since rest, as an encoder counts.")
    ] = False,
    action: Annotated[str, typer.Option("--action", help="Built-in action or a TOML file.")] = "hirschkorn2004",
    set_: Annotated[
        list[str] | None, typer.Option("--set", help="Parameter to change, path=value; may be repeated.")
    ] = None,
    scale: Scale = None,
    tolerance: Annotated[float, typer.Option("--tolerance", help="Largest error of any angle wanted, rad.")] = 1e-5,
    output_rate: Annotated[
        float | None, typer.Option("--output-rate", help="Rows per second, Hz; default: the force table's times.")
    ] = None,
    forces: Annotated[
        bool, typer.Option("--forces", help="Also write normal and friction force of each contact.")
    ] = False,
    inside: Annotated[
        bool,
        typer.Option(
            "--inside",
            help="Also write each contact's forces, depth, sliding and losses, each joint's force, each body's "
            "acceleration; print where energy went and when the key would lift from its rail.",
        ),
    ] = False,
    figures: Annotated[
        Path | None, typer.Option("--figures", help="Draw the inside view on one sheet: .svg, .pdf or .png.")
    ] = None,
    animation: Annotated[
        Path | None,
        typer.Option("--animation", help="Draw the action moving, contacts lit by their force: .html or .svg."),
    ] = None,
    scene: Annotated[
        str,
        typer.Option(
            "--scene",
            help="What takes part: whole, without-string, key, key-whippen; with effects lifting-key, flexible-shank, "
            "lifting-key-flexible-shank, motor-arm (driven by torque_nm); or a TOML file.",
        ),
    ] = "whole",
    method: Annotated[str, typer.Option("--method", help="Integration method.")] = "rodas4p",
    as_json: Annotated[bool, typer.Option("--json", help="Print a JSON summary.")] = False,
) -> None:
    """Predict all five bodies under a force on the key, or the force that a measured motion of the key takes.

    Example:  pianorig simulate --force forte.csv --set contact04.friction=0 --inside --out forte_angles.csv
    """
    import model
    from pianorig.console.output import check_writable, print_json, run_attributes, write_columns
    from pianorig.console.overrides import load_changed
    from pianorig.errors import InputError
    from pianorig.workflows.model.inside_view import (
        check_drawings,
        described,
        draw_inside,
        inside_facts,
        lift_attributes,
        print_inside,
    )
    from pianorig.workflows.model.simulate_motion import drive_by_motion

    if out.suffix in (".csv", ".h5"):
        check_writable(out)
    check_drawings(figures, animation)
    chosen = load_changed(action, set_, scale)
    force_only = {"--force": force, "--forces": forces, "--inside": inside, "--figures": figures}
    force_only |= {"--animation": animation}
    if key_motion is not None:
        drive_by_motion(
            chosen,
            key_motion,
            out,
            also=[name for name, given in force_only.items() if given],
            from_rest=from_rest,
            tolerance=tolerance,
            output_rate=output_rate,
            scene=scene,
            method=method,
            as_json=as_json,
        )
        return
    if from_rest:
        raise InputError("--from-rest: found without --key-motion, whose angles it is about; leave it out")
    if force is None:
        raise InputError("simulate: found neither --force nor --key-motion; give one of them")
    choice = model.load_scene(scene)
    chosen = choice.on(chosen)
    times, values = model.read_force_table(force, choice.input_column)
    outputs = None if output_rate is None else model.output_times(times[0], times[-1], output_rate)
    solution = model.simulate(
        chosen,
        times,
        values,
        tolerance=tolerance,
        output_time_s=outputs,
        contact_forces=forces,
        inside=inside,
        scene=choice,
        method=method,
    )
    seen = solution.inside
    write_columns(
        out,
        solution.columns(),
        run_attributes(chosen, tolerance, method, scene)
        | {
            "effects": ", ".join([*choice.effects, *(f"{k}={v!r}" for k, v in choice.values)]),
            "force_table": str(force),
        }
        | ({} if seen is None else lift_attributes(seen)),
        None if seen is None else seen.long_names(described(chosen)),
    )
    facts: dict[str, object] = {
        "out": out,
        "rows": len(solution.time_s),
        "tolerance_rad": tolerance,
        **solution.counters,
    }
    if figures is not None or animation is not None:
        draw_inside(chosen, times, values, figures, animation, tolerance=tolerance, scene=scene, method=method)
    drawings = {"figures": figures, "animation": animation}
    if as_json:
        facts |= {} if seen is None else inside_facts(seen)
        print_json(facts | {name: path for name, path in drawings.items() if path is not None})
        return
    print(f"{out}: {len(solution.time_s)} rows, {solution.counters['n_steps']} steps")
    if seen is not None:
        print_inside(seen, described(chosen))
    for path in drawings.values():
        if path is not None:
            print(path)
