"""Source lines of contacts and probes: force, derivatives, room of an open gap. See ``step_kernels``.

A contact between A and B acts on the coordinates of its chain; (b, side) says that coordinate b moves A (+1) or B (-1).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from model.kernels import layout as L
from model.kernels import workspace as W
from model.kernels.codegen.structure import LoneContact, Structure


def _at(body: int, x: str, y: str) -> tuple[str, str]:
    """World coordinates of a point of a body's frame."""
    if body < 0:
        return x, y
    i = body
    return f"x{i} + c{i} * {x} - s{i} * {y}", f"y{i} + s{i} * {x} + c{i} * {y}"


def along_body(body: int, x: str, y: str) -> tuple[str, str]:
    """World components of a vector of a body's frame."""
    return (x, y) if body < 0 else (f"c{body} * {x} - s{body} * {y}", f"s{body} * {x} + c{body} * {y}")


def contact_numbers(s: Structure | LoneContact, c: int, *names: int) -> list[str]:
    """Texts of some numbers of contact ``c``."""
    return [s.contact_number(c, k) for k in names]


def centres(s: Structure | LoneContact, c: int) -> list[str]:
    """Lines that set the centres of both surfaces."""
    a, b, _, _ = s.contact[c]
    ax, ay = _at(a, *contact_numbers(s, c, L.A_X, L.A_Y))
    bx, by = _at(b, *contact_numbers(s, c, L.B_X, L.B_Y))
    return [f"ax = {ax}", f"ay = {ay}", f"bx = {bx}", f"by = {by}"]


def surface(s: Structure | LoneContact, c: int, room: bool) -> list[str]:
    """Lines that set x, nx, ny, distance (or room, nx, ny) from the centres."""
    _, b, shape, _ = s.contact[c]
    ra, rb = contact_numbers(s, c, L.A_R, L.B_R)
    nx, ny = along_body(b, *contact_numbers(s, c, L.N_X, L.N_Y))
    if shape == L.LINE:
        out = [f"nx = {nx}", f"ny = {ny}"]
        if room:
            return [*out, f"room = max(0.0, (ax - bx) * nx + (ay - by) * ny - {ra})"]
        flat = "filled(0.0, x)" if s.lanes > 1 else "0.0"
        return [*out, f"x = {ra} - ((ax - bx) * nx + (ay - by) * ny)", f"distance = {flat}"]
    ends = ""
    out = []
    if shape == L.HYBRID:
        ex, ey = along_body(b, *contact_numbers(s, c, L.E_X, L.E_Y))
        out = [f"sx = {nx}", f"sy = {ny}", f"ex = {ex}", f"ey = {ey}"]
        ends = ", sx, sy, ex, ey"
    kind = "hybrid" if shape == L.HYBRID else "circle"
    if room:
        return [*out, f"room, nx, ny = {kind}_room(ax - bx, ay - by, {ra} + {rb}{ends})"]
    return [*out, f"x, nx, ny, distance = {kind}_gap(ax - bx, ay - by, {ra} + {rb}{ends})"]


def arms_and_rates(s: Structure | LoneContact, c: int) -> list[str]:
    """Arms, generalised directions, rate of penetration, sliding speed, at mid-penetration."""
    out = [f"r = {contact_numbers(s, c, L.A_R)[0]} - 0.5 * x", "px = ax - r * nx", "py = ay - r * ny"]
    for k, (b, side) in enumerate(s.chain[c]):
        sign = "" if side > 0 else "-"
        if b in s.guided:
            out += guided_ways(s, b, k, side)
            continue
        x, y = s.pivot(c, k)
        out += [f"lx{k} = px - {x}", f"ly{k} = py - {y}"]
        out += [f"gn{k} = {sign}(lx{k} * ny - ly{k} * nx)", f"gt{k} = {sign}(lx{k} * nx + ly{k} * ny)"]
    out.append("rate = -(" + " + ".join(f"gn{k} * v{b}" for k, (b, _) in enumerate(s.chain[c])) + ")")
    out.append("slide = " + " + ".join(f"gt{k} * v{b}" for k, (b, _) in enumerate(s.chain[c])))
    return out


def guided_ways(s: Structure | LoneContact, b: int, k: int, side: int) -> list[str]:
    """Generalised directions of the guide ``b``, number ``k`` of a chain."""
    sign = "" if side > 0 else "-"
    if s.axis[b] == 1:
        return [f"gn{k} = {sign}ny", f"gt{k} = {sign}nx"]
    return [f"gn{k} = {sign}nx", f"gt{k} = {'-' if side > 0 else ''}ny"]


def law_numbers(s: Structure | LoneContact, c: int) -> str:
    """Arguments of a contact's laws after its depth and speeds; ``per_v`` is one over the threshold of sliding."""
    felt = contact_numbers(s, c, L.K_A, L.K_B, L.K_C, L.DAMP)
    return ", ".join([*felt, "per_v", *contact_numbers(s, c, L.MU_A, L.MU_B1, L.MU_B2)])


def push(s: LoneContact, c: int) -> list[str]:
    """Lines that add the force (fx, fy) to the generalised forces."""
    out = []
    for k, (b, side) in enumerate(s.chain[c]):
        if not s.solved(b):
            continue
        moment = ("fx", "fy")[s.axis[b]] if b in s.guided else f"lx{k} * fy - ly{k} * fx"
        if s.lanes > 1:
            out.append(f"f{b} += " + chosen(s, "on", moment if side > 0 else f"-({moment})"))
            continue
        out.append(f"f{b} {'+' if side > 0 else '-'}= {moment}")
    return out


def chosen(s: LoneContact, mask: str, text: str) -> str:
    """Text of what is added where ``mask`` holds: in lanes a choice, whose other side changes no bit of a sum."""
    return f"where({mask}, {text}, -0.0)" if s.lanes > 1 else text


def indent(lines: list[str]) -> list[str]:
    """The lines as the block of a branch."""
    return ["    " + line for line in lines]


def contact_forces(s: LoneContact, c: int) -> list[str]:
    """Add the force of contact ``c`` to f where it touches."""
    touch = [*arms_and_rates(s, c), f"fx, fy = contact_force(x, rate, slide, nx, ny, {law_numbers(s, c)})", *push(s, c)]
    where_closed = ["on = x > 0.0", "if any_of(on):"] if s.lanes > 1 else ["if x > 0.0:"]
    return [*centres(s, c), *surface(s, c, False), *where_closed, *indent(touch)]


class FeltLines(NamedTuple):
    """Lines of a felt law: its force and slopes, derivatives where it presses, what happens where it is left alone.

    ``start`` are lines once the depth is known, before it decides.
    ``stiffness`` is the text of the force per depth that a first touch brings at once.
    """

    law: list[str]
    derivatives: list[str]
    away: list[str]
    stiffness: str
    start: list[str]


def _without_memory(s: LoneContact, c: int) -> FeltLines:
    law = [f"fn, fnx, fnr, mu, mus = contact_laws(x, rate, slide, {law_numbers(s, c)})"]
    stiffness, damping = contact_numbers(s, c, L.K_C, L.DAMP)
    return FeltLines(law, derivatives(s, c), [], f"{stiffness} * (1.0 + {damping} * abs(w[{s.at(c, W.GAP_RATE)}]))", [])


def contact_linearised(s: LoneContact, c: int, felt: FeltLines | None = None) -> list[str]:
    """Force and derivatives of contact ``c`` where it touches; its gap and how fast that changes in any case."""
    chain = s.chain[c]
    felt = _without_memory(s, c) if felt is None else felt
    law = [*felt.law]
    law += ["fx = fn * nx + mu * fn * ny", "fy = fn * ny - mu * fn * nx", *push(s, c), "touching += 1"]
    law += [f"turns{k}_{c} = gn{k}" for k in range(len(chain))]
    law += [f"slides{k}_{c} = gt{k}" for k in range(len(chain))]
    law += [f"w[{s.at(c, W.ROOM)}] = 0.0", f"w[{s.at(c, W.GAP)}] = -x", f"w[{s.at(c, W.GAP_RATE)}] = -rate"]
    law += [
        f"w[{s.at(c, W.SLIDE)}] = slide",
        f"w[{s.at(c, W.GRIP)}] = {contact_numbers(s, c, L.MU_A)[0]} * fn * {easiest(s, c, 'gt')}",
    ]
    away = surface(s, c, True)
    for k, (b, side) in enumerate(chain):
        x, y = s.pivot(c, k)
        way = ("nx", "ny")[s.axis[b]] if b in s.guided else f"((ax - {x}) * ny - (ay - {y}) * nx)"
        away.append(f"turns{k}_{c} = {'' if side > 0 else '-'}{way}")
    rate = " + ".join(f"turns{k}_{c} * v{b}" for k, (b, _) in enumerate(chain))
    away += [f"w[{s.at(c, W.ROOM)}] = room", f"w[{s.at(c, W.GAP)}] = room", f"w[{s.at(c, W.GAP_RATE)}] = {rate}"]
    return [
        *(f"slides{k}_{c} = 0.0" for k in range(len(chain))), *centres(s, c), *surface(s, c, False), *felt.start,
        "if x > 0.0:", *indent([*arms_and_rates(s, c), *law, "if fn > 0.0:", *indent(felt.derivatives)]),
        "else:", *indent([*away, *felt.away]),
        f"w[{s.at(c, W.KICK)}] = {felt.stiffness} * " + easiest(s, c, "turns", f"_{c}"),
    ]  # fmt: skip


def easiest(s: LoneContact, c: int, name: str, end: str = "") -> str:
    """Text of the largest acceleration of one joint that a unit force along a direction gives."""
    terms = [f"abs({name}{k}{end}) * easy{b}" for k, (b, _) in enumerate(s.chain[c]) if s.solved(b)]
    out = terms[0]
    for term in terms[1:]:
        out = f"max({out}, {term})"
    return out


def second_rates(s: LoneContact, c: int) -> list[str]:
    """How fast gap rate and sliding speed of contact ``c`` change, once the accelerations are known."""
    chain = s.chain[c]
    turn, slide = (" + ".join(f"{n}{k}_{c} * a{b}" for k, (b, _) in enumerate(chain)) for n in ("turns", "slides"))
    rubs = f"{contact_numbers(s, c, L.MU_A)[0]} != 0.0"
    return [
        f"w[{s.at(c, W.GAP_ACC)}] = {turn}",
        f"w[{s.at(c, W.SLIDE_RATE)}] = 0.0", f"if {rubs}:", f"    w[{s.at(c, W.SLIDE_RATE)}] = {slide}",
    ]  # fmt: skip


def derivatives(s: LoneContact, c: int, more: Callable[[int, str], list[str]] | None = None) -> list[str]:
    """Add the derivatives of a pushing contact to K and D.

    ``more`` gives further lines for a joint of the chain, from its place and the change of the closing speed.
    """
    chain = s.chain[c]
    out = [f"along{k} = gn{k} - mu * gt{k}" for k in range(len(chain))]
    for j, (cj, side) in enumerate(chain):
        qx, qy = s.pivot(c, j)
        what, centre = ("first", "a") if side > 0 else ("second", "b")
        if cj in s.guided:
            moved = ("slide", "lift")[s.axis[cj]]
            out.append(f"kappa, xx, xy = {moved}_of_{what}(nx, ny, distance, r, -gn{j})")
        else:
            out.append(f"kappa, xx, xy = turn_of_{what}({centre}x, {centre}y, {qx}, {qy}, nx, ny, distance, r, -gn{j})")
        for k, (b, sk) in enumerate(chain):
            if b in s.guided:
                dn, dt = (f"{float(-sk)} * kappa * ny", f"{float(-sk)} * kappa * nx")
                if s.axis[b] == 1:
                    dn, dt = (f"{float(sk)} * kappa * nx", f"{float(-sk)} * kappa * ny")
                out += [f"dn{k} = {dn}", f"dt{k} = {dt}"]
                continue
            bx, by = s.pivot(c, k)
            mx, my = (f"xx + ({by} - {qy})", f"xy - ({bx} - {qx})") if s.carries(c, j, k) else ("xx", "xy")
            if s.carries(c, j, k) and cj in s.guided:
                mx, my = ("xx - 1.0", "xy") if s.axis[cj] == 0 else ("xx", "xy - 1.0")
            out.append(f"dn{k}, dt{k} = turn_of_arm({float(sk)}, {mx}, {my}, nx, ny, kappa, lx{k}, ly{k})")
        rate = " + ".join(f"dn{k} * v{b}" for k, (b, _) in enumerate(chain))
        slide = " + ".join(f"dt{k} * v{b}" for k, (b, _) in enumerate(chain))
        out += [f"fnj = -fnx * gn{j} - fnr * ({rate})", f"fmu = fn * mus * ({slide})"]
        out += [f"fnv = -fnr * gn{j}", f"fmv = fn * mus * gt{j}"]
        out += [] if more is None else more(j, rate)
        for k, (b, _) in enumerate(chain):
            if not s.solved(b):
                continue
            terms = f"fnj * along{k} + fn * (dn{k} - mu * dt{k}) - fmu * gt{k}", f"fnv * along{k} - fmv * gt{k}"
            out.append(f"{s.stiffness(b, cj)} += {chosen(s, 'pushes', terms[0])}")
            out.append(f"{s.damping(b, cj)} += {chosen(s, 'pushes', terms[1])}")
    return out


def contact_energy(s: Structure, c: int) -> list[str]:
    """Elastic energy and losses of contact ``c``."""
    stiffness = ", ".join(contact_numbers(s, c, L.K_A, L.K_B, L.K_C))
    touch = [
        *arms_and_rates(s, c), f"fn, _, _, mu, _ = contact_laws(x, rate, slide, {law_numbers(s, c)})",
        f"stored, lost = felt_energy(x, rate, fn, {stiffness})", "energy += stored",
        "rail_loss += lost" if c in s.rail else "felt_loss += lost",
        "friction_loss += mu * fn * slide",
    ]  # fmt: skip
    return [*centres(s, c), *surface(s, c, False), "if x > 0.0:", *indent(touch)]
