"""Source lines of the contact of hammer and string, in place of the rigid bar. See ``contacts``.

Functions that loop over the modes are in `model.kernels.string_modes`; here is where they stand in a scene's kernels.
Their number is a number in p, so that one compilation serves any.
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

NAMES = """from model.kernels.string_modes import (
    AWAKE, felt_on_string, string_at, string_energy, string_factors, string_in_stage, string_known, string_losses,
    string_stage, weigh_string,
)
"""


def _law(s: LoneContact | Structure, c: int) -> str:
    felt = ", ".join(contact_numbers(s, c, L.K_A, L.K_B, L.K_C, L.DAMP))
    return f"felt_on_string(x, rate, p[os + {L.STRING_GIVE}], {felt})"


def string_forces(s: LoneContact, c: int) -> list[str]:
    """As ``contacts.contact_forces``, without friction; also sets the force ``fn`` on the string."""
    touch = [*arms_and_rates(s, c), "rate = rate - swing", f"fn, _, _, slow = {_law(s, c)}"]
    # modes that wait know of no contact: a step that comes upon it is tried again, shorter
    touch += ["if awake == 0.0:", "    fn = nan", "fx, fy = fn * nx, fn * ny", *push(s, c)]
    return ["fn = 0.0", *centres(s, c), *surface(s, c, False), "x = x - sway", "if x > 0.0:", *indent(touch)]


def string_linearised(s: LoneContact, c: int) -> list[str]:
    """As ``contacts.contact_linearised``; also writes what the modes are coupled by."""
    chain = s.chain[c]
    start = ["bar = x", "sway, swing, awake = string_at(w, p, os, zs, x)"]
    start += ["x = x - sway if awake != 0.0 else x + w[" + str(W.S_REACH) + "]"]
    start += [f"w[{row}] = 0.0" for row in (W.S_FORCE, W.S_HARD, W.S_LOSSY)]
    start += [f"w[{row + k}] = 0.0" for row in (W.S_ALONG, W.S_ANGLES, W.S_SPEEDS) for k in range(len(chain))]
    start += [f"w[{W.S_AWAKE}] = awake", "worth = 0.0"]
    law = ["rate = rate - swing", f"fn, fnx, fnr, _ = {_law(s, c)}", "mu = 0.0", "mus = 0.0"]
    law += [f"w[{W.S_FORCE}] = fn", f"w[{W.S_HARD}] = fnx", f"w[{W.S_LOSSY}] = fnr"]
    law += [f"worth = fnx * {easiest(s, c, 'gn')}"]
    pressing = derivatives(s, c, lambda j, rate: _of_joint(j))
    pressing += [f"w[{W.S_ALONG + k}] = along{k}" for k in range(len(chain))]
    stiffness = contact_numbers(s, c, L.K_C)[0]
    away = [f"w[{s.at(c, W.ROOM)}] = max(0.0, -bar - w[{W.S_REACH}])", f"w[{s.at(c, W.GAP)}] = max(0.0, -x)"]
    away += [f"w[{s.at(c, W.GAP_RATE)}] += swing", f"worth = {stiffness} * {easiest(s, c, 'turns', f'_{c}')}"]
    felt = FeltLines(law, pressing, away, stiffness, start)
    return [*contact_linearised(s, c, felt), "if awake != 0.0:", "    weigh_string(w, p, os, zs, worth)"]


def _of_joint(j: int) -> list[str]:
    return [f"w[{W.S_ANGLES + j}] = fnj", f"w[{W.S_SPEEDS + j}] = fnv"]


def string_energy_lines(s: Structure, c: int) -> list[str]:
    """As ``contacts.contact_energy``; energy and losses of the modes among them."""
    o, row = s.offset[7], W.AUDIT_Z + s.first_memory()
    modes = row + L.STRING_STATES
    felt = ", ".join(contact_numbers(s, c, L.K_A, L.K_B, L.K_C))
    start = [f"os = {o}", f"energy += string_energy({modes}, w, p, os)", "string_loss = 0.0", "sway = 0.0"]
    start += [f"if w[{row + L.SINCE}] < 0.5 * AWAKE:", f"    string_loss = string_losses({modes}, w, p, os)"]
    sums = ["for i in range(int(p[os])):", f"    sway += w[{modes} + i]", f"    swing += w[{modes} + int(p[os]) + i]"]
    touch = [
        *arms_and_rates(s, c),
        "rate = rate - swing",
        f"fn, _, _, slow = {_law(s, c)}",
        f"give = p[os + {L.STRING_GIVE}]",
    ]
    # what the modes left out give way stores half of give times force squared
    touch += ["energy += 0.5 * give * slow * slow", "felt_loss += (fn - slow) * rate", "x -= give * slow"]
    touch += [f"stored, _ = felt_energy(x, rate, fn, {felt})", "energy += stored"]
    pressed = [*centres(s, c), *surface(s, c, False), "x = x - sway", "if x > 0.0:", *indent(touch)]
    return [*start, "swing = 0.0", f"if w[{row + L.SINCE}] < 0.5 * AWAKE:", *indent([*sums, *pressed])]


def string_prepared(s: Structure) -> list[str]:
    """Lines of ``prepare``: less force of the contact, for the modes give way."""
    if not s.string:
        return []
    chain = s.chain[s.string[0]]
    out = [f"if w[{W.S_AWAKE}] != 0.0:"]
    block = ["left = 1.0 - string_factors(w, inverse, gh)"]
    for j, (cj, _) in enumerate(chain):
        if cj < s.free:
            block.append(f"back = left * (gh * w[{W.S_ANGLES + j}] + w[{W.S_SPEEDS + j}])")
            block += [f"{s.factor(b, cj)} += w[{W.S_ALONG + k}] * back" for k, (b, _) in enumerate(chain) if b < s.free]
    return [*out, *indent(block)]


def string_summed(s: Structure) -> list[str]:
    """Lines of ``stage`` once the stages so far are summed."""
    if not s.string:
        return []
    given = f"w, p, {s.offset[7]}, {s.first_memory()}, a, c, k, rate"
    return [
        f"awake = w[{W.S_AWAKE}]", f"sway = -w[{W.S_REACH}]", "swing = 0.0", "fstring = 0.0",
        "if awake != 0.0:", f"    sway, swing = string_in_stage({given})",
    ]  # fmt: skip


def string_known_sides(s: Structure) -> list[str]:
    """Lines of ``stage`` once the speeds' known side is set."""
    if not s.string:
        return []
    chain = s.chain[s.string[0]]
    turned = " + ".join(f"w[{W.S_ANGLES + j}] * b{b}" for j, (b, _) in enumerate(chain) if b < s.free)
    block = [f"turned = gh * ({turned})", f"given = string_known(w, p, {s.offset[7]}, fstring, gh)"]
    block += [f"less = w[{W.S_SHARE}] * given + (1.0 - w[{W.S_SHARE}]) * turned"]
    block += [f"g{b} -= w[{W.S_ALONG + k}] * less" for k, (b, _) in enumerate(chain) if b < s.free]
    return ["turned = 0.0", "given = 0.0", "if awake != 0.0:", *indent(block)]


def string_stages(s: Structure) -> list[str]:
    """Lines of ``stage`` once the speeds are solved for."""
    if not s.string:
        return []
    chain = s.chain[s.string[0]]
    back = " + ".join(
        f"(gh * w[{W.S_ANGLES + j}] + w[{W.S_SPEEDS + j}]) * g{b}" for j, (b, _) in enumerate(chain) if b < s.free
    )
    call = f"string_stage(w, p, {s.offset[7]}, {s.first_memory()}, k, w[{W.S_SHARE}] * (turned + {back} - given), gh)"
    return ["if awake != 0.0:", f"    {call}"]
