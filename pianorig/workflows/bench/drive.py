"""``pianorig calibrate-drive``: a log read or rehearsed, the drive identified, a scene written of it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import model
from model.parameters.effects import effect_defaults
from pianorig.console.overrides import read_measured
from pianorig.errors import CommandInputError
from rig.storage.atomic_write import write_text

SUM = "resistance_and_loop_gain"


@dataclass(frozen=True)
class DriveOrder:
    """What is known beside a log, as typed."""

    mode: str
    length: str
    known: tuple[str, ...]
    u_force: float
    u_current: float
    u_delay_s: float

    def options(self) -> model.drive.DriveOptions:
        """The same, checked."""
        known = {}
        for text in self.known:
            name, sign, value = text.partition("=")
            found, u = read_measured(value, f"--known {name}") if sign else (0.0, None)
            if u is None:
                raise CommandInputError(f"--known {text!r}: allowed NAME=VALUE+-U, as in current_gain=2.0+-0.02")
            known[name] = (found, u)
        length, u_length = read_measured(self.length, "--length")
        return model.drive.DriveOptions(
            self.mode, length, u_length or 0.0, self.u_force, self.u_current, self.u_delay_s, known=known
        )


@dataclass(frozen=True)
class DriveTold:
    """What the command says: lines for people, facts for programs."""

    lines: list[str]
    facts: dict[str, object]


def identify_drive(log: Path, order: DriveOrder, out: Path | None) -> DriveTold:
    """The drive of a log; a scene of it in ``out``."""
    found = model.drive.identify_drive(model.drive.read_drive_log(log), order.options())
    if out is not None:
        write_text(out, scene_text(found, order))
    return DriveTold(found.lines(), _facts(found))


def rehearse_drive(action: str, scene: str, order: DriveOrder, current: bool, out: Path | None) -> DriveTold:
    """What a log of a known drive tells, beside the truth; the log in ``out``."""
    chosen, choice = model.load_action(action), model.load_scene(scene)
    log = model.drive.simulated_log(chosen, choice, model.drive.identification_command(chosen, choice), current=current)
    if out is not None:
        model.drive.write_drive_log(out, log)
    truth = choice.on(chosen)
    mode = "voltage" if truth["motor_drive.voltage_gain"] != 0.0 else "torque"
    found = model.drive.identify_drive(log, DriveOrder(mode, *list(vars(order).values())[1:]).options())
    lines = [f"a rehearsal: the log of {scene}, simulated with noise; true values in brackets", "drive:"]
    true = {name: truth[f"motor_drive.{name}"] for name in ("resistance", "loop_gain")}
    true |= {e.name: truth[f"motor_drive.{e.name}"] for e in found.drive if e.name != SUM}
    true[SUM] = true["resistance"] + true["loop_gain"]
    lines += [f"{_line(e)}  [{true[e.name]:.4g}]" for e in found.drive]
    return DriveTold([*lines, *(_line(e) for e in (*found.combinations, *found.arm))], _facts(found))


def scene_text(found: model.drive.DriveIdentified, order: DriveOrder) -> str:
    """A scene file with what was determined; the rest keeps the values of `model/parameters/effects.toml`."""
    arm, drive = ["[motor_arm]", f"length = {read_measured(order.length, '--length')[0]!r}"], ["[motor_drive]"]
    for name in ("inertia", "joint_friction", "spring_stiffness"):
        e = found[name]
        if e.determined and e.value > e.u:
            arm.append(f"{name} = {e.value!r}  # u {e.u:.2g} {e.unit}")
    for e in (e for e in found.drive if e.name != SUM):
        drive.append(f"{e.name} = {e.value!r}  # u {e.u:.2g} {e.unit}" if e.determined else f"# {e.name}: {e.why}")
    if found.mode == "voltage":
        drive += ["current_gain = 0.0", "loop_gain = 0.0"]
    elif found[SUM].determined and not found["loop_gain"].determined:
        assumed = effect_defaults()["motor_drive.resistance"].value
        drive += [f"resistance = {assumed!r}  # assumed; of both together the log says {found[SUM].value:.4g} V/A"]
        drive += [f"loop_gain = {found[SUM].value - assumed!r}"]
    return "\n".join(["# by pianorig calibrate-drive", *arm, "", *drive]) + "\n"


def _line(e: model.drive.Estimate) -> str:
    words = f"{e.value:.4g}  u {e.u:.2g} {e.unit}" if e.determined else f"not determined: {e.why}"
    return f"  {e.name:24s} {words}"


def _facts(found: model.drive.DriveIdentified) -> dict[str, object]:
    items = (*found.drive, *found.combinations, *found.arm)
    return {
        "mode": found.mode,
        "determined": {e.name: {"value": e.value, "u": e.u, "unit": e.unit} for e in items if e.determined},
        "not_determined": {e.name: e.why for e in items if not e.determined},
        "rms_nm": found.rms_nm,
    }
