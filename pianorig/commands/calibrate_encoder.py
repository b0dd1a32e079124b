"""``pianorig calibrate encoder``: an encoder's scale over its arc, by reference angles."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pianorig import workflows
from pianorig.console.options import AsJson, Backend, Rig
from pianorig.console.output import tell
from pianorig.errors import CommandInputError


def command(
    body: Annotated[str, typer.Option("--body", help="key, whippen or hammer.")],
    angles: Annotated[str, typer.Option("--angles", help="Reference angles, rad, rising: 0,0.01,0.02,0.03.")],
    out: Annotated[Path, typer.Option("--out", help="Rig file to write, with this encoder's correction.")],
    u_angle: Annotated[float, typer.Option("--u-angle", help="Standard uncertainty of a reference angle, rad.")] = 5e-6,
    rig: Rig = "virtual",
    backend: Backend = "sim://",
    as_json: AsJson = False,
) -> None:
    """Calibrate an encoder over its arc.

    The body is held at each angle, up and down again; a scale off its centre reads a share too much or too little.

    Example:  pianorig calibrate encoder --body key --angles 0,0.01,0.02,0.03,0.04 --out my_arc.toml
    """
    try:
        given = [float(cell) for cell in angles.split(",") if cell.strip()]
    except ValueError:
        raise CommandInputError(f"--angles {angles}: allowed numbers in rad, separated by commas") from None
    facts = workflows.calibrate_encoder(body, given, u_angle, rig, backend, out)
    lines = (
        f"{body}: angle = {facts['gain']:.6f} of the reading  u {facts['u_gain']:.2g}; readings up to "
        f"{1e6 * facts['worst_rad']:.2g} urad off the line",
        f"{out}: with what the rig file knew {facts['arc_gain']:.6f}  u {facts['u_arc_gain']:.2g}; readings in "
        f"{facts['record']}",
    )
    tell(as_json, facts, lines)
