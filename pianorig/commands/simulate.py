"""``pianorig simulate``: predict the motion of the action under a force table, and look inside it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..settings import SCALE_HELP

if TYPE_CHECKING:
    from model import Action
    from model.inside import Inside, Tension


def command(
    out: Annotated[Path, typer.Option("--out", help="File to write: .csv or .h5.")],
    force: Annotated[
        Path | None, typer.Option("--force", help="CSV file with the columns time_s,force_n: the motion is the answer.")
    ] = None,
    key_motion: Annotated[
        Path | None,
        typer.Option("--key-motion", help="CSV file with the columns time_s,key_rad: the force is the answer."),
    ] = None,
    action: Annotated[str, typer.Option("--action", help="Built-in action or a TOML file.")] = "hirschkorn2004",
    set_: Annotated[
        list[str] | None, typer.Option("--set", help="Parameter to change, path=value; may be repeated.")
    ] = None,
    scale: Annotated[list[str] | None, typer.Option("--scale", help=SCALE_HELP)] = None,
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
    scene: Annotated[
        str, typer.Option("--scene", help="What takes part: whole, without-string, key, key-whippen, or a TOML file.")
    ] = "whole",
    method: Annotated[str, typer.Option("--method", help="Integration method.")] = "rodas4p",
    as_json: Annotated[bool, typer.Option("--json", help="Print a JSON summary.")] = False,
) -> None:
    """Predict all five bodies under a force on the key, or the force that a measured motion of the key takes.

    Example:  pianorig simulate --force forte.csv --set contact04.friction=0 --inside --out forte_angles.csv
    """
    import model

    from ..errors import InputError
    from ..motion_driving import drive_by_motion
    from ..output import check_writable, print_json, write_columns
    from ..settings import load_changed

    if out.suffix in (".csv", ".h5"):
        check_writable(out)
    chosen = load_changed(action, set_, scale)
    if key_motion is not None:
        drive_by_motion(
            chosen,
            key_motion,
            out,
            also=[name for name, given in (("--force", force), ("--forces", forces), ("--inside", inside)) if given],
            tolerance=tolerance,
            output_rate=output_rate,
            scene=scene,
            method=method,
            as_json=as_json,
        )
        return
    if force is None:
        raise InputError("simulate: found neither --force nor --key-motion; give one of them")
    times, values = model.read_force_table(force)
    outputs = None if output_rate is None else model.output_times(times[0], times[-1], output_rate)
    solution = model.simulate(
        chosen,
        times,
        values,
        tolerance=tolerance,
        output_time_s=outputs,
        contact_forces=forces,
        inside=inside,
        scene=scene,
        method=method,
    )
    seen = solution.inside
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
        None if seen is None else seen.long_names(_described(chosen)),
    )
    facts = {"out": out, "rows": len(solution.time_s), "tolerance_rad": tolerance, **solution.counters}
    lifts = [] if seen is None else seen.key_tensions()
    if as_json:
        print_json(facts if seen is None else facts | _inside_facts(seen, lifts))
        return
    print(f"{out}: {len(solution.time_s)} rows, {solution.counters['n_steps']} steps")
    if seen is not None:
        _print_inside(seen, lifts, _described(chosen))


def _described(action: Action) -> dict[str, str]:
    """What each contact is, in the words of the action's file."""
    ending = ".description"
    return {path[: -len(ending)]: words for path, words in action.structure.items() if path.endswith(ending)}


def _inside_facts(seen: Inside, lifts: list[Tension]) -> dict[str, object]:
    """The inside view's sums for ``--json``."""
    from dataclasses import asdict

    contacts = [
        {
            "contact": name,
            "largest_normal_n": seen.largest_normal_n[i],
            "slid_m": seen.slid_m[-1, i],
            "rubbed_j": seen.rubbed_j[-1, i],
            "felt_j": seen.felt_j[-1, i],
        }
        for i, name in enumerate(seen.contacts)
    ]
    joints = [{"joint": body, "rubbed_j": seen.joint_j[-1, i]} for i, body in enumerate(seen.bodies)]
    return {"contacts": contacts, "joints": joints, "key_would_lift": [asdict(one) for one in lifts]}


def _print_inside(seen: Inside, lifts: list[Tension], described: dict[str, str]) -> None:
    """Table of contacts and joints, then the intervals in which the key would lift."""
    print(f"{'contact':<34}{'largest N':>10}{'rubbed mm':>11}{'friction mJ':>13}{'felt mJ':>9}")
    for i, name in enumerate(seen.contacts):
        print(
            f"{name[-2:]} {described.get(name, ''):<31}{seen.largest_normal_n[i]:>10.2f}"
            f"{1e3 * seen.slid_m[-1, i]:>11.3f}{1e3 * seen.rubbed_j[-1, i]:>13.4f}{1e3 * seen.felt_j[-1, i]:>9.4f}"
        )
    joints = ", ".join(f"{body} {1e3 * seen.joint_j[-1, i]:.4f}" for i, body in enumerate(seen.bodies))
    print(f"joints, friction mJ: {joints}")
    for one in lifts:
        print(
            f"key would lift from its balance rail {one.start_s:.4f} to {one.end_s:.4f} s: "
            f"pull to {one.largest_n:.2f} N, {1e3 * one.impulse_ns:.2f} mN s"
        )
    if not lifts:
        print("key stays on its balance rail")
