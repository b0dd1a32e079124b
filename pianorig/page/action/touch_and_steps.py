"""What takes a moment longer: the touch curve of the action as it is set, and what turning one screw does to it."""

from __future__ import annotations

from typing import Any

import model
from pianorig.errors import CommandInputError
from pianorig.player.packing import pack

LARGEST_TURN_M = 5e-3


def touch(action: model.Action) -> dict[str, Any]:
    """Force over dip of a slow press and release (m, N), and the weights read from it (N).

    Raises
    ------
    model.ModelError : the action cannot be pressed
    """
    found = model.touch.weigh(action)
    (down_m, down_n), (up_m, up_n) = found.curve()
    return {
        "press": {"dip_m": pack(down_m), "force_n": pack(down_n)},
        "release": {"dip_m": pack(up_m), "force_n": pack(up_n)},
        "weights": {
            "down weight": found.down_n,
            "up weight": found.up_n,
            "friction weight": found.friction_n,
            "let-off peak": found.let_off_n,
        },
        "dip_m": found.dip_m,
    }


def technician_step(action: model.Action, target: str, turn_m: float) -> dict[str, Any]:
    """The seven regulated lengths before and after one screw is turned, m; None where one cannot be measured.

    Parameters
    ----------
    action : as it is set
    target : whose screw is turned, one of ``model.regulation.TARGETS``
    turn_m : how far, m

    Raises
    ------
    CommandInputError : no such target, or too large a turn
    model.ModelError : the action cannot be measured
    """
    screw = next((screw for screw in model.regulation.SCREWS if screw.target == target), None)
    if screw is None:
        names = ", ".join(one.name for one in model.regulation.TARGETS)
        raise CommandInputError(f"target {target[:40]!r}: allowed {names}")
    if not abs(turn_m) <= LARGEST_TURN_M:
        raise CommandInputError(f"turn {1e3 * turn_m:g} mm: allowed up to {1e3 * LARGEST_TURN_M:g} mm either way")
    turned = action.with_values({screw.path: action[screw.path] + turn_m}, "page")
    before, after = model.regulation.measure(action), model.regulation.measure(turned)
    rows = [
        {
            "target": each.name,
            "words": each.words,
            "wanted_m": each.wanted_m,
            "before_m": before.value_m[each.name],
            "after_m": after.value_m[each.name],
            "remark": after.remarks.get(each.name) or before.remarks.get(each.name) or "",
        }
        for each in model.regulation.TARGETS
    ]
    return {"screw": screw.name, "path": screw.path, "turn_m": turn_m, "value": turned[screw.path], "rows": rows}
