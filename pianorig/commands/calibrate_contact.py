"""``pianorig calibrate contact``: friction of a contact's materials, by a pad that brakes a swinging body."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
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
from pianorig.errors import CommandInputError


def command(
    contact: Annotated[str, typer.Option("--contact", help="Contact whose materials rub, e.g. contact04.")],
    load: Annotated[float, typer.Option("--load", help="Weight of the pad on the drum, N.")],
    radius: Annotated[float, typer.Option("--radius", help="Radius of the drum, m.")],
    out: Annotated[Path, typer.Option("--out", help="TOML file to write: the action with this contact's friction.")],
    u_load: Annotated[float, typer.Option("--u-load", help="Standard uncertainty of the weight, N.")] = 0.0,
    u_radius: Annotated[float, typer.Option("--u-radius", help="Standard uncertainty of the radius, m.")] = 0.0,
    body: Annotated[str, typer.Option("--body", help="key, whippen or hammer: the body that swings.")] = "hammer",
    swings: Annotated[
        int, typer.Option("--swings", help="How often it is let go, without the pad and with it.")
    ] = 3,  # choice: their scatter is known to a half
    action: Action = DEFAULT_ACTION,
    rig_name: Rig = "virtual",
    backend: Backend = "sim://",
    figure: Figure = None,
    as_json: AsJson = False,
) -> None:
    """Calibrate the friction of a contact.
    The kinetic one: a drum of one of its materials sits on the axis of a swinging body, a pad of the other rests on it.
    The action with it is written to a new file, and a record beside it.

    Example:  pianorig calibrate contact --contact contact04 --load 0.1 --radius 0.012 --out my_pair.toml
    """
    check_writable(figure, *FIGURE_ENDINGS)
    order = PadOrder(contact, load, u_load, radius, u_radius, swings, body)
    facts = calibrate_contact(order, rig_name, backend, out, action, type_answer)
    lines = (
        f"{contact}: friction {facts['friction']:.4g} (standard uncertainty {facts['u_friction']:.2g})",
        f"  slip up to {facts['slip_up_to_m_per_s']:.2g} m/s; half swings {', '.join(map(str, facts['half_swings']))}",
        f"{out}: the action with {contact}.friction.A; readings in {facts['record']}",
    )
    if figure is not None:
        bare = sum(facts["shares_without"]) / len(facts["shares_without"])
        arm = facts["weight_moment_nm"] / (load * radius)
        each = [(share - bare) * arm for share in facts["shares_with"]]
        words = (f"friction of {contact}, each swing with the pad", "swing", "coefficient of friction")
        workflows.draw_deviations(range(1, len(each) + 1), each, words, figure)
    tell(as_json, facts | {"figure": figure}, (*lines, *file_lines([figure])))


KINETIC = 10.0  # times the law's threshold speed: from there its friction is kinetic within two thousandths
SURE = 5.0  # standard uncertainties, by which the pad's friction stands out of the joint's


@dataclass(frozen=True)
class PadOrder:
    """The pad on the drum: which contact's materials, under what load, N, at what radius, m, with their u."""

    contact: str
    load_n: float
    u_load_n: float
    radius_m: float
    u_radius_m: float
    swings: int
    body: str = "hammer"


def calibrate_contact(
    order: PadOrder, rig_name: str, backend: str, out: Path, action: str, ask: Callable[[str], object]
) -> dict[str, Any]:
    """Let a body swing on the bench without and with a pad on a drum, find the pad's coefficient of friction, write an
    action with it to the new file ``out`` and a record beside; return the facts by name. ``ask`` shows a question to
    the operator."""
    record = workflows.calibration_record(out, "pad")
    workflows.check_swings(order.body, order.swings)
    u = order.u_load_n, order.u_radius_m
    if not (order.load_n > 0 and order.radius_m > 0 and min(u) >= 0 and math.isfinite(sum(u))):
        raise CommandInputError("--load and --radius: allowed above 0; --u-load and --u-radius: from 0, finite")
    given, rig_file = model.load_action(action), rig.load_rig(rig_name)
    path = f"{order.contact}.friction.A"
    if path not in given.quantities or given[path] == 0.0:
        rubbing = [name.split(".")[0] for name in given.quantities if name.endswith(".friction.A") and given[name] > 0]
        rubbing = [name for name in rubbing if name.startswith("contact")]
        raise CommandInputError(f"--contact {order.contact}: {given.name} has friction at {', '.join(rubbing)}")
    pad = f"{order.contact}:{order.load_n!r}:{order.radius_m!r}"
    with workflows.report_interrupt(out):
        drum = f"the {order.body} on its joint alone with the drum, 60 degrees up"
        bare, braked = (
            workflows.read_swings(
                rig_file,
                workflows.virtual_address(backend, "swing", on),
                order.body,
                order.swings,
                ask,
                how=f"{drum}, {how}",
            )
            for on, how in ((order.body, "the pad lifted off"), (f"{order.body}&pad={pad}", "the pad on it"))
        )
    facts = contact_friction(order, given, bare, braked)
    if facts["friction"] < SURE * facts["u_from_swings"]:
        raise CommandInputError(
            f"--load {order.load_n:g}: the pad's friction, {facts['friction']:.3g}, stands out of the joint's by less "
            f"than five standard uncertainties ({facts['u_from_swings']:.2g}); put more weight on it"
        )
    source = f"calibrated by a pad on a drum, {2 * order.swings} free swings"
    workflows.write_calibrated_action(
        given, path, (facts["friction"], facts["u_friction"]), source, "calibrate contact", out
    )
    workflows.write_calibration_record(record, "pad", facts, braked.device, action=given.name)
    return {"action": out, "record": record, **facts}


def contact_friction(
    order: PadOrder, action: model.Action, bare: workflows.Swings, braked: workflows.Swings
) -> dict[str, Any]:
    """Facts by name: coefficient of friction ``friction`` from swings ``bare`` and ``braked`` by the pad, its standard
    uncertainty, and what both are made of; `CommandInputError` where the pad slipped too slowly."""
    # start-up: --help needs none of it
    from rig.calibration.joint_friction import MOVING_SHARE

    moment, u_moment = workflows.weight_moment(action, order.body)
    more = braked.share - bare.share
    arm_n = order.load_n * order.radius_m
    value = more * moment / arm_n
    from_swings = math.hypot(braked.u_share, bare.u_share) * moment / arm_n
    parts = (u_moment / moment, order.u_load_n / order.load_n, order.u_radius_m / order.radius_m)
    top = max(one.top_rad_per_s for one in braked.each) * order.radius_m
    least = KINETIC * action["friction_threshold.v_t"] / MOVING_SHARE
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
