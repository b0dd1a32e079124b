"""``pianorig calibrate joint``: friction of a joint from free swings of its body."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

import model
import rig
from pianorig import workflows
from pianorig.console.column_file import FIGURE_ENDINGS, check_writable
from pianorig.console.options import DEFAULT_ACTION, Action, AsJson, Backend, Figure, Rig
from pianorig.console.output import file_lines, tell
from pianorig.console.terminal import type_answer


def command(
    body: Annotated[str, typer.Option("--body", help="key, whippen or hammer: the body that swings.")],
    out: Annotated[Path, typer.Option("--out", help="TOML file to write: the action with this joint's friction.")],
    swings: Annotated[int, typer.Option("--swings", help="How often it is let go.")] = 3,  # choice
    action: Action = DEFAULT_ACTION,
    rig_name: Rig = "virtual",
    backend: Backend = "sim://",
    figure: Figure = None,
    as_json: AsJson = False,
) -> None:
    """Calibrate a joint's friction by free swings on the bench.
    The body hangs on its joint alone, is lifted, let go, and swings until it rests; the motor stays off. The action
    with the friction is written to a new file, and a record beside it.

    Example:  pianorig calibrate joint --body hammer --out my_hammer.toml
    """
    check_writable(figure, *FIGURE_ENDINGS)
    facts = calibrate_joint(body, rig_name, backend, out, action, swings, type_answer)
    lines = (
        f"{body}: friction {facts['friction_nm']:.4g} N m (standard uncertainty {facts['u_friction_nm']:.2g} N m)",
        f"  {facts['share_of_weight_moment']:.4g} of weight times arm; swings at {facts['frequency_hz']:.4g} Hz, "
        f"half swings {', '.join(map(str, facts['half_swings']))}",
        f"{out}: the action with {body}.joint_friction.A; readings in {facts['record']}",
    )
    if figure is not None:
        torque = [1e3 * share * facts["weight_moment_nm"] for share in facts["shares"]]
        words = (f"friction of the joint of the {body}", "swing", "friction, mN m")
        workflows.draw_deviations(range(1, len(torque) + 1), torque, words, figure)
        facts["figure"] = figure
    tell(as_json, facts, (*lines, *file_lines([figure])))


def calibrate_joint(
    body: str, rig_name: str, backend: str, out: Path, action: str, swings: int, ask: Callable[[str], object]
) -> dict[str, Any]:
    """Let a body swing freely ``swings`` times, find the friction torque of its joint, N m, write an action with it to
    the new file ``out`` and a record beside; return what was found by name. ``ask`` waits for the operator."""
    record = workflows.calibration_record(out, "swing")
    workflows.check_swings(body, swings)
    given, rig_file = model.load_action(action), rig.load_rig(rig_name)
    with workflows.report_interrupt(out):
        how = f"the {body} on its joint alone, 60 degrees up"
        found = workflows.read_swings(
            rig_file, workflows.virtual_address(backend, "swing", body), body, swings, ask, how=how
        )
    moment, u_moment = workflows.weight_moment(given, body)
    torque = found.share * moment
    u = torque * math.hypot(found.u_share / found.share, u_moment / moment)
    path = f"{body}.joint_friction.A"
    workflows.write_calibrated_action(
        given, path, (torque, u), f"calibrated from {swings} free swings", "calibrate joint", out
    )
    facts: dict[str, Any] = {
        "body": body,
        "friction_nm": torque,
        "u_friction_nm": u,
        "share_of_weight_moment": found.share,
        "shares": [one.share for one in found.each],
        "weight_moment_nm": moment,
        "u_weight_moment_nm": u_moment,
        "frequency_hz": sum(one.frequency_hz for one in found.each) / len(found.each),
        "half_swings": [one.half_swings for one in found.each],
    }
    workflows.write_calibration_record(record, "swing", facts, found.device, action=given.name)
    return {"action": out, "record": record, **facts}
