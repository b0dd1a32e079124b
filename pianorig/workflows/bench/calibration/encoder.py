"""The scale of an encoder over its arc: guided readings at reference angles, and the rig file that follows."""

from __future__ import annotations

import sys
from contextlib import closing
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from numpy.typing import ArrayLike

from pianorig.errors import CommandInputError
from pianorig.workflows.bench.interrupted import interrupts_told
from rig import load_rig, open_backend
from rig.calibration.arc import corrected_rig, fit_arc, read_plateaus, there_and_back, with_what_was_known
from rig.configuration.channels import BODIES
from rig.configuration.toml_file import dump_toml
from rig.storage.atomic_write import sha256_of_bytes, write_text

SCHEMA = "piano-action-rig calibration 1"


def calibrate_encoder(
    body: str, angles_rad: ArrayLike, u_angle_rad: float, rig: str | Path, backend: str, out: Path
) -> dict[str, Any]:
    """Read an encoder at reference angles, up and down; write the rig file ``out`` and a record beside it.

    Raises
    ------
    CommandInputError : a file exists, no such body, an uncertainty below 0
    rig.RigError : angles that cannot be used, rests not seen, readings that do not follow, or a fault of the bench
    """
    record = out.with_suffix(".arc.toml")
    for file in (out, record):
        if file.exists():
            raise CommandInputError(f"{file}: exists already; choose another --out")
    if body not in BODIES:
        raise CommandInputError(f"--body {body}: allowed {', '.join(BODIES)}, the bodies with an encoder")
    if not 0 <= u_angle_rad < 0.01:
        raise CommandInputError(f"--u-angle {u_angle_rad:g}: allowed 0 to 0.01 rad")
    rig_file, references = load_rig(rig), there_and_back(angles_rad)
    address = backend
    if backend.startswith("sim://") and "pose=" not in backend:
        listed = ",".join(f"{angle:.9g}" for angle in references)
        address += f"{'&' if '?' in backend else '?'}pose={body}:{listed}"
    with interrupts_told(out), closing(open_backend(address, rig_file.config)) as bench:
        if bench.capabilities.hardware:
            said = ", ".join(f"{angle:g}" for angle in references)
            print(f"hold the {body} at {said} rad, two seconds each", file=sys.stderr, flush=True)
        readings = read_plateaus(bench, rig_file.config, body, references)
        device = bench.capabilities.description
    arc = fit_arc(references, readings, u_angle_rad, rig_file.config.encoders[BODIES.index(body)].counter)
    text = corrected_rig(rig_file, body, arc)
    write_text(out, text)
    head = {"schema": SCHEMA, "kind": "arc", "created_utc": datetime.now(UTC).isoformat(timespec="seconds")}
    after = sha256_of_bytes(text.encode("utf-8"))
    found = {"body": body, "u_angle_rad": u_angle_rad, **asdict(arc)}
    table = {**head, "rig_sha256_before": rig_file.sha256, "rig_sha256_after": after, "found": found, "device": device}
    write_text(record, dump_toml(table))
    stored, u_stored = with_what_was_known(rig_file, body, arc)
    return {"rig": out, "record": record, **found, "arc_gain": stored, "u_arc_gain": u_stored}
