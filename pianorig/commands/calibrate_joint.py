"""``pianorig calibrate joint``: friction of a joint from free swings of its body."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pianorig import workflows
from pianorig.console.options import DEFAULT_ACTION, Action, AsJson, Backend, Rig
from pianorig.console.output import tell
from pianorig.console.terminal import type_answer


def command(
    body: Annotated[str, typer.Option("--body", help="key, whippen or hammer: the body that swings.")],
    out: Annotated[Path, typer.Option("--out", help="TOML file to write: the action with this joint's friction.")],
    swings: Annotated[int, typer.Option("--swings", help="How often it is let go.")] = 3,
    action: Action = DEFAULT_ACTION,
    rig: Rig = "virtual",
    backend: Backend = "sim://",
    as_json: AsJson = False,
) -> None:
    """Calibrate the friction of a joint.

    The body hangs on its joint alone, is lifted, let go, and swings until it rests; the motor stays off.

    Example:  pianorig calibrate joint --body hammer --out my_hammer.toml
    """
    facts = workflows.calibrate_joint(body, rig, backend, out, action, swings, type_answer)
    lines = (
        f"{body}: friction {facts['friction_nm']:.4g}  u {facts['u_friction_nm']:.2g}  N m, "
        f"{facts['share_of_weight_moment']:.4g} of weight times arm; swings at {facts['frequency_hz']:.4g} Hz, "
        f"half swings {', '.join(map(str, facts['half_swings']))}",
        f"{out}: the action with {body}.joint_friction.A; readings in {facts['record']}",
    )
    tell(as_json, facts, lines)
