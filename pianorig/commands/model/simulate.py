"""``pianorig simulate``: predict the motion of the action under a force table, and look inside it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import model
from pianorig import workflows
from pianorig.console.built_in_names import complete_scene
from pianorig.console.column_file import FIGURE_ENDINGS, check_writable, run_attributes, write_columns
from pianorig.console.options import DEFAULT_ACTION, Action, AsJson, Scale, Settings, Tolerance
from pianorig.console.output import print_files, print_json
from pianorig.console.overrides import load_changed
from pianorig.console.progress import working
from pianorig.errors import CommandInputError


def command(
    out: Annotated[Path, typer.Option("--out", help="File to write: .csv or .h5.")],
    force: Annotated[
        Path | None,
        typer.Option(
            "--force", help="CSV file with the columns time_s,force_n, or a trial (.h5): the motion is computed."
        ),
    ] = None,
    key_motion: Annotated[
        Path | None,
        typer.Option(
            "--key-motion",
            help="CSV file with the columns time_s,key_rad: the force is computed; in scenes with a motor arm "
            "time_s,motor_rad, with a finger time_s,finger_rad.",
        ),
    ] = None,
    from_rest: Annotated[
        bool, typer.Option("--from-rest", help="Angles of --key-motion are changes since rest, as an encoder counts.")
    ] = False,
    action: Action = DEFAULT_ACTION,
    set_: Settings = None,
    scale: Scale = None,
    tolerance: Tolerance = 1e-5,
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
    figure: Annotated[
        Path | None, typer.Option("--figure", help="Draw the inside view on one sheet: .svg, .pdf or .png.")
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
            "lifting-key-flexible-shank, motor-arm and compliant-tip (driven by torque_nm), "
            "motor-drive and motor-voltage (by command_v), finger (by finger_m), string, giving-hammer, giving-joints; "
            "or a TOML file.",
            autocompletion=complete_scene,
        ),
    ] = "whole",
    method: Annotated[str, typer.Option("--method", help="Integration method.")] = "rodas4p",
    as_json: AsJson = False,
) -> None:
    """Predict motion under a force, or the force of a motion.

    With --force all five bodies are predicted; with --key-motion the force at the key front that this motion takes.

    Example:  pianorig simulate --force force.csv --set contact04.friction=0 --inside --out angles.csv
    """
    check_writable(out, ".csv", ".h5")
    if figure is not None:
        check_writable(figure, *FIGURE_ENDINGS)
    if animation is not None:
        check_writable(animation, ".html", ".svg")
    chosen = load_changed(action, set_, scale)
    if key_motion is not None:
        force_only = {"--force": force, "--forces": forces, "--inside": inside, "--figure": figure}
        also = [name for name, given in (force_only | {"--animation": animation}).items() if given]
        if also:
            raise CommandInputError(f"--key-motion: found together with {', '.join(also)}; give one or the other")
        with working("simulating", quiet=as_json):
            driven = workflows.drive_by_motion(
                chosen,
                key_motion,
                out,
                from_rest=from_rest,
                tolerance=tolerance,
                output_rate=output_rate,
                scene=scene,
                method=method,
            )
        if as_json:
            print_json({"out": out, "tolerance_rad": tolerance} | workflows.motion_facts(driven))
        else:
            print(f"{out}: {len(driven.time_s)} rows, {driven.counters['n_steps']} steps")
            workflows.print_motion(driven)
        return
    if from_rest:
        raise CommandInputError("--from-rest: found without --key-motion, whose angles it is about; leave it out")
    if force is None:
        raise CommandInputError("simulate: found neither --force nor --key-motion; give one of them")
    choice = model.load_scene(scene)
    model.compile_ahead([choice])
    chosen = choice.on(chosen)
    driving = workflows.read_driving_force(force, choice.input_column)
    times, values = driving.time_s, driving.force_n
    outputs = None if output_rate is None else model.output_times(times[0], times[-1], output_rate)
    with working("simulating", quiet=as_json):
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
            initial=driving.rest(chosen, choice),
            estimate_error=True,
        )
    seen = solution.inside
    words = {} if seen is None else workflows.described(chosen)
    effects = ", ".join([*choice.effects, *(f"{k}={v!r}" for k, v in choice.values)])
    write_columns(
        out,
        solution.columns(),
        run_attributes(chosen, tolerance, method, scene)
        | {"effects": effects, "force_table": str(force), "estimated_error_rad": solution.error_rad or 0.0}
        | ({} if seen is None else workflows.lift_attributes(seen)),
        None if seen is None else seen.long_names(words),
    )
    drawings = {"figures": figure, "animation": animation}
    if any(drawings.values()):
        with working("drawing", quiet=as_json):
            workflows.draw_inside(chosen, times, values, **drawings, tolerance=tolerance, scene=scene, method=method)
    if as_json:
        facts: dict[str, object] = {
            "out": out,
            "rows": len(solution.time_s),
            "tolerance_rad": tolerance,
            "estimated_error_rad": solution.error_rad,
            "tolerance_missed": solution.misses_tolerance,
            **solution.counters,
        }
        facts |= {} if seen is None else workflows.inside_facts(seen)
        print_json(facts | {name: path for name, path in drawings.items() if path is not None})
        return
    print(f"{out}: {len(solution.time_s)} rows, {solution.counters['n_steps']} steps")
    workflows.print_error(solution)
    if seen is not None:
        workflows.print_inside(seen, words)
    print_files(drawings.values())
