"""Kinetic friction of a contact's pair of materials: a pad on a drum brakes a swinging body; written into an action."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import model
from model.calibration import with_calibrated
from pianorig.errors import CommandInputError
from pianorig.workflows.bench.calibration.swings import SCHEMA, Swings, check, swing, virtual, weight_moment
from pianorig.workflows.bench.interrupted import interrupts_told
from rig import load_rig
from rig.configuration.toml_file import dump_toml
from rig.storage.atomic_write import write_text

KINETIC = 10.0
"""Slip speed over the law's threshold speed from which its friction is kinetic within two thousandths."""
COUNTED = 0.2
"""Part of a half swing's top speed from which its samples count."""


@dataclass(frozen=True)
class PadOrder:
    """The pad on the drum: which contact's materials, under what load, N, at what radius, m, with their u."""

    contact: str
    load_n: float
    u_load_n: float
    radius_m: float
    u_radius_m: float
    body: str = "hammer"
    swings: int = 3


def calibrate_contact(
    order: PadOrder, rig: str | Path, backend: str, out: Path, action: str, ask: Callable[[str], object]
) -> dict[str, Any]:
    """Let a body swing without and with the pad; write the action ``out`` and a record beside it; return the facts.

    Raises
    ------
    CommandInputError : a file exists, no such body or contact, or the pad says nothing above the joint
    rig.RigError : nothing swung, too few swings, or a fault of the bench
    """
    record = out.with_suffix(".pad.toml")
    for file in (out, record):
        if file.exists():
            raise CommandInputError(f"{file}: exists already; choose another --out")
    check(order.body, order.swings)
    if not (order.load_n > 0 and order.radius_m > 0 and order.u_load_n >= 0 and order.u_radius_m >= 0):
        raise CommandInputError("--load and --radius: allowed above 0; --u-load and --u-radius: from 0")
    given, rig_file = model.load_action(action), load_rig(rig)
    path = f"{order.contact}.friction.A"
    if path not in given.quantities or given[path] == 0.0:
        rubbing = [name.split(".")[0] for name in given.quantities if name.endswith(".friction.A") and given[name] > 0]
        rubbing = [name for name in rubbing if name.startswith("contact")]
        raise CommandInputError(f"--contact {order.contact}: {given.name} has friction at {', '.join(rubbing)}")
    pad = f"{order.contact}:{order.load_n!r}:{order.radius_m!r}"
    with interrupts_told(out):
        drum = f"the {order.body} on its joint alone with the drum, 60 degrees up"
        bare = swing(
            rig_file, virtual(backend, order.body), order.body, order.swings, ask, how=f"{drum}, the pad lifted off"
        )
        braked = swing(
            rig_file, virtual(backend, order.body, pad), order.body, order.swings, ask, how=f"{drum}, the pad on it"
        )
    facts = contact_friction(order, given, bare, braked)
    if facts["friction"] < 5 * facts["u_from_swings"]:
        raise CommandInputError(
            f"--load {order.load_n:g}: the pad's friction, {facts['friction']:.3g}, stands out of the joint's by less "
            f"than five standard uncertainties ({facts['u_from_swings']:.2g}); put more weight on it"
        )
    name = f"{given.name}-calibrated"
    source = f"calibrated by a pad on a drum, {2 * order.swings} free swings"
    changed = replace(with_calibrated(given, {path: (facts["friction"], facts["u_friction"])}, source), name=name)
    note = f"{name}: {given.name} with values calibrated by `pianorig calibrate-contact`."
    model.write_action(changed, out, [note])
    head = {"schema": SCHEMA, "kind": "pad", "created_utc": datetime.now(UTC).isoformat(timespec="seconds")}
    write_text(record, dump_toml({**head, "action": given.name, "found": facts, "device": braked.device}))
    return {"action": out, "record": record, **facts}


def contact_friction(order: PadOrder, action: model.Action, bare: Swings, braked: Swings) -> dict[str, Any]:
    """Return the coefficient, what it is made of, and at what slip speeds it was found."""
    moment, u_moment = weight_moment(action, order.body)
    more = braked.share - bare.share
    arm_n = order.load_n * order.radius_m
    value = more * moment / arm_n
    from_swings = math.hypot(braked.u_share, bare.u_share) * moment / arm_n
    parts = (u_moment / moment, order.u_load_n / order.load_n, order.u_radius_m / order.radius_m)
    top = max(one.top_rad_per_s for one in braked.each) * order.radius_m
    least = KINETIC * action["friction_threshold.v_t"] / COUNTED
    if top < least:
        raise CommandInputError(
            f"--radius {order.radius_m:g}: the pad slips at {top:.3g} m/s at most, allowed from {least:.3g}: slower is "
            "not kinetic friction; take a larger drum"
        )
    return {
        "contact": order.contact,
        "body": order.body,
        "friction": value,
        "u_friction": math.hypot(from_swings, *(value * part for part in parts)),
        "u_from_swings": from_swings,
        "load_n": order.load_n,
        "u_load_n": order.u_load_n,
        "radius_m": order.radius_m,
        "u_radius_m": order.u_radius_m,
        "weight_moment_nm": moment,
        "u_weight_moment_nm": u_moment,
        "shares_without": [one.share for one in bare.each],
        "shares_with": [one.share for one in braked.each],
        "half_swings": [one.half_swings for one in braked.each],
        "slip_up_to_m_per_s": top,
    }
