"""What the guided calibrations of the bench share: record beside ``--out``, free swings of a body, its weight."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

import model
from model.calibration import with_calibrated
from pianorig.errors import CommandInputError
from rig import Rig, open_backend
from rig.atomic_write import write_text
from rig.calibration.joint_friction import Swing, fit_joint_friction, read_swing
from rig.calibration.load_cell import STANDARD_GRAVITY, U_GRAVITY
from rig.configuration.rig_file import BODIES
from rig.configuration.toml_file import dump_toml

SCHEMA = "piano-action-rig calibration 1"


def calibration_record(out: Path, kind: str) -> Path:
    """Path of the record of a calibration; refuses one that is there, or a file to write that is."""
    record = out.with_suffix(f".{kind}.toml")
    for file in (out, record):
        if file.exists():
            raise CommandInputError(f"{file}: exists already; choose another --out")
    return record


def write_calibration_record(
    record: Path, kind: str, found: dict[str, Any], device: dict[str, str], **further: str
) -> None:
    """Write what a calibration found, and on which device, as a dated record."""
    head = {"schema": SCHEMA, "kind": kind, "created_utc": datetime.now(UTC).isoformat(timespec="seconds")}
    write_text(record, dump_toml({**head, **further, "found": found, "device": device}))


def virtual_address(backend: str, option: str, rest: str) -> str:
    """An address with what is to be calibrated on it, where it is the virtual bench's and does not say so itself."""
    if not backend.startswith("sim://") or f"{option}=" in backend:
        return backend
    return f"{backend}{'&' if '?' in backend else '?'}{option}={rest}"


def check_body(body: str) -> None:
    """Refuse a body that has no encoder."""
    if body not in BODIES:
        raise CommandInputError(f"--body {body}: allowed {', '.join(BODIES)}, the bodies with an encoder")


@dataclass(frozen=True)
class Swings:
    """Swings of one body: friction over weight times arm with its standard uncertainty, each swing, the device."""

    share: float
    u_share: float
    each: tuple[Swing, ...]
    device: dict[str, str]


def check_swings(body: str, swings: int) -> None:
    """Refuse a body without an encoder, and numbers of swings that say nothing or take too long."""
    check_body(body)
    if not 2 <= swings <= 100:
        raise CommandInputError(f"--swings {swings}: allowed 2 to 100")


def weight_moment(action: model.Action, body: str) -> tuple[float, float]:
    """Weight of a body times the distance of its centre of mass from its pivot, N m, and its standard uncertainty by
    those in the action's file."""
    x, y = (action.quantities[f"{body}.center_of_mass.{axis}"] for axis in "xy")
    mass, arm = action.quantities[f"{body}.mass"], math.hypot(x.value, y.value)
    u_arm = math.hypot(x.value * x.u, y.value * y.u) / arm
    moment = mass.value * action["gravity.g"] * arm
    return moment, moment * math.sqrt(
        (mass.u / mass.value) ** 2 + (u_arm / arm) ** 2 + (U_GRAVITY / STANDARD_GRAVITY) ** 2
    )


def read_swings(rig: Rig, address: str, body: str, swings: int, ask: Callable[[str], object], *, how: str) -> Swings:
    """Let a body swing ``swings`` times on the bench at ``address`` and fit each; friction as a share of the weight's
    moment, its uncertainty, each fit. On hardware ``ask`` shows ``how`` before each."""
    each = []
    with closing(open_backend(address, rig.config)) as bench:
        hardware, device = bench.capabilities.hardware, bench.capabilities.description
        for number in range(1, swings + 1):
            if hardware:
                ask(f"swing {number} of {swings}: {how}. Press Enter, let go: ")
            angle, rate_hz = read_swing(bench, rig.config, body)
            each.append(fit_joint_friction(angle, rate_hz, body))
    shares = np.array([one.share for one in each])
    scatter = float(shares.std(ddof=1) / math.sqrt(shares.size))
    u = math.hypot(scatter, float(np.mean([one.u_share for one in each])))
    return Swings(float(shares.mean()), u, tuple(each), dict(device))


def write_calibrated_action(
    given: model.Action, path: str, value: tuple[float, float], source: str, command: str, out: Path
) -> None:
    """Write the action with one value and its standard uncertainty as calibrated."""
    name = f"{given.name}-calibrated"
    changed = replace(with_calibrated(given, {path: value}, source), name=name)
    model.write_action(changed, out, [f"{name}: {given.name} with values calibrated by `pianorig {command}`."])
