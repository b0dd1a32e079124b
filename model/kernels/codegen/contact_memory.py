"""Source lines of contacts whose felt remembers: force, rate of each memory, derivatives, energy.

As ``contacts`` for the laws of `model.kernels.memory_laws`. A memory z of a contact acts on the joints of its chain and
on nothing else, so that each stage eliminates it: with e = 1 / (1/(gamma h) - dZ/dz) it gives
U_z = e (r_z + Z_q U_q + Z_v U_v), and the matrix of the speeds loses F_z e (gamma h Z_q + Z_v), of rank one.
"""

from __future__ import annotations

from model.kernels import layout as L
from model.kernels import workspace as W
from model.kernels.codegen.contacts import (
    FeltLines,
    arms_and_rates,
    centres,
    contact_linearised,
    contact_numbers,
    derivatives,
    easiest,
    indent,
    push,
    surface,
)
from model.kernels.codegen.structure import LoneContact, Structure


def _curve(s: Structure | LoneContact, c: int) -> str:
    return ", ".join(contact_numbers(s, c, L.K_A, L.K_B, L.K_C))


def _friction(s: Structure | LoneContact, c: int) -> str:
    return "slide, per_v, " + ", ".join(contact_numbers(s, c, L.MU_A, L.MU_B1, L.MU_B2))


def memory_numbers(laws: list[int]) -> list[str]:
    """Lines that read the two numbers of each memory."""
    out = []
    for m in range(len(laws)):
        o = f"om + {L.MEMORY_SIZE * m}"
        out += [f"share{m} = p[{o} + {L.SHARE}]", f"reach{m} = p[{o} + {L.REACH_OR_TIME}]"]
    return out


def _open(laws: list[int]) -> list[str]:
    """Rates of the memories where nothing presses."""
    return [
        f"fade{m} = " + (f"stulov_open(mem{m}, share{m}, reach{m})" if law == L.STULOV else "0.0")
        for m, law in enumerate(laws)
    ]


def _factor(laws: list[int]) -> list[str]:
    """Share of the loading curve's force that hysteresis leaves."""
    every = " + ".join(["1.0", *(f"share{m}" for m in range(len(laws)))])
    here = " + ".join(["1.0", *(f"share{m} * mem{m}" for m in range(len(laws)))])
    return [f"whole = 1.0 / ({every})", f"factor = ({here}) * whole"]


def memory_forces(s: LoneContact, c: int) -> list[str]:
    """As ``contacts.contact_forces``; also sets the rate ``fade`` of each memory."""
    laws = s.remembers
    touch = arms_and_rates(s, c)
    if laws[0] == L.STULOV:
        touch.append(f"fn, fade0 = stulov(x, mem0, {_curve(s, c)}, share0, reach0)")
    else:
        touch += [*_factor(laws), f"fit, _ = loading_curve(x, {_curve(s, c)})", "fn = fit * factor"]
        touch += [f"fade{m} = hysteresis_rate(x, rate, mem{m}, reach{m})" for m in range(len(laws))]
    touch += [f"fx, fy = rubbing_force(fn, {_rubs(s, c)})", *push(s, c)]
    return [*memory_numbers(laws), *_open(laws), *centres(s, c), *surface(s, c, False), "if x > 0.0:", *indent(touch)]


def _rubs(s: LoneContact, c: int) -> str:
    return "slide, nx, ny, per_v, " + ", ".join(contact_numbers(s, c, L.MU_A, L.MU_B1, L.MU_B2))


def memory_linearised(s: LoneContact, c: int) -> list[str]:
    """As ``contacts.contact_linearised``; also what the memories are coupled by. ``z0`` is the first's number."""
    laws = s.remembers
    law = []
    if laws[0] == L.STULOV:
        given = f"x, mem0, {_curve(s, c)}, share0, reach0"
        law += [f"fn, fnx, fz0, fade0, fade_x0, fade_z0 = stulov_slopes({given})", "fade_r0 = 0.0"]
    else:
        law += [*_factor(laws), f"fit, fit_x = loading_curve(x, {_curve(s, c)})"]
        law += ["fn = fit * factor", "fnx = fit_x * factor"]
        for m in range(len(laws)):
            law.append(f"fz{m} = fit * share{m} * whole")
            names = ", ".join(f"{name}{m}" for name in ("fade", "fade_x", "fade_r", "fade_z"))
            law.append(f"{names} = hysteresis_slopes(x, rate, mem{m}, reach{m})")
    law += ["fnr = 0.0", f"mu, mus = rubbing(fn, {_friction(s, c)})"]
    for m in range(len(laws)):
        law += [f"w[{W.Z_RATE} + z0 + {m}] = fade{m}", f"w[{W.Z_FADE} + z0 + {m}] = fade_z{m}"]
    stiffness = contact_numbers(s, c, L.K_C)[0] + (" / (1.0 - share0)" if laws[0] == L.STULOV else "")
    # hysteresis starts anew at the next touch
    away = [f"w[{W.Z} + z0 + {m}] = 1.0" for m, law_of in enumerate(laws) if law_of == L.HYSTERESIS]
    lines = contact_linearised(s, c, FeltLines(law, _coupled(s, c), away, stiffness, []))
    return [*memory_numbers(laws), *_forgotten(s, c), *lines, *(_left(s, c) if laws[0] == L.STULOV else [])]


def _left(s: LoneContact, c: int) -> list[str]:
    """Line that weighs the memory of felt that is left alone: as if it were met again at once."""
    worth = f"remembered_error(share0 / (1.0 - share0) * {easiest(s, c, 'turns', f'_{c}')}, -(1.0 - share0) / reach0)"
    return [f"if w[{W.Z_WEIGHT} + z0] == 0.0:", f"    w[{W.Z_WEIGHT} + z0] = {worth}"]


def _forgotten(s: LoneContact, c: int) -> list[str]:
    """Lines that hold until the contact is known to press."""
    out = list(_open(s.remembers))
    for m, law in enumerate(s.remembers):
        row = f"z0 + {m}"
        fade = f"-(1.0 - share{m}) / reach{m}" if law == L.STULOV else "0.0"
        out += [f"w[{W.Z_RATE} + {row}] = fade{m}", f"w[{W.Z_FADE} + {row}] = {fade}", f"w[{W.Z_WEIGHT} + {row}] = 0.0"]
        for start in (W.Z_PUSH, W.Z_TURN, W.Z_SPEED):
            out += [f"w[{start} + {W.LINKS} * ({row}) + {k}] = 0.0" for k in range(len(s.chain[c]))]
    return out


def _coupled(s: LoneContact, c: int) -> list[str]:
    """Lines for a contact that presses: its derivatives, and what couples its memories to each joint."""
    out = [*derivatives(s, c, lambda j, rate: _of_joint(s, j, rate))]
    for m in range(len(s.remembers)):
        out.append("push = 0.0")
        for k, (b, _) in enumerate(s.chain[c]):
            if s.solved(b):
                out += [f"w[{W.Z_PUSH} + {W.LINKS} * (z0 + {m}) + {k}] = along{k} * fz{m}"]
                out += [f"push = max(push, abs(along{k} * fz{m}) * easy{b})"]
        out.append(f"w[{W.Z_WEIGHT} + z0 + {m}] = remembered_error(push, fade_z{m})")
    return out


def _of_joint(s: LoneContact, j: int, rate: str) -> list[str]:
    """How the angle and the speed of the chain's joint ``j`` change the rates of the memories."""
    out = []
    for m, law in enumerate(s.remembers):
        at = f"{W.LINKS} * (z0 + {m}) + {j}"
        by_rate = "" if law == L.STULOV else f" - fade_r{m} * ({rate})"
        out.append(f"w[{W.Z_TURN} + {at}] = -fade_x{m} * gn{j}{by_rate}")
        out.append(f"w[{W.Z_SPEED} + {at}] = " + ("0.0" if law == L.STULOV else f"-fade_r{m} * gn{j}"))
    return out


def memory_energy(s: Structure, c: int) -> list[str]:
    """As ``contacts.contact_energy``; felt that is left alone still gives back or loses what it stored."""
    memories = s.memories(c)
    laws = [s.memory[m][1] for m in memories]
    start = [f"mem{k} = w[{W.AUDIT_Z + m}]" for k, m in enumerate(memories)]
    for k, m in enumerate(memories):
        start += [f"share{k} = {s.memory_number(m, L.SHARE)}", f"reach{k} = {s.memory_number(m, L.REACH_OR_TIME)}"]
    rub = [f"mu, _ = rubbing(fn, {_friction(s, c)})", "friction_loss += mu * fn * slide"]
    geometry = [*start, *centres(s, c), *surface(s, c, False)]
    if laws[0] == L.STULOV:
        given = f"{_curve(s, c)}, share0, reach0"
        press = [*arms_and_rates(s, c), f"fn, _ = stulov(x, mem0, {given})", *rub]
        felt = [f"stored, lost = stulov_energy(x, mem0, {given})", "energy += stored", "felt_loss += lost"]
        return [*geometry, *felt, "if x > 0.0:", *indent(press)]
    press = [*arms_and_rates(s, c), *_factor(laws), f"fit, _ = loading_curve(x, {_curve(s, c)})", "fn = fit * factor"]
    press += [*rub, f"energy += whole * stored_slowly(x, {_curve(s, c)})"]
    for m in range(len(laws)):
        press.append(f"stored, lost = hysteresis_energy(x, rate, mem{m}, share{m}, reach{m}, {_curve(s, c)})")
        press += ["energy += whole * stored", "felt_loss += whole * lost"]
    return [*geometry, "if x > 0.0:", *indent(press)]


def factors(s: Structure) -> list[str]:
    """Lines of ``prepare`` for all memories, once the matrix stands."""
    out = []
    for m, (c, _) in enumerate(s.memory):
        out += [f"ease = 1.0 / (inverse - w[{W.Z_FADE + m}])", f"w[{W.Z_EASE + m}] = ease"]
        for j, (cj, _) in enumerate(s.chain[c]):
            if cj >= s.free:
                continue
            at = W.LINKS * m + j
            out.append(f"back = ease * (gh * w[{W.Z_TURN + at}] + w[{W.Z_SPEED + at}])")
            for k, (b, _) in enumerate(s.chain[c]):
                if b < s.free:
                    out.append(f"{s.factor(b, cj)} -= w[{W.Z_PUSH + W.LINKS * m + k}] * back")
    return out


def of_the_input(s: Structure) -> list[str]:
    """Lines of ``linearise``: how the rates change with the input, where it moves a coordinate that is prescribed."""
    out = []
    for m, (c, _) in enumerate(s.memory):
        terms = [
            f"w[{W.Z_TURN + W.LINKS * m + j}] * v{b} + w[{W.Z_SPEED + W.LINKS * m + j}] * a{b}"
            for j, (b, _) in enumerate(s.chain[c])
            if b >= s.free
        ]
        out.append(f"w[{W.Z_INPUT + m}] = {' + '.join(terms) or '0.0'}")
    return out


def stage_sums(s: Structure) -> tuple[list[str], list[str]]:
    """Lines of ``stage`` before and within the loop over the stages so far."""
    before, within = [], []
    for m in range(len(s.memory)):
        before += [f"mem{m} = w[{W.Z + m}]\nkept{m} = 0.0"]
        within += [
            f"    x = w[{W.Z_U} + {W.MOST_MEMORIES} * j + {m}]",
            f"    mem{m} += aj * x",
            f"    kept{m} += cj * x",
        ]
    return before, within


def left_alone(s: Structure) -> list[str]:
    """Rates of memories of contacts that a stage does not evaluate."""
    out = []
    for m, (_, law) in enumerate(s.memory):
        numbers = s.memory_number(m, L.SHARE), s.memory_number(m, L.REACH_OR_TIME)
        out.append(f"fade{m} = " + (f"stulov_open(mem{m}, {', '.join(numbers)})" if law == L.STULOV else "0.0"))
    return out


def known_sides(s: Structure) -> list[str]:
    """Lines of ``stage`` once the speeds' known side g and b are set: what the memories add to it."""
    out = []
    for m, (c, _) in enumerate(s.memory):
        turned = " + ".join(
            f"w[{W.Z_TURN + W.LINKS * m + j}] * b{b}" for j, (b, _) in enumerate(s.chain[c]) if b < s.free
        )
        out.append(
            f"kept{m} = w[{W.Z_EASE + m}] * (fade{m} + kept{m} * rate + ft * w[{W.Z_INPUT + m}] + gh * ({turned}))"
        )
        for k, (b, _) in enumerate(s.chain[c]):
            if b < s.free:
                out.append(f"g{b} += w[{W.Z_PUSH + W.LINKS * m + k}] * kept{m}")
    return out


def stages_of_memories(s: Structure) -> list[str]:
    """Lines of ``stage`` once the speeds g are solved for."""
    out = [f"o = {W.Z_U} + {W.MOST_MEMORIES} * k"]
    for m, (c, _) in enumerate(s.memory):
        back = " + ".join(
            f"(gh * w[{W.Z_TURN + W.LINKS * m + j}] + w[{W.Z_SPEED + W.LINKS * m + j}]) * g{b}"
            for j, (b, _) in enumerate(s.chain[c])
            if b < s.free
        )
        out.append(f"w[o + {m}] = kept{m} + w[{W.Z_EASE + m}] * ({back})")
    return out
