"""Friction of a joint from free swings of its body: read on the bench, written into an action's file."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

import model
from model.calibration import with_calibrated
from pianorig.errors import CommandInputError
from pianorig.workflows.bench.calibration.swings import SCHEMA, check, swing, virtual, weight_moment
from pianorig.workflows.bench.interrupted import interrupts_told
from rig import load_rig
from rig.configuration.toml_file import dump_toml
from rig.storage.atomic_write import write_text


def calibrate_joint(
    body: str, rig: str | Path, backend: str, out: Path, action: str, swings: int, ask: Callable[[str], object]
) -> dict[str, Any]:
    """Let a body swing ``swings`` times; write the action ``out`` and a record beside it; return what was found.

    Raises
    ------
    CommandInputError : a file exists, or no such body
    rig.RigError : nothing swung, too few swings, or a fault of the bench
    """
    record = out.with_suffix(".swing.toml")
    for file in (out, record):
        if file.exists():
            raise CommandInputError(f"{file}: exists already; choose another --out")
    check(body, swings)
    given, rig_file = model.load_action(action), load_rig(rig)
    with interrupts_told(out):
        how = f"the {body} on its joint alone, 60 degrees up"
        found = swing(rig_file, virtual(backend, body), body, swings, ask, how=how)
    moment, u_moment = weight_moment(given, body)
    torque = found.share * moment
    u = torque * math.hypot(found.u_share / found.share, u_moment / moment)
    path = f"{body}.joint_friction.A"
    name = f"{given.name}-calibrated"
    source = f"calibrated from {swings} free swings"
    changed = replace(with_calibrated(given, {path: (torque, u)}, source), name=name)
    model.write_action(changed, out, [f"{name}: {given.name} with values calibrated by `pianorig calibrate-joint`."])
    facts: dict[str, Any] = {
        "body": body,
        "friction_nm": torque,
        "u_friction_nm": u,
        "share_of_weight_moment": found.share,
        "shares": [one.share for one in found.each],
        "weight_moment_nm": moment,
        "u_weight_moment_nm": u_moment,
        "frequency_hz": float(np.mean([one.frequency_hz for one in found.each])),
        "half_swings": [one.half_swings for one in found.each],
    }
    head = {"schema": SCHEMA, "kind": "swing", "created_utc": datetime.now(UTC).isoformat(timespec="seconds")}
    write_text(record, dump_toml({**head, "action": given.name, "found": facts, "device": found.device}))
    return {"action": out, "record": record, **facts}
