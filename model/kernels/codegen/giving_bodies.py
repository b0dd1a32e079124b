"""Source lines of bodies whose joints give: what the directions in which they give add to ``bodies``.

The pivot of such a body is moved by d, to the right and up in the world; d does not turn with what carries the joint.
Hence turning works as on rigid joints, and every body that the joint carries moves by d besides. With J_ia the velocity
of the centre of mass of body i per turning speed a, M_da = sum m_i e J_ia, M_dd = sum m_i, and the force of the bushing
on the body is load - k d - c dd/dt along each direction e. Derivation: docs/decisions/0197-joints-that-give.md.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from model.kernels import layout as L
from model.kernels import workspace as W
from model.kernels.codegen.giving import SEEN_FROM

if TYPE_CHECKING:
    from model.kernels.codegen.structure import Structure


def moved_pivot(s: Structure, i: int) -> list[str]:
    """Lines that move the pivot of body ``i``; and the point about which its carrier turns it."""
    out = [f"{'xy'[s.axis[g]]}{i} += q{g}" for g in s.pins_of(i)]
    if i in s.pinned:
        out += [f"x{SEEN_FROM + i} = x{i} - dx{i}", f"y{SEEN_FROM + i} = y{i} - dy{i}"]
    return out


def _carrier(s: Structure, i: int) -> int:
    """The body that turns body ``i`` by its joint, or -1."""
    w = s.parent[i]
    return w if w >= 0 and w not in s.guided else -1


def _line(s: Structure, i: int) -> list[int]:
    """Turning coordinates that move the centre of mass of ``i``."""
    return [i, *(w for w in [_carrier(s, i)] if w >= 0)]


def _arm(s: Structure, i: int, about: int, part: str) -> str:
    """Component of the arm of body ``i`` that turns with ``about``."""
    return f"r{part}{i}" if i == about else f"(d{part}{i} + r{part}{i})"


def _mass(s: Structure, i: int) -> str:
    return s.body(i, L.MASS)


def giving_mass(s: Structure) -> list[str]:
    """Entries of the mass matrix of the directions in which joints give: diagonal md, with turning bodies pm."""
    out = []
    for g in s.pin:
        terms: dict[int, list[str]] = {}
        for i in s.carried_by(g):
            for a in _line(s, i):
                part = _arm(s, i, a, "xy"[1 - s.axis[g]])
                terms.setdefault(a, []).append(f"{_mass(s, i)} * {part}")
        out.append(f"md{g} = " + " + ".join(_mass(s, i) for i in s.carried_by(g)))
        sign = "-" if s.axis[g] == 0 else ""
        out += [f"pm{g}_{a} = {sign}({' + '.join(text)})" for a, text in terms.items()]
    return out


def _with_turning(s: Structure, g: int) -> list[int]:
    return list(dict.fromkeys(a for i in s.carried_by(g) for a in _line(s, i)))


def _together(s: Structure) -> list[tuple[int, int, str]]:
    """Pairs of directions, later and earlier, that move the same bodies the same way; the mass of those."""
    out = []
    for g in s.pin:
        for e in s.pin:
            both = [i for i in s.carried_by(g) if i in s.carried_by(e)]
            if e < g and both and s.axis[e] == s.axis[g]:
                out.append((g, e, " + ".join(_mass(s, i) for i in both)))
    return out


def stored_mass(s: Structure, at: int) -> list[str]:
    """Lines that write the lower triangle of the mass matrix of all coordinates to ``at``."""

    def entry(i: int, j: int, text: str) -> str:
        return f"w[{at + W.WIDE * max(i, j) + min(i, j)}] = {text}"

    out = [entry(i, i, f"md{i}") for i in range(s.free)]
    out += [entry(i, w, f"mu{i}") for i, w in enumerate(s.parent) if w >= 0]
    out += [entry(g, a, f"pm{g}_{a}") for g in s.pin for a in _with_turning(s, g)]
    return out + [entry(g, e, text) for g, e, text in _together(s)]


def giving_forces(s: Structure) -> list[str]:
    """Generalised forces of the bushings, of gravity and of turning on the directions in which joints give."""
    out = []
    for g in s.pin:
        k, c, load = (s.pin_number(g, n) for n in (L.PIN_K, L.PIN_C, L.PIN_LOAD))
        part = "xy"[s.axis[g]]
        text = f"f{g} = {load} - {k} * q{g} - {c} * v{g}"
        for i in s.carried_by(g):
            turns = f"w{i} * w{i} * r{part}{i}"
            if _carrier(s, i) >= 0:
                turns += f" + w{s.parent[i]} * w{s.parent[i]} * d{part}{i}"
            text += f" + {_mass(s, i)} * ({turns}{' - g' if s.axis[g] == 1 else ''})"
        out.append(text)
    return out


def _turning_accelerations(s: Structure) -> list[str]:
    """For each carried body the accelerations of the parts of its arm that turning alone gives; moving or not."""
    out = []
    for i in dict.fromkeys(i for g in s.pin for i in s.carried_by(g)):
        w = _carrier(s, i)
        alpha = f"moving * (a{i} + a{w})" if w >= 0 else f"moving * a{i}"
        out += [
            f"al{i} = {alpha}",
            f"kx{i} = -al{i} * ry{i} - w{i} * w{i} * rx{i}",
            f"ky{i} = al{i} * rx{i} - w{i} * w{i} * ry{i}",
        ]
        if w >= 0:
            out += [
                f"aw{i} = moving * a{w}",
                f"lx{i}_d = -aw{i} * dy{i} - w{w} * w{w} * dx{i}",
                f"ly{i}_d = aw{i} * dx{i} - w{w} * w{w} * dy{i}",
            ]
    return out


def giving_derivatives(s: Structure) -> list[str]:
    """What they add to K, D and df/du, once the accelerations are known."""
    out = _turning_accelerations(s) if s.pin else []
    for g in s.pin:
        out += [
            f"{s.stiffness(g, g)} -= {s.pin_number(g, L.PIN_K)}",
            f"{s.damping(g, g)} -= {s.pin_number(g, L.PIN_C)}",
        ]
        part, other = ("x", "y") if s.axis[g] == 0 else ("y", "x")
        sign = "+" if s.axis[g] == 0 else "-"
        for i in s.carried_by(g):
            m = _mass(s, i)
            for b in _line(s, i):
                turned, braked = f"k{other}{i}", f"w{i} * r{part}{i}"
                if b != i:
                    turned, braked = f"({turned} + l{other}{i}_d)", f"({braked} + w{b} * d{part}{i})"
                out.append(f"{s.stiffness(g, b)} {sign}= {m} * {turned}")
                out.append(f"{s.damping(g, b)} += 2.0 * {m} * {braked}")
                for a in _line(s, i):
                    arm = _arm(s, i, i if i in (a, b) else a, part)
                    out.append(f"{s.stiffness(a, b)} += moving * {m} * {arm} * a{g}")
    return out


def giving_energy(s: Structure) -> list[str]:
    """Lines that add the kinetic energy of the directions and what their bushings store; what these lose."""
    out = ["pin_loss = 0.0"]
    for g in s.pin:
        k, c, load = (s.pin_number(g, n) for n in (L.PIN_K, L.PIN_C, L.PIN_LOAD))
        out.append(f"energy += 0.5 * md{g} * v{g} * v{g} + (0.5 * {k} * q{g} - {load}) * q{g}")
        out += [f"energy += pm{g}_{a} * v{g} * v{a}" for a in _with_turning(s, g)]
        out.append(f"pin_loss += {c} * v{g} * v{g}")
    return out + [f"energy += ({text}) * v{g} * v{e}" for g, e, text in _together(s)]
