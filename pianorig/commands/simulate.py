"""``pianorig simulate``: the motion of the action under a force, or the force that a motion of the key takes."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer

import model
from model.tolerance import DEFAULT_TOLERANCE
from pianorig import workflows
from pianorig.console.column_file import FIGURE_ENDINGS, check_writable, run_attributes, write_columns
from pianorig.console.options import (
    DEFAULT_ACTION,
    Action,
    AsJson,
    Scale,
    Settings,
    Tolerance,
    complete_scene,
)
from pianorig.console.output import file_lines, tell
from pianorig.console.overrides import load_changed
from pianorig.console.progress import working
from pianorig.errors import CommandInputError

DRAWING_RATE_HZ = 10_000.0  # of curves: every 0.1 ms, finer than a pixel of a blow
USELESS_SHARE = 0.5  # half the 95 % interval, of the force
FAR_FROM_REST_RAD = 5e-4  # 0.1 mm at the key front; most records begin at rest, so a larger offset is mentioned


def command(
    out: Annotated[Path, typer.Option("--out", help="File to write: .csv or .h5.")],
    force: Annotated[
        Path | None,
        typer.Option(
            "--force",
            help="Table with the columns time_s,force_n (CSV, LVM, TDMS, HDF5), a trial (.h5), or with --mapping any "
            "recording that import reads: the motion is computed.",
        ),
    ] = None,
    mapping: Annotated[
        Path | None, typer.Option("--mapping", help="With --force: TOML file, which channel is what, as for import.")
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
    tolerance: Tolerance = DEFAULT_TOLERANCE,
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
        typer.Option("--animation", help="Draw the action moving, contacts lit by their force: .html."),
    ] = None,
    scene: Annotated[
        str | None,
        typer.Option(
            "--scene",
            help="What takes part: whole, without-string, key, key-whippen; with effects lifting-key, flexible-shank, "
            "lifting-key-flexible-shank, motor-arm and compliant-tip (driven by torque_nm), "
            "motor-drive and motor-voltage (by command_v), finger (by finger_m), string, giving-hammer, giving-joints; "
            "or a TOML file; default: what the action says.",
            autocompletion=complete_scene,
        ),
    ] = None,
    method: Annotated[str, typer.Option("--method", help="Integration method.")] = "rodas4p",
    as_json: AsJson = False,
) -> None:
    """Predict motion under a force, or the force of a motion.
    With --force all five bodies are predicted; with --key-motion the force at the key front that this motion takes. The
    table --out is written in place of one that is there.

    Example:  pianorig simulate --force force.csv --set contact04.friction=0 --inside --out angles.csv
    """
    check_writable(out, ".csv", ".h5")
    check_writable(figure, *FIGURE_ENDINGS)
    check_writable(animation, ".html")
    chosen = load_changed(action, set_, scale, scene)
    choice = model.choice_of(chosen, scene)
    named = scene or ", ".join(choice.effects) or "whole"
    if key_motion is not None:
        force_only = {
            "--force": force,
            "--mapping": mapping,
            "--forces": forces,
            "--inside": inside,
            "--figure": figure,
        }
        also = [name for name, given in (force_only | {"--animation": animation}).items() if given]
        if also:
            raise CommandInputError(f"--key-motion: found together with {', '.join(also)}; give one or the other")
        times, angles = model.read_motion_table(key_motion, choice)
        outputs = None if output_rate is None else model.output_times(times[0], times[-1], output_rate)
        with working("simulating", quiet=as_json):
            driven = model.simulate_motion(
                chosen,
                times,
                angles,
                from_rest=from_rest,
                tolerance=tolerance,
                output_time_s=outputs,
                scene=choice,
                method=method,
            )
            attributes = run_attributes(chosen, choice, named, tolerance, method) | {"key_motion": str(key_motion)}
            write_columns(out, driven.columns(), attributes | _reading_facts(driven))
        lines = [f"{out}: {len(driven.time_s)} rows, {driven.counters['n_steps']} steps", *_motion_lines(driven)]
        tell(as_json, {"out": out, "tolerance_rad": tolerance} | _motion_facts(driven), lines)
        return
    if from_rest:
        raise CommandInputError("--from-rest: found without --key-motion, whose angles it is about; leave it out")
    if mapping is not None and force is None:
        raise CommandInputError("--mapping: found without --force, whose channels it explains")
    if force is None:
        raise CommandInputError("simulate: found neither --force nor --key-motion; give one of them")
    model.compile_ahead([choice])
    driving = workflows.read_driving_force(force, choice.input_column, mapping)
    times, values = driving.time_s, driving.force_n
    outputs = None if output_rate is None else model.output_times(times[0], times[-1], output_rate)
    rest = driving.rest(chosen, choice)
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
            initial=rest,
            estimate_error=True,
        )
    doubt, check = _judge_blow(chosen, driving, choice, (str(force), tolerance, method))
    seen = solution.inside
    words = {} if seen is None else _contact_descriptions(chosen)
    write_columns(
        out,
        solution.columns(),
        run_attributes(chosen, choice, named, tolerance, method)
        | {"force_table": str(force), "estimated_error_rad": solution.error_rad or 0.0}
        | ({} if seen is None else _lift_attributes(seen)),
        None if seen is None else seen.long_names(words),
    )
    drawings = {"figures": figure, "animation": animation}
    if any(drawings.values()):
        with working("drawing", quiet=as_json):
            # again, at a row rate for drawing
            fine = model.output_times(times[0], times[-1], DRAWING_RATE_HZ)
            moved = model.simulate(
                chosen,
                times,
                values,
                initial=rest,
                output_time_s=fine,
                inside=True,
                tolerance=tolerance,
                scene=choice,
                method=method,
            )
            if figure is not None:
                model.inside.draw_sheet(
                    chosen,
                    moved,
                    driving.force_at(fine),
                    figure,
                    workflows.blow_events(chosen, moved, driving.force_at(fine)),
                )
            if animation is not None:
                # start-up: the player's data need more of validation and vision than a run without animation
                from pianorig.player.animation import write_blow_animation

                write_blow_animation(chosen, moved, driving.force_at(fine), animation)
    facts: dict[str, object] = {
        "out": out,
        "rows": len(solution.time_s),
        "tolerance_rad": tolerance,
        "estimated_error_rad": solution.error_rad,
        "tolerance_missed": solution.misses_tolerance,
        "cannot_be_a_blow": doubt or None,
        "check_load": None if check is None else asdict(check),
        **solution.counters,
    }
    lines = [f"{out}: {len(solution.time_s)} rows, {solution.counters['n_steps']} steps"]
    lines += [str(said) for said in (doubt, check) if said]
    if solution.error_rad is not None:
        kept = f"largest error of an angle about {solution.error_rad:.1e} rad, requested {solution.tolerance:g}"
        lines.append(missed_request(solution) or kept)
    if seen is not None:
        facts |= _loss_facts(seen)
        lines += _loss_lines(seen, words)
    facts |= {name: path for name, path in drawings.items() if path is not None}
    tell(as_json, facts, [*lines, *file_lines(drawings.values())])


def _judge_blow(
    action: model.Action, driving: workflows.DrivingForce, choice: model.SceneChoice, run: tuple[str, float, str]
) -> tuple[str, model.touch.CheckLoad | None]:
    """Sentence on why the force cannot be a blow (empty where it can), and what the back check takes from the rising
    hammer, or None; neither where no force drives the scene. ``run``: name in the sentence, tolerance in rad, method.
    """
    where, tolerance, method = run
    if choice.input_column != "force_n":
        return "", None
    doubt, check = model.blow_implausibility(driving.time_s, driving.force_n, where), None
    if set(model.BODIES) <= set(choice.bodies):
        check = model.touch.find_check_load(
            action, driving.time_s, driving.force_n,
            initial=driving.rest(action, choice), scene=choice, tolerance=tolerance, method=method,
        )  # fmt: skip
    return doubt, check


def missed_request(solution: model.Solution) -> str:
    """Sentence on a solution whose estimated error misses the requested tolerance so far that its detail cannot be
    trusted; empty where it does not, or was not estimated."""
    if solution.error_rad is None or not solution.misses_tolerance:
        return ""
    return (
        f"requested error missed: angles are off by about {solution.error_rad:.1e} rad, "
        f"{solution.error_rad / solution.tolerance:.0f} x the requested {solution.tolerance:g}: on this force small "
        "errors grow; tighten --tolerance, and do not trust the motion in detail where the two differ"
    )


def _reading_facts(driven: model.MotionDriven) -> dict[str, float]:
    """How well the key's motion was known, by name: coverage factor for 95 %, encoder's resolution (rad), jitter of the
    readings (rad) and of the clock (s)."""
    return {
        "coverage_factor_95": driven.coverage_factor,
        "resolution_rad": driven.fit.resolution_rad,
        "jitter_rad": driven.fit.jitter_rad,
        "clock_jitter_s": driven.fit.clock_s,
    }


def _motion_facts(driven: model.MotionDriven) -> dict[str, Any]:
    """Facts by name of the force found from a motion, as ``--json`` prints them: first and largest force, N, with
    uncertainty, intervals in which the key would lift, quality of the readings."""
    largest = int(abs(driven.force_n).argmax())
    return {
        "rows": len(driven.time_s),
        "first_force_n": driven.force_n[0],
        "largest_force_n": driven.force_n[largest],
        "u_largest_force_n": driven.u_force_n[largest],
        "half_width_share": driven.half_width_share(),
        "interval_useless": bool(driven.half_width_share() > USELESS_SHARE),
        **_reading_facts(driven),
        "key_would_lift": [{"start_s": lift.start_s, "end_s": lift.end_s} for lift in driven.key_tensions()],
        **driven.counters,
    }


def _motion_lines(driven: model.MotionDriven) -> list[str]:
    """Lines printed of the force found from a motion: the largest with its 95 % interval and time, then each reason to
    doubt it: interval too wide, start away from rest, key that would lift."""
    largest = int(abs(driven.force_n).argmax())
    half = driven.coverage_factor * driven.u_force_n[largest]
    lines = [
        f"largest force {driven.force_n[largest]:.2f} N +- {half:.2f} N (95 %) at {driven.time_s[largest]:.4f} s; "
        f"key angle read to {driven.fit.resolution_rad:.3g} rad, jitter {driven.fit.jitter_rad:.2g} rad"
    ]
    share = driven.half_width_share()
    if share > USELESS_SHARE:
        lines.append(
            f"this force is useless: its 95 % interval is +-{100.0 * share:.0f} % of it, because the key's angle is "
            f"read only to {driven.fit.resolution_rad:.2g} rad; use an encoder with finer counts or a slower motion"
        )
    away = driven.fit.evaluate(driven.time_s[:1])[0][0, 0] - driven.rest_rad
    if abs(away) > FAR_FROM_REST_RAD:
        lines.append(
            f"the first angle is {1e3 * away:+.2f} mrad from where it is in this action at rest: if it rested there, "
            "shift the angles; for changes since rest add --from-rest"
        )
    return lines + [
        f"key would lift from its rail {1e3 * lift.start_s:.1f} to {1e3 * lift.end_s:.1f} ms: "
        "do not trust the force there"
        for lift in driven.key_tensions()
    ]


def _contact_descriptions(action: model.Action) -> dict[str, str]:
    ending = ".description"
    return {path[: -len(ending)]: words for path, words in action.structure.items() if path.endswith(ending)}


def _loss_facts(inside: model.inside.Inside) -> dict[str, object]:
    """Losses of a simulation by name, as ``--json`` prints them: friction and felt energy, J, sliding path, m, largest
    normal force, N, by contact; friction by joint; intervals in which the key lifts or would."""
    contacts = [
        {
            "contact": name,
            "largest_normal_n": inside.largest_normal_n[i],
            "slid_m": inside.slid_m[-1, i],
            "rubbed_j": inside.rubbed_j[-1, i],
            "felt_j": inside.felt_j[-1, i],
        }
        for i, name in enumerate(inside.contacts)
    ]
    joints = [{"joint": body, "rubbed_j": inside.joint_j[-1, i]} for i, body in enumerate(inside.bodies)]
    return {
        "contacts": contacts,
        "joints": joints,
        "key_would_lift": [asdict(one) for one in inside.key_tensions()],
        "key_lifts": [asdict(one) for one in inside.key_lifts()],
    }


def _lift_attributes(inside: model.inside.Inside) -> dict[str, list[float]]:
    """Intervals in which the key lifts or would, as attributes of the output file; none where it stays."""
    out = {}
    for name, found in (("key_would_lift", inside.key_tensions()), ("key_lifts", inside.key_lifts())):
        if found:
            out[f"{name}_from_s"], out[f"{name}_to_s"] = [one.start_s for one in found], [one.end_s for one in found]
    return out


def _loss_lines(inside: model.inside.Inside, words: dict[str, str]) -> list[str]:
    """Lines of a table of largest force, rubbed path and losses, mJ, by contact and joint, then the intervals in which
    the key lifts or would; ``words``: what a contact is called, by name."""
    lines = [f"{'contact':<34}{'largest N':>10}{'rubbed mm':>11}{'friction mJ':>13}{'felt mJ':>9}"]
    for i, name in enumerate(inside.contacts):
        title = f"{name.removeprefix('contact')} {words[name]}" if name in words else name.replace("_", " ")
        lines.append(
            f"{title:<34}{inside.largest_normal_n[i]:>10.2f}"
            f"{1e3 * inside.slid_m[-1, i]:>11.3f}{1e3 * inside.rubbed_j[-1, i]:>13.4f}"
            f"{1e3 * inside.felt_j[-1, i]:>9.4f}"
        )
    for tip_n, tip_j in zip(inside.tip_n.T, inside.tip_j.T, strict=True):
        tip = f"{tip_n.max(initial=0.0):>10.2f}{'':>11}{'':>13}{1e3 * tip_j[-1]:>9.4f}"
        lines.append(f"{'tip of the ' + inside.scene.presser.replace('_', ' '):<34}{tip}")
    joints = ", ".join(f"{body} {1e3 * inside.joint_j[-1, i]:.4f}" for i, body in enumerate(inside.bodies))
    lifts = [
        f"key would lift from its balance rail {one.start_s:.4f} to {one.end_s:.4f} s: "
        f"pull to {one.largest_n:.2f} N, {1e3 * one.impulse_ns:.2f} mN s"
        for one in inside.key_tensions()
    ]
    lifts += [
        f"key off its balance rail {gone.start_s:.4f} to {gone.end_s:.4f} s: "
        f"up to {1e3 * gone.largest_m:.3f} mm at {gone.largest_at_s:.4f} s"
        for gone in inside.key_lifts()
    ]
    return [*lines, f"joints, friction mJ: {joints}", *(lifts or ["key stays on its balance rail"])]
