"""Friction of a joint from free swings of its body: read on the bench, written into an action's file."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

import model
from model.calibration import with_calibrated
from pianorig.errors import CommandInputError
from pianorig.workflows.bench.interrupted import interrupts_told
from rig import load_rig, open_backend
from rig.calibration.swing import friction_of_swing, read_swing
from rig.configuration.channels import BODIES
from rig.configuration.toml_file import dump_toml
from rig.storage.atomic_write import write_text

SCHEMA = "piano-action-rig calibration 1"
U_GRAVITY_RELATIVE = 1.5e-3


def weight_moment(action: model.Action, body: str) -> tuple[float, float]:
    """Weight times arm of a body, N m, with the standard uncertainty that the action's file gives."""
    x, y = (action.quantities[f"{body}.center_of_mass.{axis}"] for axis in "xy")
    mass, arm = action.quantities[f"{body}.mass"], math.hypot(x.value, y.value)
    u_arm = math.hypot(x.value * x.u, y.value * y.u) / arm
    moment = mass.value * action["gravity.g"] * arm
    return moment, moment * math.sqrt((mass.u / mass.value) ** 2 + (u_arm / arm) ** 2 + U_GRAVITY_RELATIVE**2)


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
    if body not in BODIES:
        raise CommandInputError(f"--body {body}: allowed {', '.join(BODIES)}, the bodies with an encoder")
    if not 2 <= swings <= 100:
        raise CommandInputError(f"--swings {swings}: allowed 2 to 100")
    given, rig_file = model.load_action(action), load_rig(rig)
    address = backend
    if backend.startswith("sim://") and "swing=" not in backend:
        address += f"{'&' if '?' in backend else '?'}swing={body}"
    found = []
    with interrupts_told(out), closing(open_backend(address, rig_file.config)) as bench:
        hardware = bench.capabilities.hardware
        device = bench.capabilities.description
        for number in range(1, swings + 1):
            if hardware:
                ask(f"swing {number} of {swings}: the {body} on its joint alone, 60 degrees up. Press Enter, let go: ")
            angle, rate_hz = read_swing(bench, rig_file.config, body)
            found.append(friction_of_swing(angle, rate_hz, body))
    shares = np.array([one.share for one in found])
    scatter = float(shares.std(ddof=1) / math.sqrt(shares.size))
    moment, u_moment = weight_moment(given, body)
    torque = float(shares.mean()) * moment
    u = torque * math.sqrt(
        (scatter / shares.mean()) ** 2
        + (float(np.mean([one.u_share for one in found])) / shares.mean()) ** 2
        + (u_moment / moment) ** 2
    )
    path = f"{body}.joint_friction.A"
    name = f"{given.name}-calibrated"
    source = f"calibrated from {len(found)} free swings"
    changed = replace(with_calibrated(given, {path: (torque, u)}, source), name=name)
    model.write_action(changed, out, [f"{name}: {given.name} with values calibrated by `pianorig calibrate-joint`."])
    facts: dict[str, Any] = {
        "body": body,
        "friction_nm": torque,
        "u_friction_nm": u,
        "share_of_weight_moment": float(shares.mean()),
        "shares": shares.tolist(),
        "weight_moment_nm": moment,
        "u_weight_moment_nm": u_moment,
        "frequency_hz": float(np.mean([one.frequency_hz for one in found])),
        "half_swings": [one.half_swings for one in found],
    }
    head = {"schema": SCHEMA, "kind": "swing", "created_utc": datetime.now(UTC).isoformat(timespec="seconds")}
    write_text(record, dump_toml({**head, "action": given.name, "found": facts, "device": device}))
    return {"action": out, "record": record, **facts}
