"""Write the kernels of one scene as straight-line Python source, from the scene's structure alone.

In: the integer tables of a scene (which bodies, contacts, springs, drives; no parameter value). Out: source text
with four functions that the step loop calls: ``linearise`` (accelerations, K, D, df/du, open gaps at the start of a
step), ``prepare`` (factors of its linear system), ``skip`` (contacts that cannot touch within it), ``stage``.
Loops over tables become lines with constant indices; what the scene leaves out is not in the text. The physics
is in ``terms`` and ``laws``. Order of numbers: ``layout`` (parameters), ``workspace`` (step).
"""

from __future__ import annotations

from model.kernels import layout as L
from model.kernels import workspace as W
from model.kernels.codegen.bodies import derivatives, forces, mass, pose, solve_mass
from model.kernels.codegen.contact_kinds import Piece, forces_piece, linearised_piece, rates_piece
from model.kernels.codegen.contact_memory import (
    factors,
    known_sides,
    left_alone,
    of_the_input,
    stage_sums,
    stages_of_memories,
)
from model.kernels.codegen.giving_steps import (
    WIDE_NAMES,
    pins_allowed,
    pins_linearised,
    pins_read,
    pins_staged,
    pins_summed,
    wide_known_sides,
    wide_matrix,
    wide_solved,
)
from model.kernels.codegen.probes import probe
from model.kernels.codegen.string_contact import (
    NAMES,
    string_known_sides,
    string_prepared,
    string_stages,
    string_summed,
)
from model.kernels.codegen.structure import Structure

HEAD = '''"""Generated from the structure of a scene by model.kernels.codegen.step_kernels; do not edit."""

from numba import int64

from model.kernels.compile import generated
from model.kernels.lanes.bundle import bundled, number
from model.kernels.lanes.maths import cosine_sine as cosines_sines
from model.kernels.lanes.terms import friction as frictions
from model.kernels.laws import felt, friction
from model.kernels.motion import motion_at, piece_at
from model.kernels.signatures import ENERGY, LINEARISE, PREPARE, SKIP, STAGE
from model.kernels.terms import circle_gap, contact_laws, cosine_sine, felt_energy, hybrid_gap
'''
AMPLIFIER_HEAD = "from model.kernels.laws import amplifier\n"
_LANES_HEAD = '''"""Generated for lanes from the structure of a scene by step_kernels; do not edit."""

from numba import int64

from model.kernels.compile import generated_lanes
from model.kernels.lanes.maths import cosine_sine
from model.kernels.lanes.operations import any_of, bits_of, filled, rows, where
from model.kernels.lanes.terms import felt, friction
from model.kernels.signatures import LANE_LINEARISE, LANE_PREPARE, LANE_SKIP, LANE_STAGE
'''


def _prescribed(s: Structure, derivatives: bool) -> list[str]:
    """Angle, speed and acceleration of prescribed coordinates at the time ``u``; still in statics."""
    out = []
    for i in range(s.free, s.n):
        o = s.offset[4]
        out += [f"piece = piece_at(p, {o}, u, int(w[{W.PIECE}]))", f"q{i}, v{i}, a{i}, _ = motion_at(p, {o}, u, piece)"]
        if derivatives:
            out += [f"v{i} *= 1.0 - w[{W.STATIC}]", f"a{i} *= 1.0 - w[{W.STATIC}]", f"w[{W.PIECE}] = piece"]
            out += [f"w[{W.Q + i}] = q{i}", f"w[{W.V + i}] = v{i}", f"w[{W.ACC + i}] = a{i}"]
    return out


def _linearise(s: Structure, pieces: set[Piece]) -> list[str]:
    out = [f"q{i} = w[{W.Q + i}]\nv{i} = w[{W.V + i}]" for i in range(s.own)] + _prescribed(s, True)
    if s.pin:
        out += pins_read(s)
    else:
        out += [f"{s.stiffness(i, j)} = 0.0\n{s.damping(i, j)} = 0.0" for i, j in sorted(s.pattern())]
    out += ["touching = 0", *pose(s), *mass(s), *forces(s, True)]
    out += [f"easy{i} = 1.0 / md{i}" for i in range(s.free)]
    out += [f"mem{m} = w[{W.Z + m}]" for m in range(len(s.memory))]
    rates = []
    for c in s.place:
        piece, call = linearised_piece(s, c)
        later, call_later = rates_piece(s, c)
        pieces |= {piece, later}
        out += call
        rates += call_later
    for k in range(len(s.probe)):
        out += probe(s, k, True)
    out += [*solve_mass(s, W.P_MASS), *derivatives(s), *rates, *of_the_input(s), *pins_linearised(s)]
    for i in range(s.own):
        out += [f"w[{W.ACC + i}] = a{i}", f"w[{W.F_U + i}] = u{i}", f"w[{W.M_DIAG + i}] = md{i}"]
        if s.parent[i] >= 0:
            out.append(f"w[{W.M_UP + i}] = mu{i}")
    return [*out, "return touching"]


def _filled(s: Structure) -> set[tuple[int, int]]:
    """Pattern of the factors."""
    out = s.square()
    for k in range(s.free):
        for i in range(k + 1, s.free):
            for j in range(k + 1, s.free):
                if (i, k) in out and (k, j) in out:
                    out.add((i, j))
    return out


def _prepare(s: Structure) -> list[str]:
    """Factors of M / (gamma h) - D - gamma h K without exchanges; 0 where that would lose six digits."""
    out = ["inverse = 1.0 / gh"]
    if s.pin:
        return [*out, *wide_matrix(s, [*factors(s), *string_prepared(s)])]
    start, pattern = s.square(), _filled(s)
    for i, j in sorted(pattern):
        text = f"-{s.damping(i, j)} - gh * {s.stiffness(i, j)}" if (i, j) in start else "0.0"
        if i == j:
            text += f" + inverse * w[{W.M_DIAG + i}]"
        elif s.parent[i] == j or s.parent[j] == i:
            text += f" + inverse * w[{W.M_UP + (i if s.parent[i] == j else j)}]"
        out.append(f"m{i}_{j} = {text}")
    out += [*factors(s), *string_prepared(s)]
    out += [f"small{i} = 1e-6 * abs(m{i}_{i})" for i in range(s.free)]
    for k in range(s.free):
        if s.lanes == 1:
            out += [f"if not abs(m{k}_{k}) > small{k}:", "    return 0", f"r{k} = 1.0 / m{k}_{k}"]
        else:
            also = "" if k == 0 else "sound & "
            out += [f"sound = {also}(abs(m{k}_{k}) > small{k})", f"r{k} = 1.0 / m{k}_{k}"]
        for i in range(k + 1, s.free):
            if (i, k) in pattern:
                out.append(f"m{i}_{k} *= r{k}")
                out += [f"m{i}_{j} -= m{i}_{k} * m{k}_{j}" for j in range(k + 1, s.free) if (k, j) in pattern]
    for i, j in sorted(pattern):
        out.append(f"w[{W.LU + W.WIDTH * i + j}] = {f'r{i}' if i == j else f'm{i}_{j}'}")
    return [*out, "return 1" if s.lanes == 1 else "return bits_of(sound)"]


def _skip(s: Structure) -> list[str]:
    """Mask of contacts that stay open while no coordinate moves by more than its allowance."""
    out = ["mask = 0"]
    for c, at in s.place.items():
        o = s.offset[1] + L.CONTACT_SIZE * c + L.REACH
        way = " + ".join(pins_allowed(s, c, o))
        if s.lanes == 1:
            out += [f"if {way} < w[{W.ROOM + at}]:", f"    mask |= {1 << at}"]
            continue
        out += [f"near = ({way} >= w[{W.ROOM + at}]) & busy", "needed = needed + where(near, 1.0, 0.0)"]
        out += ["if not any_of(near):", f"    mask |= {1 << at}"]
    if s.lanes > 1:
        out = [f"busy = w[{W.IDLE}] == 0.0", "needed = filled(0.0, busy)", *out, f"w[{W.NEEDED}] = needed"]
    return [*out, "return mask"]


def _stage(s: Structure, pieces: set[Piece]) -> list[str]:
    n = range(s.own)
    out = _per_lane(s)
    out += [f"q{i} = w[{W.Q + i}]\nv{i} = w[{W.V + i}]\nsq{i} = 0.0\nsv{i} = 0.0\nb{i} = 0.0\nl{i} = 0.0" for i in n]
    remembered, summed = stage_sums(s)
    out += [
        *remembered,
        *pins_read(s, True),
        "for j in range(k):",
        f"    o = {W.U} + {2 * W.WIDTH} * j",
        f"    aj = a[{W.MAX_STAGES} * k + j]",
    ]
    out += [f"    cj = c[{W.MAX_STAGES} * k + j]"]
    for i in n:
        out += [f"    x = w[o + {i}]", f"    sq{i} += aj * x", f"    b{i} += cj * x"]
    for i in n:
        out += [f"    x = w[o + {W.WIDTH + i}]", f"    sv{i} += aj * x", f"    l{i} += cj * x"]
    out += [*pins_summed(s), *summed, *string_summed(s)]
    ways = [f"abs(sq{i}) > w[{W.ALLOWANCE + i}]" for i in n] + [f"abs(sq{g}) > w[{W.P_ALLOWANCE + g}]" for g in s.pin]
    out += _prescribed(s, False)
    ways += [f"abs(q{i} - w[{W.Q + i}]) > w[{W.ALLOWANCE + i}]" for i in range(s.free, s.n)]
    if s.lanes == 1:
        out += ["exceeded = 0", f"if {' or '.join(ways)}:", "    mask = 0", "    exceeded = 1"]
    else:
        far = " | ".join(f"({way})" for way in ways)
        out += [f"exceeded = bits_of(({far}) & (w[{W.IDLE}] == 0.0))", "if exceeded != 0:", "    mask = 0"]
    out += [f"q{i} += sq{i}\nv{i} += sv{i}" for i in range(s.free)]
    out.append("if k > 0:")
    inner = [*left_alone(s), *pose(s), *mass(s), *forces(s, False)]
    for c in s.place:
        piece, call = forces_piece(s, c)
        pieces.add(piece)
        inner += [f"if mask & {1 << s.place[c]} == 0:", *("    " + line for line in call)]
    for k in range(len(s.probe)):
        inner += probe(s, k, False)
    inner += solve_mass(s)
    out += ["    " + line for text in inner for line in text.split("\n")]
    out += ["else:", *(f"    a{i} = w[{s.acceleration(i)}]" for i in range(s.free))]
    out += [f"    fade{m} = w[{W.Z_RATE + m}]" for m in range(len(s.memory))]
    out += [f"    fstring = w[{W.S_FORCE}]" for _ in s.string]
    out += [f"a{i} += l{i} * rate\nb{i} = v{i} + b{i} * rate" for i in range(s.free)]
    if s.pin:
        out += [*wide_known_sides(s), *known_sides(s), *string_known_sides(s), *wide_solved(s), *pins_staged(s)]
        out += [*(stages_of_memories(s) if s.memory else []), *string_stages(s)]
        return [*out, "return exceeded"]
    for i in n:
        text = f"ft * w[{W.F_U + i}] + w[{W.M_DIAG + i}] * a{i}"
        for j in n:
            if s.parent[i] == j or s.parent[j] == i:
                text += f" + w[{W.M_UP + (i if s.parent[i] == j else j)}] * a{j}"
        stiff = " + ".join(f"{s.stiffness(i, j)} * b{j}" for j in n if (i, j) in s.square())
        out.append(f"g{i} = {text} + gh * ({stiff})")
    out += [*known_sides(s), *string_known_sides(s)]
    pattern = _filled(s)
    for i in n:
        out += [f"g{i} -= w[{W.LU + W.WIDTH * i + j}] * g{j}" for j in range(i) if (i, j) in pattern]
    for i in reversed(n):
        out += [f"g{i} -= w[{W.LU + W.WIDTH * i + j}] * g{j}" for j in range(i + 1, s.free) if (i, j) in pattern]
        out.append(f"g{i} *= w[{W.LU + W.WIDTH * i + i}]")
    out.append(f"o = {W.U} + {2 * W.WIDTH} * k")
    for i in n:
        out += [f"w[o + {i}] = gh * (b{i} + g{i})", f"w[o + {W.WIDTH + i}] = g{i}"]
    if s.memory:
        out += stages_of_memories(s)
    out += string_stages(s)
    return [*out, "return exceeded"]


def _per_lane(s: Structure) -> list[str]:
    """Lines that read what a scalar kernel is given as numbers."""
    names = {"u": W.INPUT, "ft": W.INPUT_RATE, "gh": W.STAGE_STEP, "rate": W.STEP_RATE}
    return [f"{name} = w[{at}]" for name, at in names.items()] if s.lanes > 1 else []


def emit(tables: L.Tables, lanes: int = 1) -> str:
    """Source of the module that holds the four kernels of a scene with this structure."""
    return emit_with_pieces(tables, lanes)[0]


def emit_with_pieces(tables: L.Tables, lanes: int = 1) -> tuple[str, list[Piece]]:
    """The same, and the modules of the kinds of contact that it imports."""
    s = Structure(tables, lanes)
    pieces: set[Piece] = set()
    linearise, prepare, skip, stage = _linearise(s, pieces), _prepare(s), _skip(s), _stage(s, pieces)
    used = sorted(pieces)
    head = "".join(f"from {piece.name} import {piece.name}\n" for piece in used)
    if lanes > 1:
        begin, given = [f"w = rows(memory, {lanes})", f"p = rows(numbers, {lanes})"], "memory, numbers"
        lane_functions = (
            ("linearise", given, [*begin, *_per_lane(s)[:1], *linearise]),
            ("prepare", "memory", [begin[0], f"gh = w[{W.STAGE_STEP}]", *prepare]),
            ("skip", given, [*begin, *skip]),
            ("stage", f"{given}, a, c, k, mask", [*begin, *stage]),
        )
        return module(*lane_functions, head=_LANES_HEAD + head, decorator="generated_lanes(LANE_"), used
    functions = (
        ("linearise", "w, p, u", linearise),
        ("prepare", "w, gh", prepare),
        ("skip", "w, p", skip),
        ("stage", "w, p, a, c, k, gh, rate, u, ft, mask", stage),
    )
    if s.pin:
        head = WIDE_NAMES + head
    if s.memory:
        head = "from model.kernels.memory_laws import stulov_open\n" + head
    if s.string:
        head = NAMES + head
    if s.wound:
        head = AMPLIFIER_HEAD + head
    return module(*functions, head=HEAD + head), used


def module(*functions: tuple[str, str, list[str]], head: str = HEAD, decorator: str = "generated(") -> str:
    """Source of a module with these functions: name, arguments, lines."""
    parts = [head]
    for name, arguments, body in functions:
        lines = [line for text in body for line in text.split("\n")]
        parts.append(f"\n\n@{decorator}{name.upper()})\ndef {name}({arguments}):\n")
        parts.append("\n".join("    " + line for line in lines) + "\n")
    return "".join(parts)
