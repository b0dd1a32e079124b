"""``pianorig calibrate contact``: friction of a contact's materials, by a pad that brakes a swinging body."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pianorig import workflows
from pianorig.console.options import DEFAULT_ACTION, Action, AsJson, Backend, Rig
from pianorig.console.output import tell
from pianorig.console.terminal import type_answer


def command(
    contact: Annotated[str, typer.Option("--contact", help="Contact whose materials rub, e.g. contact04.")],
    load: Annotated[float, typer.Option("--load", help="Weight of the pad on the drum, N.")],
    radius: Annotated[float, typer.Option("--radius", help="Radius of the drum, m.")],
    out: Annotated[Path, typer.Option("--out", help="TOML file to write: the action with this contact's friction.")],
    u_load: Annotated[float, typer.Option("--u-load", help="Standard uncertainty of the weight, N.")] = 0.0,
    u_radius: Annotated[float, typer.Option("--u-radius", help="Standard uncertainty of the radius, m.")] = 0.0,
    body: Annotated[str, typer.Option("--body", help="key, whippen or hammer: the body that swings.")] = "hammer",
    swings: Annotated[int, typer.Option("--swings", help="How often it is let go, without the pad and with it.")] = 3,
    action: Action = DEFAULT_ACTION,
    rig: Rig = "virtual",
    backend: Backend = "sim://",
    as_json: AsJson = False,
) -> None:
    """Calibrate the friction of a contact.

    The kinetic one: a drum of one of its materials sits on the axis of a swinging body, a pad of the other rests on it.

    Example:  pianorig calibrate contact --contact contact04 --load 0.1 --radius 0.012 --out my_pair.toml
    """
    order = workflows.PadOrder(contact, load, u_load, radius, u_radius, body, swings)
    facts = workflows.calibrate_contact(order, rig, backend, out, action, type_answer)
    lines = (
        f"{contact}: friction {facts['friction']:.4g}  u {facts['u_friction']:.2g}, slip up to "
        f"{facts['slip_up_to_m_per_s']:.2g} m/s; half swings {', '.join(map(str, facts['half_swings']))}",
        f"{out}: the action with {contact}.friction.A; readings in {facts['record']}",
    )
    tell(as_json, facts, lines)
