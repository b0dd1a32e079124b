"""Source lines of a contact for members side by side in lanes, where they differ from ``contacts``.

Both sides of a branch are computed where any lane needs them, and each lane keeps its own: ``on`` where it touches,
``pushes`` where its felt presses. All that differs is in which order texts of ``contacts`` stand and how they join.
"""

from __future__ import annotations

from model.kernels import layout as L
from model.kernels import workspace as W
from model.kernels.codegen.contacts import (
    arms_and_rates,
    centres,
    contact_numbers,
    derivatives,
    easiest,
    indent,
    law_numbers,
    push,
    surface,
)
from model.kernels.codegen.structure import LoneContact


def linearised_in_lanes(s: LoneContact, c: int) -> list[str]:
    """As ``contacts.contact_linearised``."""
    chain = s.chain[c]
    start = [f"{name}{k}_{c} = filled(0.0, x)" for name in ("turns", "slides") for k in range(len(chain))]
    start += [f"{name} = filled(0.0, x)" for name in ("gap", "gap_rate")]
    touch = [*arms_and_rates(s, c), f"fn, fnx, fnr, mu, mus = contact_laws(x, rate, slide, {law_numbers(s, c)})"]
    touch += ["fx = fn * nx + mu * fn * ny", "fy = fn * ny - mu * fn * nx", *push(s, c)]
    touch += [f"turns{k}_{c} = where(on, gn{k}, 0.0)" for k in range(len(chain))]
    touch += [f"slides{k}_{c} = where(on, gt{k}, 0.0)" for k in range(len(chain))]
    touch += ["gap = -x", "gap_rate = -rate", f"w[{s.at(c, W.SLIDE)}] = slide"]
    touch.append(f"w[{s.at(c, W.GRIP)}] = {contact_numbers(s, c, L.MU_A)[0]} * fn * {easiest(s, c, 'gt')}")
    touch += ["pushes = on & (fn > 0.0)", "if any_of(pushes):", *indent(derivatives(s, c))]
    away = surface(s, c, True)
    for k, (b, side) in enumerate(chain):
        x, y = s.pivot(c, k)
        way = "ny" if b in s.guided else f"((ax - {x}) * ny - (ay - {y}) * nx)"
        away += [f"way{k} = {'' if side > 0 else '-'}{way}", f"turns{k}_{c} = where(on, turns{k}_{c}, way{k})"]
    rate = " + ".join(f"way{k} * v{b}" for k, (b, _) in enumerate(chain))
    away += ["gap = where(on, gap, room)", f"gap_rate = where(on, gap_rate, {rate})"]
    stiffness, damping = contact_numbers(s, c, L.K_C, L.DAMP)
    return [
        *centres(s, c), *surface(s, c, False), *start,
        "on = x > 0.0", "if any_of(on):", *indent(touch), "if any_of(~on):", *indent(away),
        f"w[{s.at(c, W.ROOM)}] = where(on, 0.0, gap)",
        f"w[{s.at(c, W.GAP)}] = gap", f"w[{s.at(c, W.GAP_RATE)}] = gap_rate",
        f"w[{s.at(c, W.KICK)}] = {stiffness} * (1.0 + {damping} * abs(gap_rate)) * " + easiest(s, c, "turns", f"_{c}"),
    ]  # fmt: skip


def second_rates_in_lanes(s: LoneContact, c: int) -> list[str]:
    """As ``contacts.second_rates``."""
    turn, slide = (" + ".join(f"{n}{k}_{c} * a{b}" for k, (b, _) in enumerate(s.chain[c])) for n in ("turns", "slides"))
    rubs = f"{contact_numbers(s, c, L.MU_A)[0]} != 0.0"
    return [f"w[{s.at(c, W.GAP_ACC)}] = {turn}", f"w[{s.at(c, W.SLIDE_RATE)}] = where({rubs}, {slide}, 0.0)"]
