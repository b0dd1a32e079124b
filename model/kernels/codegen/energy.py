"""Write the kernel of the energy audit of one scene: stored energy, power put in and powers lost at a state.

In: the integer tables of a scene; out: source text, compiled only when a run asks for it. See ``step_kernels``.
"""

from __future__ import annotations

from model.kernels import layout as L
from model.kernels import workspace as W
from model.kernels.codegen.bodies import mass, pose, thresholds, winding
from model.kernels.codegen.contact_memory import memory_energy
from model.kernels.codegen.contacts import contact_energy
from model.kernels.codegen.giving_bodies import giving_energy
from model.kernels.codegen.giving_steps import pins_audited
from model.kernels.codegen.probes import probe_energy
from model.kernels.codegen.step_kernels import AMPLIFIER_HEAD, HEAD, module
from model.kernels.codegen.string_contact import NAMES, string_energy_lines
from model.kernels.codegen.structure import Structure

MEMORY_HEAD = """from model.kernels.memory_laws import (
    hysteresis_energy, loading_curve, rubbing, stored_slowly, stulov, stulov_energy,
)
"""


def emit_energy(tables: L.Tables) -> str:
    """Source of ``energy`` alone: energy of a state, power put in and powers lost, for the energy audit."""
    s = Structure(tables)
    out = [f"q{i} = w[{W.AUDIT_Q + i}]\nv{i} = w[{W.AUDIT_V + i}]" for i in range(len(s.parent))]
    out += [
        *pins_audited(s),
        *pose(s),
        *mass(s),
        *thresholds(),
        "energy = 0.0",
        "felt_loss = 0.0",
        "friction_loss = 0.0",
        "joints = 0.0",
        "given = 0.0",
    ]
    if s.guided:
        out.append("rail_loss = 0.0")
    for i, w in enumerate(s.parent):
        law = ", ".join(s.body(i, k) for k in (L.JF_A, L.JF_B1, L.JF_B2))
        if i in s.guided:
            out += [f"force, _ = friction(v{i}, per_v, {law})", f"rail_loss += force * v{i}"]
            out.append(f"energy += 0.5 * md{i} * v{i} * v{i}")
            continue
        out += [f"torque, _ = friction(v{i}, per_omega, {law})", f"joints += torque * v{i}"]
        out.append(f"energy += 0.5 * md{i} * v{i} * v{i} + {s.body(i, L.MASS)} * p[{L.GRAVITY}] * (y{i} + ry{i})")
        if w >= 0:
            out.append(f"energy += mu{i} * v{i} * v{w}")
    for k, i in enumerate(s.spring):
        o = s.offset[0] + L.SPRING_SIZE * k
        out += [
            f"x = q{i} - p[{o + L.SPRING_Q0}]",
            f"energy += (0.5 * p[{o + L.SPRING_K}] * x - p[{o + L.SPRING_T0}]) * x",
        ]
    for k, (kind, i) in enumerate(s.drive):
        o = s.offset[2] + L.DRIVE_SIZE * k
        arm = f"(c{i} * p[{o + L.DRIVE_X}] - s{i} * p[{o + L.DRIVE_Y}])"
        if kind == L.FORCE_DOWN and s.vertical(i) >= 0:
            out.append(f"given -= u * v{s.vertical(i)}")
        if kind == L.AMPLIFIER:
            out += [f"f{i} = 0.0\nf{i - 1} = 0.0", *winding(i, o), f"given += volts * v{i}"]
            continue
        out.append(f"given -= u * {arm} * v{i}" if kind == L.FORCE_DOWN else f"given += u * v{i}")
    for c in range(len(s.contact)):
        if c in s.string:
            out += string_energy_lines(s, c)
            continue
        out += memory_energy(s, c) if s.memories(c) else contact_energy(s, c)
    for k in range(len(s.probe)):
        out += probe_energy(s, k)
    names = {W.ENERGY: "energy", W.POWER_IN: "given", W.POWER_FELT: "felt_loss", W.POWER_FRICTION: "friction_loss"}
    if s.guided:
        names[W.POWER_RAIL] = "rail_loss"
    driven = {i for _, i in s.drive}
    lost = [(i, f"p[{s.offset[5] + L.DAMPER_SIZE * k}]") for k, i in enumerate(s.damper)]
    lost += [(i, f"p[{s.offset[2] + L.WINDING_R}]") for kind, i in s.drive if kind == L.AMPLIFIER]
    for at, of_drive in ((W.POWER_SHANK, False), (W.POWER_DRIVE, True)):
        powers = [f"{number} * v{i} * v{i}" for i, number in lost if (i in driven) == of_drive]
        if powers:
            names[at] = " + ".join(powers)
    if s.pin:
        out += giving_energy(s)
        names[W.POWER_PINS] = "pin_loss"
    if s.string:
        names[W.POWER_STRING] = "string_loss"
    out += [f"w[{at}] = {name}" for at, name in names.items()]
    lines = [*out, f"w[{W.POWER_JOINTS}] = joints", "return 0"]
    head = HEAD + (MEMORY_HEAD if s.memory else "") + (NAMES if s.string else "")
    return module(("energy", "w, p, u", lines), head=head + (AMPLIFIER_HEAD if s.wound else ""))
