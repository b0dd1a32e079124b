"""``pianorig calibrate force``: dead weights, shunt or unloaded reading of the load cell."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

import rig
from pianorig import workflows
from pianorig.console.column_file import FIGURE_ENDINGS, check_writable
from pianorig.console.options import AsJson, Backend, Figure, Operator, Rig
from pianorig.console.output import file_lines, tell
from pianorig.console.terminal import type_answer
from pianorig.errors import CommandInputError
from rig.atomic_write import sha256_of_bytes, write_text


def command(
    out: Annotated[Path, typer.Option("--out", help="Rig file to write, with the values that follow.")],
    weights: Annotated[
        str | None, typer.Option("--weights", help="Masses to hang on the cell, kg, rising: 0.1,0.2,0.5,1.")
    ] = None,
    shunt: Annotated[bool, typer.Option("--shunt", help="Correct the gain by the module's shunt resistor.")] = False,
    null: Annotated[bool, typer.Option("--null", help="Shift the zero to the unloaded reading.")] = False,
    u_mass: Annotated[
        float, typer.Option("--u-mass", help="Standard uncertainty of a mass, kg.")
    ] = 1e-5,  # ten milligrams: a laboratory balance
    gravity: Annotated[
        float | None, typer.Option("--gravity", help="Local g, m/s^2; default 9.80665 with u = 0.015.")
    ] = None,
    rig_name: Rig = "virtual",
    backend: Backend = "sim://",
    operator: Operator = "unknown",
    figure: Figure = None,
    as_json: AsJson = False,
) -> None:
    """Calibrate the load cell: weights, shunt or zero.
    The motor stays at 0 V and the drive disabled. A new rig file is written, and a record beside it.

    Example:  pianorig calibrate force --weights 0.1,0.2,0.5,1 --out calibrated.toml
    """
    if [weights is not None, shunt, null].count(True) != 1:
        raise CommandInputError("calibrate force: give one of --weights, --shunt and --null")
    check_writable(figure, *FIGURE_ENDINGS)
    if figure is not None and weights is None:
        raise CommandInputError("--figure: draws what weights left over; give --weights")
    if u_mass < 0 or (gravity is not None and not 9.7 < gravity < 9.9):  # m/s^2: Earth
        raise CommandInputError(f"--u-mass {u_mass:g}, --gravity {gravity}: allowed from 0, and 9.7 to 9.9")
    try:
        masses = tuple(float(cell) for cell in (weights or "").split(",") if cell.strip())
    except ValueError:
        raise CommandInputError(f"--weights {weights}: allowed numbers in kg, separated by commas") from None
    kind = "weights" if weights is not None else "shunt" if shunt else "null"
    order = CalibrationOrder(kind, masses, u_mass, gravity, operator)
    facts = calibrate_force(rig_name, backend, out, order, type_answer)
    if figure is not None:
        hung = [mass * facts["gravity_m_per_s2"] for mass in facts["masses_kg"]]
        force = [(reading - facts["zero"]) / facts["slope_per_n"] for reading in facts["readings"]]
        away = [1e3 * (read - is_) for read, is_ in zip(force, hung, strict=True)]
        workflows.draw_deviations(hung, away, ("load cell: readings off the line", "weight, N", "off, mN"), figure)
    lines = (f"{key:<24} {value}" for key, value in facts.items())
    tell(as_json, facts | {"figure": figure}, (*lines, *file_lines([figure])))


@dataclass(frozen=True)
class CalibrationOrder:
    """What is calibrated: ``null``, ``shunt`` or ``weights``, for which masses, kg, and who does it."""

    kind: str
    masses_kg: tuple[float, ...]
    u_mass_kg: float
    gravity: float | None = None
    operator: str = "unknown"


def calibrate_force(
    rig_name: str, backend: str, out: Path, order: CalibrationOrder, ask: Callable[[str], object]
) -> dict[str, Any]:
    """Calibrate the force channel with weights, by its zero or its shunt, as ``order.kind`` says; write a rig file with
    the result to the new file ``out`` and a record beside; return what was found by name. ``ask`` waits for the
    operator."""
    # start-up: --help needs none of it
    from rig.calibration import load_cell
    from rig.configuration.rig_file_edit import rewrite_table
    from rig.simulated import SimulatedBackend

    record = workflows.calibration_record(out, order.kind)
    rig_file = rig.load_rig(rig_name)
    stated = rig_file.config.force.model_dump(include={"electrical", "physical_n", "u_gain_relative", "calibration"})
    rewrite_table(rig_file, "force", stated)
    with workflows.report_interrupt(out), closing(rig.open_backend(backend, rig_file.config)) as bench:

        def hang_weight(instruction: str, mass_kg: float) -> None:
            if isinstance(bench, SimulatedBackend):
                bench.device.bench.hung_n = mass_kg * (order.gravity or load_cell.STANDARD_GRAVITY)
            else:
                ask(f"{instruction}. Press Enter when it hangs still: ")

        if order.kind == "weights":
            done = load_cell.calibrate_with_weights(
                rig_file, bench, order.masses_kg, hang_weight, u_mass_kg=order.u_mass_kg, gravity=order.gravity
            )
        elif order.kind == "null":
            done = load_cell.calibrate_zero(rig_file, bench, hang_weight)
        else:
            done = load_cell.calibrate_with_shunt(rig_file, bench)  # type: ignore[arg-type]
        device = bench.capabilities.description
    write_text(out, done.rig_text)
    after = sha256_of_bytes(done.rig_text.encode("utf-8"))
    workflows.write_calibration_record(
        record, done.kind, done.found, device,
        operator=order.operator, rig_sha256_before=rig_file.sha256, rig_sha256_after=after,
    )  # fmt: skip
    return {"rig": out, "record": record, **done.found}
