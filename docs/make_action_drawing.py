"""Draw `docs/images/action.svg`: the five bodies at rest, the thirteen contacts by number, the sense of each angle.

Run after changing the geometry of an action:  python docs/make_action_drawing.py
Geometry is that of ``hirschkorn2004-regulated`` at static rest, from the model itself; colours are those of the moving
side view.
"""

from __future__ import annotations

from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import FancyArrowPatch
from numpy.typing import NDArray

import model
from model.inside.labels import BODY_COLORS
from model.inside.side_view import GROUND, side_view
from model.simulation.loads_and_losses import Inside

COLORS = {**BODY_COLORS, GROUND: "#555555"}
PICTURE = Path(__file__).parent / "images" / "action.svg"
ACTION = "hirschkorn2004-regulated"
# name of each body: where it stands, and the place of the body it points at, mm
NAMES = {
    "key": ("key", (110.0, 22.0), (110.0, 2.8)), "whippen": ("whippen", (-8.0, 40.0), (-100.0, 42.0)),
    "jack": ("jack", (-12.0, 80.0), (-98.0, 84.0)), "repetition": ("repetition lever", (10.0, 104.0), (-77.0, 101.0)),
    "hammer": ("hammer", (-160.0, 128.0), (-160.0, 90.0)), GROUND: ("string", (-180.0, 172.0), (-220.0, 170.6)),
}  # fmt: skip
ANGLES = {body: rf"$\theta_{body[0]}$" for body in model.BODIES}
NUDGE = {
    1: (11.0, -7.0), 3: (-13.0, -7.0), 5: (11.0, -7.0), 6: (-11.0, -9.0), 7: (10.0, 3.0),
    8: (10.0, 5.0), 9: (9.0, 7.0), 10: (-9.0, 8.0), 11: (-3.0, 11.0),
}  # fmt: skip


def rest() -> Inside:
    """The regulated action at rest, with the places of its contacts."""
    time_s = np.array([0.0, 1e-3])
    inside = model.simulate(model.load_action(ACTION), time_s, np.zeros(2), inside=True).inside
    assert inside is not None
    return inside


def draw() -> None:
    """Write the picture."""
    inside = rest()
    view = side_view(inside)
    plt.rcParams.update({"svg.hashsalt": "action", "svg.fonttype": "path", "font.size": 10})
    figure, ax = plt.subplots(figsize=(9.6, 4.4), layout="constrained")
    poses = dict(zip(inside.bodies, inside.pose[0], strict=True))
    poses[GROUND] = np.zeros(3)
    for body, pose in poses.items():
        for pair in view.sticks.get(body, ()):
            ax.plot(*_world(pair, pose).T, color=COLORS[body], linewidth=3.2, solid_capstyle="round", alpha=0.55)
        for shape in view.surfaces[body]:
            ax.plot(*_world(shape.points, pose).T, color=COLORS[body], linewidth=1.6)
    for body, (text, place, at) in NAMES.items():
        line = {"arrowstyle": "-", "linewidth": 0.8, "color": COLORS[body]}
        ax.annotate(text, at, place, color=COLORS[body], fontweight="bold", ha="center", va="center", arrowprops=line)
    for body, text in ANGLES.items():
        _turn(ax, 1e3 * poses[body][:2], text, COLORS[body])
    for c, point in enumerate(1e3 * inside.point_m[0], start=1):
        dx, dy = NUDGE.get(c, (0.0, 9.0))
        ax.plot(*point, "o", color="black", markersize=2.5)
        place = point + np.array([dx, dy])
        line, disc = {"arrowstyle": "-", "linewidth": 0.6}, {"boxstyle": "circle,pad=0.12", "fc": "white"}
        ax.annotate(str(c), point, place, fontsize=9, ha="center", va="center", arrowprops=line, bbox=disc)
    action = model.load_action(ACTION)
    (x, y), *_ = _world(np.array([[action["drive.point.x"], action["drive.point.y"]]]), poses["key"])
    ax.annotate("force", (x, y), (x, y + 38.0), ha="center", arrowprops={"arrowstyle": "-|>", "linewidth": 1.8})
    ax.set_aspect("equal")
    ax.set_xlabel("x (mm), towards the player")
    ax.set(ylabel="y (mm), up", ylim=(-22.0, 182.0))
    ax.spines[["top", "right"]].set_visible(False)
    figure.savefig(PICTURE, metadata={"Date": None, "Creator": None})
    plt.close(figure)


def _world(points: NDArray[np.float64], pose: NDArray[np.float64]) -> NDArray[np.float64]:
    """Points (k, 2) of a body's frame, m, as drawn, mm."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    turned = np.stack([c * points[:, 0] - s * points[:, 1], s * points[:, 0] + c * points[:, 1]], axis=1)
    placed: NDArray[np.float64] = 1e3 * (turned + pose[:2])
    return placed


def _turn(ax: Axes, pivot: NDArray[np.float64], text: str, colour: str) -> None:
    """Mark a pivot and the positive sense of the angle about it."""
    ax.plot(*pivot, "o", color="white", markeredgecolor=colour, markersize=6, zorder=5)
    start, end = pivot + np.array([9.0, -2.0]), pivot + np.array([1.0, 9.0])
    bow = "arc3,rad=0.45"
    ax.add_patch(FancyArrowPatch(start, end, connectionstyle=bow, arrowstyle="-|>", mutation_scale=9, color=colour))
    ax.text(*(pivot + np.array([11.0, 6.0])), text, color=colour, fontsize=9)


if __name__ == "__main__":
    draw()
