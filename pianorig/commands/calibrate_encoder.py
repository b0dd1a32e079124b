"""``pianorig calibrate encoder``: an encoder's scale over its arc, by reference angles."""

from __future__ import annotations

import sys
from contextlib import closing
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import rig
from pianorig import workflows
from pianorig.console.column_file import FIGURE_ENDINGS, check_writable
from pianorig.console.options import AsJson, Backend, Figure, Rig
from pianorig.console.output import file_lines, tell
from pianorig.errors import CommandInputError
from rig.atomic_write import sha256_of_bytes, write_text

if TYPE_CHECKING:
    from numpy.typing import ArrayLike


def command(
    body: Annotated[str, typer.Option("--body", help="key, whippen or hammer.")],
    angles: Annotated[str, typer.Option("--angles", help="Reference angles, rad, rising: 0,0.01,0.02,0.03.")],
    out: Annotated[Path, typer.Option("--out", help="Rig file to write, with this encoder's correction.")],
    u_angle: Annotated[
        float, typer.Option("--u-angle", help="Standard uncertainty of a reference angle, rad.")
    ] = 5e-6,  # one arc second: an indexing table
    rig_name: Rig = "virtual",
    backend: Backend = "sim://",
    figure: Figure = None,
    as_json: AsJson = False,
) -> None:
    """Calibrate an encoder over its arc.
    The body is held at each angle, up and down again; a scale off its centre reads a share too much or too little. A
    new rig file is written, and a record beside it.

    Example:  pianorig calibrate encoder --body key --angles 0,0.01,0.02,0.03,0.04 --out my_arc.toml
    """
    try:
        given = [float(cell) for cell in angles.split(",") if cell.strip()]
    except ValueError:
        raise CommandInputError(f"--angles {angles}: allowed numbers in rad, separated by commas") from None
    check_writable(figure, *FIGURE_ENDINGS)
    facts = calibrate_encoder(body, given, u_angle, rig_name, backend, out)
    lines = (
        f"{body}: angle = {facts['gain']:.6f} of the reading (standard uncertainty {facts['u_gain']:.2g})",
        f"  readings up to {1e6 * facts['worst_rad']:.2g} urad off the line",
        f"{out}: with what the rig file knew {facts['arc_gain']:.6f} (standard uncertainty {facts['u_arc_gain']:.2g})",
        f"  readings in {facts['record']}",
    )
    if figure is not None:
        at, read = facts["references_rad"], facts["readings_rad"]
        mid, mean = sum(at) / len(at), sum(read) / len(read)
        away = [1e6 * (r - mean - (a - mid) / facts["gain"]) for a, r in zip(at, read, strict=True)]
        words = (f"encoder of the {body}, gain {facts['gain']:.6f}", "reference angle, mrad", "left over, urad")
        workflows.draw_deviations([1e3 * a for a in at], away, words, figure)
        facts["figure"] = figure
    tell(as_json, facts, (*lines, *file_lines([figure])))


def calibrate_encoder(
    body: str, angles_rad: ArrayLike, u_angle_rad: float, rig_name: str, backend: str, out: Path
) -> dict[str, Any]:
    """Read the encoder of ``body`` at reference angles, rad, up and down, write a rig file corrected by it to the new
    file ``out`` and a record beside; return what was found by name. ``u_angle_rad``: standard uncertainty of a
    reference."""
    # start-up: --help needs none of it
    from rig.calibration import encoder_scale
    from rig.configuration.rig_file import BODIES
    from rig.configuration.rig_file_edit import rewrite_table

    record = workflows.calibration_record(out, "arc")
    workflows.check_body(body)
    if not 0 <= u_angle_rad < 0.01:  # more is no reference
        raise CommandInputError(f"--u-angle {u_angle_rad:g}: allowed 0 to 0.01 rad")
    rig_file, references = rig.load_rig(rig_name), encoder_scale.order_up_and_down(angles_rad)
    rewrite_table(rig_file, "encoders", {"arc_gain": 1.0, "u_eccentricity_rad": 0.0}, named=body)
    address = workflows.virtual_address(backend, "pose", f"{body}:{','.join(f'{angle:.9g}' for angle in references)}")
    with workflows.report_interrupt(out), closing(rig.open_backend(address, rig_file.config)) as bench:
        if bench.capabilities.hardware:
            said = ", ".join(f"{angle:g}" for angle in references)
            print(f"hold the {body} at {said} rad, two seconds each", file=sys.stderr, flush=True)
        readings = encoder_scale.read_plateaus(bench, rig_file.config, body, references)
        device = bench.capabilities.description
    arc = encoder_scale.fit_arc(references, readings, u_angle_rad, rig_file.config.encoders[BODIES.index(body)])
    text = encoder_scale.correct_rig_text(rig_file, body, arc)
    write_text(out, text)
    found = {"body": body, "u_angle_rad": u_angle_rad, **asdict(arc)}
    after = sha256_of_bytes(text.encode("utf-8"))
    workflows.write_calibration_record(
        record, "arc", found, device, rig_sha256_before=rig_file.sha256, rig_sha256_after=after
    )
    stored, u_stored = encoder_scale.combine_with_rig_file(rig_file, body, arc)
    return {"rig": out, "record": record, **found, "arc_gain": stored, "u_arc_gain": u_stored}
