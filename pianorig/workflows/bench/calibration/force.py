"""Guided calibrations of the load cell: a dated record, and the rig file that follows from it."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pianorig.errors import CommandInputError
from pianorig.workflows.bench.interrupted import interrupts_told
from rig import load_rig, open_backend
from rig.calibration.guided import STANDARD_GRAVITY, Calibration, dead_weights, null, shunt
from rig.configuration.toml_file import dump_toml
from rig.simulated import SimulatedBackend
from rig.storage.atomic_write import sha256_of_bytes, write_text

SCHEMA = "piano-action-rig calibration 1"


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
    record = out.with_suffix(f".{order.kind}.toml")
    for file in (out, record):
        if file.exists():
            raise CommandInputError(f"{file}: exists already; choose another --out")
    rig_file = load_rig(rig)
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
        facts = _facts(done, order, rig_file.sha256, bench.capabilities.description)
    write_text(out, done.rig_text)
    write_text(record, dump_toml({**facts, "rig_sha256_after": sha256_of_bytes(done.rig_text.encode("utf-8"))}))
    return {"rig": out, "record": record, **done.found}


def _facts(done: Calibration, order: CalibrationOrder, sha256: str, device: dict[str, str]) -> dict[str, Any]:
    return {
        "schema": SCHEMA,
        "kind": done.kind,
        "created_utc": done.created_utc.isoformat(timespec="seconds"),
        "operator": order.operator,
        "rig_sha256_before": sha256,
        "found": done.found,
        "device": device,
    }
