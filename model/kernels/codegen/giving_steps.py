"""Source lines of a step where joints give: the directions in which they do are states behind those of felt.

The step loop knows no more of them than of what felt remembers: d, then dd/dt, at `model.kernels.workspace.Z`. The
linear system of a step holds all coordinates (`model.kernels.wide_system`). See ``step_kernels``.
"""

from __future__ import annotations

from model.kernels import workspace as W
from model.kernels.codegen.giving import GIVES, TURNS_BOTH
from model.kernels.codegen.structure import Structure

WIDE_NAMES = """from model.kernels.wide_system import (
    accelerated, allowed, assembled, cleared, factored, known, solved,
)
"""
FARTHEST_M = 0.02  # a joint gives no farther than this; its body's other turns reach as much farther
WORTH_OF_WAY = 10.0  # 1/s: an error of d weighs against one of a speed as that of an angle does


def _places(s: Structure, row: int) -> list[tuple[int, int, int]]:
    """Directions with the places of d and dd/dt in a row of memories."""
    first, count = row + len(s.memory), len(s.pin)
    return [(g, first + k, first + count + k) for k, g in enumerate(s.pin)]


def pins_read(s: Structure, stage: bool = False) -> list[str]:
    """Lines that read the state at the start of a step; of a stage, that begin its sums."""
    out = [f"q{g} = w[{q}]\nv{g} = w[{v}]" for g, q, v in _places(s, W.Z)]
    if stage:
        return [*out, *(f"sq{g} = 0.0\nsv{g} = 0.0\nb{g} = 0.0\nl{g} = 0.0" for g in s.pin)]
    return [*out, f"cleared(w, {s.free})"]


def pins_audited(s: Structure) -> list[str]:
    """Lines that read the state for which energies are asked."""
    return [f"q{g} = w[{q}]\nv{g} = w[{v}]" for g, q, v in _places(s, W.AUDIT_Z)]


def pins_linearised(s: Structure) -> list[str]:
    """Lines that keep what ``prepare`` and ``stage`` need, once the accelerations are known."""
    if not s.pin:
        return []
    out = [f"w[{W.P_ACC + i}] = a{i}\nw[{W.P_INPUT + i}] = u{i}" for i in range(s.free)]
    for _, q, v in _places(s, W.Z_WEIGHT):
        out += [f"w[{q}] = {WORTH_OF_WAY}", f"w[{v}] = 1.0"]
    return out


def wide_matrix(s: Structure, more: list[str]) -> list[str]:
    """Lines of ``prepare``; ``more`` lines change the matrix before it is factored."""
    out = [f"allowed(w, {g}, w[{v}], w[{W.P_ACC + g}], gh)" for g, _, v in _places(s, W.Z)]
    return [*out, f"assembled(w, inverse, gh, {s.free})", *more, f"return factored(w, {s.free})"]


def pins_allowed(s: Structure, c: int, reaches: int) -> list[str]:
    """Texts of the most that each coordinate of a chain can change the gap of its contact within a step."""
    out = []
    farther = f"{2.0 * FARTHEST_M} + " if s.pin else ""
    for e in s.chain_terms(c):
        if e.reach == GIVES:
            out.append(f"w[{W.P_ALLOWANCE + e.coordinate}]")
            continue
        reach = f"{2.0 * FARTHEST_M}" if e.reach == TURNS_BOTH else f"{farther}p[{reaches + e.reach}]"
        out.append(
            f"({reach}) * w[{W.ALLOWANCE + e.coordinate}]" if s.pin else f"{reach} * w[{W.ALLOWANCE + e.coordinate}]"
        )
    return out


def pins_summed(s: Structure) -> list[str]:
    """Lines within the loop over the stages so far."""
    out = []
    for g, q, v in _places(s, W.Z_U):
        out += [f"    x = w[{q} + {W.MOST_MEMORIES} * j]", f"    sq{g} += aj * x", f"    b{g} += cj * x"]
        out += [f"    x = w[{v} + {W.MOST_MEMORIES} * j]", f"    sv{g} += aj * x", f"    l{g} += cj * x"]
    return out


def wide_known_sides(s: Structure) -> list[str]:
    """Lines that set the known side g of the speeds of a stage."""
    n = range(s.free)
    out = [f"w[{W.P_FORCE + i}] = a{i}\nw[{W.P_WAY + i}] = b{i}" for i in n] + [f"known(w, gh, ft, {s.free})"]
    return out + [f"g{i} = w[{W.P_KNOWN + i}]" for i in n]


def wide_solved(s: Structure) -> list[str]:
    """Lines that solve for the speeds g."""
    n = range(s.free)
    out = [*(f"w[{W.P_KNOWN + i}] = g{i}" for i in n), f"solved(w, {s.free})"]
    return out + [f"g{i} = w[{W.P_KNOWN + i}]" for i in n]


def pins_staged(s: Structure) -> list[str]:
    """Lines that write the stage."""
    out = [f"o = {W.U} + {2 * W.WIDTH} * k"]
    for i in range(s.own):
        out += [f"w[o + {i}] = gh * (b{i} + g{i})", f"w[o + {W.WIDTH + i}] = g{i}"]
    for g, q, v in _places(s, W.Z_U):
        out += [f"w[{q} + {W.MOST_MEMORIES} * k] = gh * (b{g} + g{g})", f"w[{v} + {W.MOST_MEMORIES} * k] = g{g}"]
    return out
