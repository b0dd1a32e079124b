"""Source lines of bodies: pose, mass matrix, forces of inertia, gravity, joints, springs and drives, derivatives.

See ``step_kernels``. A body hangs from the ground, from another body, or from a vertical guide without mass,
whose coordinate is its height.
"""

from __future__ import annotations

from collections.abc import Iterable

from model.kernels import layout as L
from model.kernels import workspace as W
from model.kernels.codegen.giving_bodies import (
    giving_derivatives,
    giving_forces,
    giving_mass,
    moved_pivot,
    stored_mass,
)
from model.kernels.codegen.structure import Structure


def rotations(s: Structure) -> list[str]:
    """Cosine and sine of the angle of each body from ground; those of one run at once, where vectors pay."""
    angle = {i: f"q{i} + q{s.parent[i]}" if s.parent[i] >= 0 and s.guide(i) < 0 else f"q{i}" for i in s.turning()}
    if not s.bundles:
        return [f"c{i}, s{i} = cosine_sine({text})" for i, text in angle.items()]
    out = [f"cosines, sines = cosines_sines({bundle(angle.values())})"]
    for k, i in enumerate(angle):
        out += [f"c{i} = number(cosines, {k})", f"s{i} = number(sines, {k})"]
    return out


def bundle(texts: Iterable[str]) -> str:
    """Text of numbers of one run side by side."""
    return f"bundled({W.WIDTH}, {', '.join(texts)})"


def joint_friction(s: Structure, slopes: bool) -> list[str]:
    """Friction of each joint as ``torque`` and, where asked for, its slope ``e``; of all at once, where vectors pay."""
    out, laws = [], (L.JF_A, L.JF_B1, L.JF_B2)
    joints = [i for i in range(s.own) if i not in s.guided]
    for i in range(s.own):
        if not s.bundles or i in s.guided:
            per = "per_v" if i in s.guided else "per_omega"
            law = ", ".join(s.body(i, k) for k in laws)
            out.append(f"torque{i}, {f'e{i}' if slopes else '_'} = friction(v{i}, {per}, {law})")
    if s.bundles and joints:
        numbers = [bundle(s.body(i, k) for i in joints) for k in laws]
        out.append(f"torques, easings = frictions({bundle(f'v{i}' for i in joints)}, per_omega, {', '.join(numbers)})")
        for k, i in enumerate(joints):
            out += [f"torque{i} = number(torques, {k})", *([f"e{i} = number(easings, {k})"] if slopes else [])]
    return out


def pose(s: Structure) -> list[str]:
    """Pivot, rotation, turning speed and centre of mass of each body."""
    out = rotations(s)
    for i in s.order():
        w, px, py = s.parent[i], s.body(i, L.PIVOT_X), s.body(i, L.PIVOT_Y)
        if i in s.guided:
            out += [f"x{i} = {px}", f"y{i} = {py} + q{i}"]
            continue
        if s.guide(i) >= 0:
            out += [f"x{i} = x{w} + {px}", f"y{i} = y{w} + {py}", f"w{i} = v{i}"]
        elif w < 0:
            out += [f"x{i} = {px}", f"y{i} = {py}", f"w{i} = v{i}"]
        else:
            out += [f"dx{i} = c{w} * {px} - s{w} * {py}", f"dy{i} = s{w} * {px} + c{w} * {py}"]
            out += [f"x{i} = x{w} + dx{i}", f"y{i} = y{w} + dy{i}", f"w{i} = v{i} + w{w}"]
        out += moved_pivot(s, i)
        cx, cy = s.body(i, L.COM_X), s.body(i, L.COM_Y)
        out += [f"rx{i} = c{i} * {cx} - s{i} * {cy}", f"ry{i} = s{i} * {cx} + c{i} * {cy}"]
    return out


def mass(s: Structure) -> list[str]:
    """Diagonal and child-parent entries of the mass matrix of what is solved for."""
    out = []
    for i in range(s.own):
        if i in s.guided:
            out.append(f"md{i} = {s.body(i, L.MASS)}")
            continue
        out.append(f"md{i} = {s.body(i, L.INERTIA)} + {s.body(i, L.MASS)} * (rx{i} * rx{i} + ry{i} * ry{i})")
    for i, w in enumerate(s.parent):
        if w >= 0:
            m = s.body(i, L.MASS)
            if w in s.guided:
                out += [f"mu{i} = {m} * rx{i}", f"md{w} += {m}"]
                continue
            out += [f"h{i} = {m} * (dx{i} * rx{i} + dy{i} * ry{i})", f"mu{i} = md{i} + h{i}"]
            out.append(f"md{w} += md{i} + {m} * (dx{i} * dx{i} + dy{i} * dy{i}) + 2.0 * h{i}")
    return [*out, *giving_mass(s)]


def solve_mass(s: Structure, at: int = W.P_HERE) -> list[str]:
    """Accelerations of what is solved for: M a = f, children eliminated into their parents.

    Where joints give, the mass matrix is written to ``at``.
    """
    if s.pin:
        n = range(s.free)
        out = [*stored_mass(s, at), *(f"w[{W.P_FORCE + i}] = f{i}" for i in n), f"accelerated(w, {at}, {s.free})"]
        return [*out, *(f"a{i} = w[{W.P_FORCE + i}]" for i in n)]
    out = []
    for i, w in enumerate(s.parent):
        if w >= 0:
            out += [f"i{i} = 1.0 / md{i}", f"z{i} = mu{i} * i{i}"]
    for w in (i for i, up in enumerate(s.parent[: s.free]) if up < 0):
        top = " ".join([f"f{w}", *(f"- z{i} * f{i}" for i in s.children(w))])
        bottom = " ".join([f"md{w}", *(f"- z{i} * mu{i}" for i in s.children(w))])
        out.append(f"a{w} = ({top}) / ({bottom})")
    for i, w in enumerate(s.parent):
        if w >= 0:
            out.append(f"a{i} = f{i} * i{i} - z{i} * a{w}")
    return out


def thresholds() -> list[str]:
    """One over the threshold speeds of friction: a division each, not one for each contact and joint."""
    return [f"per_v = 1.0 / p[{L.V_T}]", f"per_omega = 1.0 / p[{L.OMEGA_T}]"]


def forces(s: Structure, slopes: bool) -> list[str]:
    """Generalised forces of everything but contacts; with the slopes of joint friction where asked for."""
    out = [f"g = p[{L.GRAVITY}]", *thresholds()]
    out += joint_friction(s, slopes)
    for i in range(s.own):
        weight = "" if i in s.guided else f" * rx{i}"
        out.append(f"f{i} = -torque{i} - {s.body(i, L.MASS)} * g{weight}")
    out += giving_forces(s)
    for i, w in enumerate(s.parent):
        if w >= 0:
            m = s.body(i, L.MASS)
            if w in s.guided:
                out.append(f"f{w} -= {m} * (g - ry{i} * v{i} * v{i})")
                continue
            out += [
                f"t{i} = {m} * (dy{i} * rx{i} - dx{i} * ry{i})",
                f"f{w} -= {m} * g * (dx{i} + rx{i}) + t{i} * (2.0 * w{w} + v{i}) * v{i}",
                f"f{i} += t{i} * w{w} * w{w}",
            ]
    for k, i in enumerate(s.spring):
        o = s.offset[0] + L.SPRING_SIZE * k
        out.append(f"f{i} += p[{o + L.SPRING_T0}] - p[{o + L.SPRING_K}] * (q{i} - p[{o + L.SPRING_Q0}])")
    for k, (kind, i) in enumerate(s.drive):
        o = s.offset[2] + L.DRIVE_SIZE * k
        if i >= s.free:
            continue
        if kind == L.FORCE_DOWN:
            out.append(f"f{i} -= u * (c{i} * p[{o + L.DRIVE_X}] - s{i} * p[{o + L.DRIVE_Y}])")
            if s.vertical(i) >= 0:
                out.append(f"f{s.vertical(i)} -= u")
        elif kind == L.AMPLIFIER:
            out += winding(i, o)
        else:
            out.append(f"f{i} += u")
    for k, i in enumerate(s.damper):
        out.append(f"f{i} -= p[{s.offset[5] + L.DAMPER_SIZE * k}] * v{i}")
    return out


def winding(i: int, o: int) -> list[str]:
    """Voltages in a winding and the torque of its current on the motor before it; the amplifier's ``volts``."""
    numbers = ", ".join(f"p[{o + k}]" for k in range(L.WINDING_AMPLIFIER, L.WINDING_SIZE))
    return [
        f"volts, volts_u, volts_i = amplifier(u, v{i}, {numbers})",
        f"f{i} += volts - p[{o + L.WINDING_R}] * v{i} - p[{o + L.WINDING_K}] * v{i - 1}",
        f"f{i - 1} += p[{o + L.WINDING_K}] * v{i}",
    ]


def derivatives(s: Structure) -> list[str]:
    """K, D and df/du of everything but contacts, after the accelerations are known."""
    out = [f"u{i} = 0.0" for i in range(s.free)] + [f"moving = 1.0 - w[{W.STATIC}]"]
    for i, w in enumerate(s.parent[: s.free]):
        m = s.body(i, L.MASS)
        out.append(f"{s.damping(i, i)} -= e{i}")
        if i in s.guided:
            continue
        out.append(f"{s.stiffness(i, i)} += {m} * g * ry{i}")
        if w in s.guided:
            out += [
                f"{s.stiffness(w, i)} += {m} * (rx{i} * v{i} * v{i} + moving * ry{i} * a{i})",
                f"{s.stiffness(i, i)} += moving * {m} * ry{i} * a{w}",
                f"{s.damping(w, i)} += 2.0 * {m} * ry{i} * v{i}",
            ]
        elif w >= 0:
            out += [
                f"{s.stiffness(w, w)} += {m} * g * (dy{i} + ry{i})",
                f"{s.stiffness(i, w)} += {m} * g * ry{i}",
                f"{s.stiffness(w, i)} += {m} * g * ry{i} + h{i} * (2.0 * w{w} + v{i}) * v{i}"
                f" - moving * t{i} * (2.0 * a{w} + a{i})",
                f"{s.stiffness(i, i)} -= h{i} * w{w} * w{w} + moving * t{i} * a{w}",
                f"{s.damping(w, w)} -= 2.0 * t{i} * v{i}",
                f"{s.damping(w, i)} -= 2.0 * t{i} * (w{w} + v{i})",
                f"{s.damping(i, w)} += 2.0 * t{i} * w{w}",
            ]
    for k, i in enumerate(s.spring):
        out.append(f"{s.stiffness(i, i)} -= p[{s.offset[0] + L.SPRING_SIZE * k + L.SPRING_K}]")
    for k, (kind, i) in enumerate(s.drive):
        o = s.offset[2] + L.DRIVE_SIZE * k
        if i >= s.free:
            continue
        if kind == L.FORCE_DOWN:
            x, y = f"p[{o + L.DRIVE_X}]", f"p[{o + L.DRIVE_Y}]"
            out += [f"u{i} -= c{i} * {x} - s{i} * {y}", f"{s.stiffness(i, i)} += u * (s{i} * {x} + c{i} * {y})"]
            if s.vertical(i) >= 0:
                out.append(f"u{s.vertical(i)} -= 1.0")
        elif kind == L.AMPLIFIER:
            turn = f"p[{o + L.WINDING_K}]"
            out += [f"u{i} += volts_u", f"{s.damping(i, i)} += volts_i - p[{o + L.WINDING_R}]"]
            out += [f"{s.damping(i, i - 1)} -= {turn}", f"{s.damping(i - 1, i)} += {turn}"]
        else:
            out.append(f"u{i} += 1.0")
    for k, i in enumerate(s.damper):
        out.append(f"{s.damping(i, i)} -= p[{s.offset[5] + L.DAMPER_SIZE * k}]")
    out += giving_derivatives(s)
    # where the key is prescribed the input is the time: df/dt comes through the motion of the key
    out += [
        f"u{i} += {s.stiffness(i, j)} * v{j} + {s.damping(i, j)} * a{j}" for i, j in sorted(s.pattern() - s.square())
    ]
    return out
