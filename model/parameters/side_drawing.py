"""Side view of an action from its parameters alone: pivots, contact surfaces, and the bodies that connect them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from model.tabular import BODY_COLORS

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from model.parameters.quantity import Quantity

# rest angles of the printed action, to two digits: the solver needs a start on the right side of each contact
PRINTED_REST = {"key": 0.029, "whippen": 0.025, "jack": 0.32, "repetition": 0.35, "hammer": 0.295}
HALF_LINE_M = 0.008  # of a plane surface, drawn to each side
WIDE_MM = 30.0
GROUND_COLOR = "#777777"


def draw_side(ax: Axes, quantities: Mapping[str, Quantity], structure: Mapping[str, str]) -> None:
    """Draw into ``ax`` the side view of the action at the printed rest angles, x right and y up, mm; circles and lines
    are the surfaces of its contacts."""

    def place(path: str) -> complex:
        return complex(quantities[f"{path}.x"].value, quantities[f"{path}.y"].value)

    poses = {"ground": (0j, 0.0)}  # where a body's frame lies, and its angle
    for body, angle in PRINTED_REST.items():  # parents come first
        at, turned = poses[structure[f"{body}.parent"]]
        poses[body] = at + np.exp(1j * turned) * place(f"{body}.pivot"), turned + angle
    for path in (key.removesuffix(".body") for key in structure if key.endswith((".first.body", ".second.body"))):
        body = structure[f"{path}.body"]
        color = BODY_COLORS.get(body, GROUND_COLOR)
        (at, turned), surface = poses[body], _surface(path, place(path), quantities)
        drawn = 1e3 * (at + np.exp(1j * turned) * surface)
        is_wide = np.ptp(drawn.real) > WIDE_MM  # most of such a circle touches nothing
        ax.plot(drawn.real, drawn.imag, color=color, linewidth=0.4 if is_wide else 1.2)
        if body != "ground":
            stick = 1e3 * np.array([at, at + np.exp(1j * turned) * surface[len(surface) // 2]])
            ax.plot(stick.real, stick.imag, color=color, linewidth=0.8, alpha=0.5)
    for body, (at, _) in poses.items():
        if body != "ground":
            ax.plot(1e3 * at.real, 1e3 * at.imag, "o", color=BODY_COLORS[body], markersize=5, label=body)
    ax.set(aspect="equal", xlabel="x, mm", ylabel="y, mm")
    ax.legend(fontsize="small", ncols=5)


def _surface(path: str, at: complex, quantities: Mapping[str, Quantity]) -> NDArray[Any]:
    """Points (k,), x + iy, m, of the surface ``path``, a circle, an arc or a line around its place ``at``, in its
    body's frame."""
    number = {name: quantities[key].value for name in ("radius", "arc_start", "arc_end", "normal.x", "normal.y")
              if (key := f"{path}.{name}") in quantities}  # fmt: skip
    if "radius" not in number:
        return at + 1j * complex(number["normal.x"], number["normal.y"]) * np.linspace(-HALF_LINE_M, HALF_LINE_M, 3)
    ends = number.get("arc_start", 0.0), number.get("arc_end", 2.0 * np.pi)
    return np.asarray(at + number["radius"] * np.exp(1j * np.linspace(*ends, 49)))
