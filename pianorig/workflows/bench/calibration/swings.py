"""Free swings of one body, read on the bench several times: their mean share of friction and its uncertainty."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass

import numpy as np

import model
from pianorig.errors import CommandInputError
from rig import Rig, open_backend
from rig.calibration.swing import Swing, friction_of_swing, read_swing
from rig.configuration.channels import BODIES

SCHEMA = "piano-action-rig calibration 1"
U_GRAVITY_RELATIVE = 1.5e-3


@dataclass(frozen=True)
class Swings:
    """Swings of one body: friction over weight times arm with its standard uncertainty, each swing, the device."""

    share: float
    u_share: float
    each: tuple[Swing, ...]
    device: dict[str, str]


def check(body: str, swings: int) -> None:
    """Refuse a body without an encoder, and fewer than two swings."""
    if body not in BODIES:
        raise CommandInputError(f"--body {body}: allowed {', '.join(BODIES)}, the bodies with an encoder")
    if not 2 <= swings <= 100:
        raise CommandInputError(f"--swings {swings}: allowed 2 to 100")


def weight_moment(action: model.Action, body: str) -> tuple[float, float]:
    """Weight times arm of a body, N m, with the standard uncertainty that the action's file gives."""
    x, y = (action.quantities[f"{body}.center_of_mass.{axis}"] for axis in "xy")
    mass, arm = action.quantities[f"{body}.mass"], math.hypot(x.value, y.value)
    u_arm = math.hypot(x.value * x.u, y.value * y.u) / arm
    moment = mass.value * action["gravity.g"] * arm
    return moment, moment * math.sqrt((mass.u / mass.value) ** 2 + (u_arm / arm) ** 2 + U_GRAVITY_RELATIVE**2)


def virtual(backend: str, body: str, pad: str = "") -> str:
    """Return the address, with the swinging body on it where it is the virtual bench's."""
    if not backend.startswith("sim://") or "swing=" in backend:
        return backend
    return f"{backend}{'&' if '?' in backend else '?'}swing={body}{f'&pad={pad}' if pad else ''}"


def swing(rig: Rig, address: str, body: str, swings: int, ask: Callable[[str], object], *, how: str) -> Swings:
    """Let a body swing several times, each asked for with ``how`` where there is an operator.

    Raises
    ------
    rig.RigError : nothing swung, too few half swings, or a fault of the bench
    """
    each = []
    with closing(open_backend(address, rig.config)) as bench:
        hardware, device = bench.capabilities.hardware, bench.capabilities.description
        for number in range(1, swings + 1):
            if hardware:
                ask(f"swing {number} of {swings}: {how}. Press Enter, let go: ")
            angle, rate_hz = read_swing(bench, rig.config, body)
            each.append(friction_of_swing(angle, rate_hz, body))
    shares = np.array([one.share for one in each])
    scatter = float(shares.std(ddof=1) / math.sqrt(shares.size))
    u = math.hypot(scatter, float(np.mean([one.u_share for one in each])))
    return Swings(float(shares.mean()), u, tuple(each), dict(device))
