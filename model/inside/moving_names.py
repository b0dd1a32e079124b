"""Numbers of the contacts and names of the bodies in the moving side view, each moving with what it names."""

from __future__ import annotations

import html

import numpy as np
from numpy.typing import NDArray

from model.inside.animated_svg import Clock
from model.inside.label_layout import places
from model.inside.labels import BODY_COLORS
from model.inside.side_view import SideView
from model.simulation.loads_and_losses import Inside


def moving_names(inside: Inside, view: SideView, rows: NDArray[np.int64], clock: Clock) -> list[str]:
    """Text elements, one per contact and body, that stay clear of each other where the motion begins."""
    named = [(name.removeprefix("contact").replace("_", " "), "#444444") for name in inside.contacts]
    ways = [1e3 * inside.point_m[rows, c] for c in range(len(inside.contacts))]
    for body in inside.turning_bodies:
        i = inside.bodies.index(body)
        sticks = view.sticks[body]
        if not len(sticks):
            continue
        longest = sticks[int(np.argmax(np.hypot(*(sticks[:, 1] - sticks[:, 0]).T)))]
        x, y, turn = inside.pose[rows, i].T
        mx, my = longest.mean(axis=0)
        way = np.column_stack([x + np.cos(turn) * mx - np.sin(turn) * my, y + np.sin(turn) * mx + np.cos(turn) * my])
        named.append((body, BODY_COLORS.get(body, "#777777")))
        ways.append(1e3 * way)
    if not named:
        return []
    offsets = places(np.array([way[0] for way in ways]), [name for name, _ in named])
    return [
        f"<g>{clock.transform('translate', ';'.join(f'{x:.2f} {y:.2f}' for x, y in way))}"
        f'<text x="{dx:.1f}" y="{-dy + 2.0:.1f}" transform="scale(1 -1)" font-size="6" fill="{color}" stroke="white" '
        f'stroke-width="1.5" paint-order="stroke" text-anchor="middle">{html.escape(name)}</text></g>'
        for (name, color), way, (dx, dy) in zip(named, ways, offsets, strict=True)
    ]
