"""The guided calibrations: load cell, scale of an encoder, friction of a joint, friction of a contact's materials.

Each reads on the bench, writes the rig or action file that follows (``--out``) and beside it a dated record of what was
read; neither may be there before.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from contextlib import closing
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

import model
from model.calibration import with_calibrated
from pianorig.errors import CommandInputError
from pianorig.workflows.recording import interrupts_told
from rig import Rig, load_rig, open_backend
from rig.atomic_write import sha256_of_bytes, write_text
from rig.configuration.rig_file import BODIES
from rig.configuration.toml_file import dump_toml
from rig.guided_calibration import (
    STANDARD_GRAVITY,
    Swing,
    corrected_rig,
    dead_weights,
    fit_arc,
    friction_of_swing,
    null,
    read_plateaus,
    read_swing,
    rewritten,
    shunt,
    there_and_back,
    with_what_was_known,
)
from rig.simulated import SimulatedBackend

SCHEMA = "piano-action-rig calibration 1"


def _record_beside(out: Path, kind: str) -> Path:
    """Path of the record of a calibration; refuses one that is there, or a file to write that is."""
    record = out.with_suffix(f".{kind}.toml")
    for file in (out, record):
        if file.exists():
            raise CommandInputError(f"{file}: exists already; choose another --out")
    return record


def _write_record(record: Path, kind: str, found: dict[str, Any], device: dict[str, str], **further: str) -> None:
    head = {"schema": SCHEMA, "kind": kind, "created_utc": datetime.now(UTC).isoformat(timespec="seconds")}
    write_text(record, dump_toml({**head, **further, "found": found, "device": device}))


def _on_virtual(backend: str, option: str, rest: str) -> str:
    """An address with what is to be calibrated on it, where it is the virtual bench's and does not say so itself."""
    if not backend.startswith("sim://") or f"{option}=" in backend:
        return backend
    return f"{backend}{'&' if '?' in backend else '?'}{option}={rest}"


def _check_body(body: str) -> None:
    if body not in BODIES:
        raise CommandInputError(f"--body {body}: allowed {', '.join(BODIES)}, the bodies with an encoder")


@dataclass(frozen=True)
class CalibrationOrder:
    """What is calibrated: ``null``, ``shunt`` or ``weights``, for which masses, kg, and who does it."""

    kind: str
    masses_kg: tuple[float, ...] = ()
    u_mass_kg: float = 1e-5
    gravity: float | None = None
    operator: str = "unknown"


def calibrate_force(
    rig: str | Path, backend: str, out: Path, order: CalibrationOrder, ask: Callable[[str], object]
) -> dict[str, Any]:
    """Calibrate, write the rig file ``out`` and beside it the record; return what was found.

    Raises
    ------
    CommandInputError : a file exists, or nothing of that kind can be calibrated
    rig.RigError : readings that do not follow, or a fault of the bench
    """
    record = _record_beside(out, order.kind)
    rig_file = load_rig(rig)
    stated = rig_file.config.force.model_dump(include={"electrical", "physical_n", "u_gain_relative", "calibration"})
    rewritten(rig_file, "force", stated)
    with interrupts_told(out), closing(open_backend(backend, rig_file.config)) as bench:

        def asked(instruction: str, mass_kg: float) -> None:
            if isinstance(bench, SimulatedBackend):
                bench.device.bench.hung_n = mass_kg * (order.gravity or STANDARD_GRAVITY)
            else:
                ask(f"{instruction}. Press Enter when it hangs still: ")

        if order.kind == "weights":
            done = dead_weights(
                rig_file, bench, order.masses_kg, asked, u_mass_kg=order.u_mass_kg, gravity=order.gravity
            )
        elif order.kind == "null":
            done = null(rig_file, bench, asked)
        else:
            done = shunt(rig_file, bench)  # type: ignore[arg-type]
        device = bench.capabilities.description
    write_text(out, done.rig_text)
    after = sha256_of_bytes(done.rig_text.encode("utf-8"))
    _write_record(
        record, done.kind, done.found, device,
        operator=order.operator, rig_sha256_before=rig_file.sha256, rig_sha256_after=after,
    )  # fmt: skip
    return {"rig": out, "record": record, **done.found}


def calibrate_encoder(
    body: str, angles_rad: ArrayLike, u_angle_rad: float, rig: str | Path, backend: str, out: Path
) -> dict[str, Any]:
    """Read an encoder at reference angles, up and down; write the rig file ``out`` and a record beside it.

    Raises
    ------
    CommandInputError : a file exists, no such body, an uncertainty below 0
    rig.RigError : angles that cannot be used, rests not seen, readings that do not follow, or a fault of the bench
    """
    record = _record_beside(out, "arc")
    _check_body(body)
    if not 0 <= u_angle_rad < 0.01:
        raise CommandInputError(f"--u-angle {u_angle_rad:g}: allowed 0 to 0.01 rad")
    rig_file, references = load_rig(rig), there_and_back(angles_rad)
    rewritten(rig_file, "encoders", {"arc_gain": 1.0, "u_eccentricity_rad": 0.0}, named=body)
    address = _on_virtual(backend, "pose", f"{body}:{','.join(f'{angle:.9g}' for angle in references)}")
    with interrupts_told(out), closing(open_backend(address, rig_file.config)) as bench:
        if bench.capabilities.hardware:
            said = ", ".join(f"{angle:g}" for angle in references)
            print(f"hold the {body} at {said} rad, two seconds each", file=sys.stderr, flush=True)
        readings = read_plateaus(bench, rig_file.config, body, references)
        device = bench.capabilities.description
    arc = fit_arc(references, readings, u_angle_rad, rig_file.config.encoders[BODIES.index(body)])
    text = corrected_rig(rig_file, body, arc)
    write_text(out, text)
    found = {"body": body, "u_angle_rad": u_angle_rad, **asdict(arc)}
    after = sha256_of_bytes(text.encode("utf-8"))
    _write_record(record, "arc", found, device, rig_sha256_before=rig_file.sha256, rig_sha256_after=after)
    stored, u_stored = with_what_was_known(rig_file, body, arc)
    return {"rig": out, "record": record, **found, "arc_gain": stored, "u_arc_gain": u_stored}


U_GRAVITY_RELATIVE = 1.5e-3


@dataclass(frozen=True)
class Swings:
    """Swings of one body: friction over weight times arm with its standard uncertainty, each swing, the device."""

    share: float
    u_share: float
    each: tuple[Swing, ...]
    device: dict[str, str]


def _check_swings(body: str, swings: int) -> None:
    _check_body(body)
    if not 2 <= swings <= 100:
        raise CommandInputError(f"--swings {swings}: allowed 2 to 100")


def weight_moment(action: model.Action, body: str) -> tuple[float, float]:
    """Weight times arm of a body, N m, with the standard uncertainty that the action's file gives."""
    x, y = (action.quantities[f"{body}.center_of_mass.{axis}"] for axis in "xy")
    mass, arm = action.quantities[f"{body}.mass"], math.hypot(x.value, y.value)
    u_arm = math.hypot(x.value * x.u, y.value * y.u) / arm
    moment = mass.value * action["gravity.g"] * arm
    return moment, moment * math.sqrt((mass.u / mass.value) ** 2 + (u_arm / arm) ** 2 + U_GRAVITY_RELATIVE**2)


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


def _write_action(
    given: model.Action, path: str, value: tuple[float, float], source: str, command: str, out: Path
) -> None:
    """Write the action with one value and its standard uncertainty as calibrated."""
    name = f"{given.name}-calibrated"
    changed = replace(with_calibrated(given, {path: value}, source), name=name)
    model.write_action(changed, out, [f"{name}: {given.name} with values calibrated by `pianorig {command}`."])


def calibrate_joint(
    body: str, rig: str | Path, backend: str, out: Path, action: str, swings: int, ask: Callable[[str], object]
) -> dict[str, Any]:
    """Let a body swing ``swings`` times; write the action ``out`` and a record beside it; return what was found.

    Raises
    ------
    CommandInputError : a file exists, or no such body
    rig.RigError : nothing swung, too few swings, or a fault of the bench
    """
    record = _record_beside(out, "swing")
    _check_swings(body, swings)
    given, rig_file = model.load_action(action), load_rig(rig)
    with interrupts_told(out):
        how = f"the {body} on its joint alone, 60 degrees up"
        found = swing(rig_file, _on_virtual(backend, "swing", body), body, swings, ask, how=how)
    moment, u_moment = weight_moment(given, body)
    torque = found.share * moment
    u = torque * math.hypot(found.u_share / found.share, u_moment / moment)
    path = f"{body}.joint_friction.A"
    _write_action(given, path, (torque, u), f"calibrated from {swings} free swings", "calibrate joint", out)
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
    _write_record(record, "swing", facts, found.device, action=given.name)
    return {"action": out, "record": record, **facts}


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
    record = _record_beside(out, "pad")
    _check_swings(order.body, order.swings)
    u = order.u_load_n, order.u_radius_m
    if not (order.load_n > 0 and order.radius_m > 0 and min(u) >= 0 and math.isfinite(sum(u))):
        raise CommandInputError("--load and --radius: allowed above 0; --u-load and --u-radius: from 0, finite")
    given, rig_file = model.load_action(action), load_rig(rig)
    path = f"{order.contact}.friction.A"
    if path not in given.quantities or given[path] == 0.0:
        rubbing = [name.split(".")[0] for name in given.quantities if name.endswith(".friction.A") and given[name] > 0]
        rubbing = [name for name in rubbing if name.startswith("contact")]
        raise CommandInputError(f"--contact {order.contact}: {given.name} has friction at {', '.join(rubbing)}")
    pad = f"{order.contact}:{order.load_n!r}:{order.radius_m!r}"
    with interrupts_told(out):
        drum = f"the {order.body} on its joint alone with the drum, 60 degrees up"
        bare, braked = (
            swing(rig_file, _on_virtual(backend, "swing", on), order.body, order.swings, ask, how=f"{drum}, {how}")
            for on, how in ((order.body, "the pad lifted off"), (f"{order.body}&pad={pad}", "the pad on it"))
        )
    facts = contact_friction(order, given, bare, braked)
    if facts["friction"] < 5 * facts["u_from_swings"]:
        raise CommandInputError(
            f"--load {order.load_n:g}: the pad's friction, {facts['friction']:.3g}, stands out of the joint's by less "
            f"than five standard uncertainties ({facts['u_from_swings']:.2g}); put more weight on it"
        )
    source = f"calibrated by a pad on a drum, {2 * order.swings} free swings"
    _write_action(given, path, (facts["friction"], facts["u_friction"]), source, "calibrate contact", out)
    _write_record(record, "pad", facts, braked.device, action=given.name)
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
