"""Source lines of one-sided vertical contacts between points of two bodies: the motor's tip on the key.

See ``step_kernels``; as ``contacts`` for surfaces.
"""

from __future__ import annotations

from model.kernels import layout as L
from model.kernels.codegen.contacts import along_body, indent
from model.kernels.codegen.structure import Structure


def _probe_force(s: Structure, k: int) -> list[str]:
    """Lines that set the force ``fn`` of a probe, its two derivatives, and arms and heights of its points."""
    a, b = s.probe[k]
    o = s.offset[3] + L.PROBE_SIZE * k
    numbers = [f"p[{o + i}]" for i in range(L.PROBE_SIZE)]
    ax, ay = along_body(a, *numbers[0:2])
    bx, by = along_body(b, *numbers[2:4])
    out = [f"la = {ax}", f"ha = {ay}", f"lb = {bx}", f"hb = {by}"]
    out.append(f"fn, fnx, fnr = felt(y{b} + hb - y{a} - ha, {_closing(s, k)}, {', '.join(numbers[4:8])})")
    return out


def probe(s: Structure, k: int, derivatives: bool) -> list[str]:
    """One-sided vertical contact of a tip on A with a point of B, both hanging from ground or B from a guide."""
    a, b = s.probe[k]
    guide = s.vertical(b)
    out = [*_probe_force(s, k), f"f{a} += fn * la", f"f{b} -= fn * lb"]
    if derivatives:
        out += [
            f"fqa = -fnx * la + fnr * ha * v{a}", f"fqb = fnx * lb - fnr * hb * v{b}",
            f"{s.stiffness(a, a)} += fqa * la - fn * ha", f"{s.stiffness(a, b)} += fqb * la",
            f"{s.stiffness(b, a)} -= fqa * lb", f"{s.stiffness(b, b)} += -fqb * lb + fn * hb",
            f"{s.damping(a, a)} -= fnr * la * la", f"{s.damping(a, b)} += fnr * lb * la",
            f"{s.damping(b, a)} += fnr * la * lb", f"{s.damping(b, b)} -= fnr * lb * lb",
        ]  # fmt: skip
    if guide >= 0:
        out.append(f"f{guide} -= fn")
    if guide >= 0 and derivatives:
        out += [
            f"{s.stiffness(a, guide)} += fnx * la",
            f"{s.stiffness(b, guide)} -= fnx * lb",
            f"{s.stiffness(guide, guide)} -= fnx",
            f"{s.stiffness(guide, a)} += fnx * la - fnr * ha * v{a}",
            f"{s.stiffness(guide, b)} -= fnx * lb - fnr * hb * v{b}",
            f"{s.damping(a, guide)} += fnr * la",
            f"{s.damping(b, guide)} -= fnr * lb",
            f"{s.damping(guide, guide)} -= fnr",
            f"{s.damping(guide, a)} += fnr * la",
            f"{s.damping(guide, b)} -= fnr * lb",
        ]
    return out


def _closing(s: Structure, k: int) -> str:
    """Rate of penetration of a probe."""
    a, b = s.probe[k]
    return f"lb * v{b} - la * v{a}" + (f" + v{s.vertical(b)}" if s.vertical(b) >= 0 else "")


def probe_energy(s: Structure, k: int) -> list[str]:
    """Elastic energy and losses of a probe."""
    a, b = s.probe[k]
    o = s.offset[3] + L.PROBE_SIZE * k
    touch = [
        f"stored, lost = felt_energy(x, {_closing(s, k)}, fn, p[{o + 4}], p[{o + 5}], p[{o + 6}])",
        "energy += stored", "felt_loss += lost",
    ]  # fmt: skip
    return [*_probe_force(s, k), f"x = y{b} + hb - y{a} - ha", "if x > 0.0:", *indent(touch)]
