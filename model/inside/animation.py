"""A moving side view of a blow in one file: SVG that any browser plays.

Time is slowed down, most of all around the strike. Contacts glow with an area in proportion to their force; bars beside
the picture show each force relative to its largest; the key's pivot turns red where its rail would have to pull, or
where a key that can lift is off it. The file refers to no other file or address. Lengths in the drawing are millimetres
times `SCALE`.
"""

from __future__ import annotations

import html
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.errors import InputError
from model.files.atomic_write import whole_file
from model.files.time_table import two_columns
from model.inside.labels import BODY_COLORS, close_up, contact_label, input_label
from model.inside.side_view import GROUND, SideView, side_view
from model.parameters.action import Action
from model.parameters.effects import RAIL
from model.simulation.loads_and_losses import Inside
from model.simulation.solution import Solution

Array = NDArray[np.float64]

ENDINGS = (".svg",)
SCALE = 1.75  # drawing units per mm
FAR_STEP_S, NEAR_STEP_S = 1e-3, 2e-4  # of the action's time between two rows, away from the strike and around it
STILL_STEP_S, VISIBLE_RAD = 25e-3, 2e-4  # the same before anything moves, and from which angle on it is seen to
GLOW_MM2_PER_N = 6.0
COLORS = {**BODY_COLORS, GROUND: "#555555"}
PLOT_WIDTH, PLOT_HEIGHT = 820.0, 150.0
BAR_WIDTH, BAR_STEP = 110.0, 24.0
MARGIN = 24.0
FRAME_S = 0.04  # of the viewer's time between two rows
NAME_HEIGHT = 6.0  # of a name, mm in the drawing
LETTER_WIDTH = 3.8  # of a letter
NAME_DISTANCES = (5.0, 9.0, 13.0, 18.0, 24.0)
NAME_DIRECTIONS = 16
POINT_FREE = 3.0  # kept free around every point


def frame_rows(inside: Inside) -> NDArray[np.int64]:
    """Rows to show, one per frame: fine around the strike, coarse elsewhere.

    Parameters
    ----------
    inside : inside view of a blow

    Returns
    -------
    ndarray of int
        Indices into its rows, increasing.

    Examples
    --------
    >>> import model
    >>> solution = model.simulate(model.load_action(), *model.force_table("forte"), inside=True)
    >>> rows = model.inside.animation.frame_rows(solution.inside)
    >>> len(rows) < len(solution.time_s)
    True
    """
    time = inside.time_s
    near = close_up(inside)
    begins = min(_first_motion_s(inside) - FAR_STEP_S, near[0])
    parts = [
        np.arange(time[0], begins, STILL_STEP_S),
        np.arange(max(begins, time[0]), near[0], FAR_STEP_S),
        np.arange(near[0], near[1], NEAR_STEP_S),
        np.arange(near[1], time[-1], FAR_STEP_S),
        time[-1:],
    ]
    return np.unique(np.searchsorted(time, np.concatenate(parts) - 1e-9).clip(0, len(time) - 1))


def _first_motion_s(inside: Inside) -> float:
    """Time (s) at which a body first turns visibly; the last time where none does."""
    away = np.abs(inside.pose[:, :, 2] - inside.pose[0, :, 2]).max(axis=1)
    moved = away > VISIBLE_RAD
    return float(inside.time_s[int(np.argmax(moved))]) if moved.any() else float(inside.time_s[-1])


def write_animation(action: Action, solution: Solution, force_n: ArrayLike, path: str | Path) -> None:
    """Write the moving side view to one file.

    Parameters
    ----------
    action, solution : the simulated action and its solution, with an inside view at 5 kHz or finer
    force_n : (m,) force on the key at the solution's times, N
    path : file to write, .svg; ``pianorig simulate --animation`` also writes .html, with a player

    Raises
    ------
    InputError : another ending, a solution without an inside view, or not one force for each of its times

    Examples
    --------
    >>> import model
    >>> action, (time_s, force_n) = model.load_action(), model.force_table("forte")
    >>> solution = model.simulate(action, time_s, force_n, inside=True)
    >>> model.inside.write_animation(action, solution, force_n, "blow.svg")
    """
    target = Path(path)
    if target.suffix not in ENDINGS:
        raise InputError(f"{target}: ending found {target.suffix!r}, allowed {', '.join(ENDINGS)}")
    inside = solution.inside
    if inside is None:
        raise InputError("animation: the solution has no inside view; simulate with inside=True")
    rows = frame_rows(inside)
    svg = _svg(action, inside, two_columns(inside.time_s, force_n, "animation")[1], rows)
    with whole_file(target) as part:
        part.write_text(svg, encoding="utf-8")


def _svg(action: Action, inside: Inside, force: Array, rows: NDArray[np.int64]) -> str:
    view = side_view(inside)
    clock = _Clock(len(rows))
    low, high = _extent(inside, view)
    width, height = SCALE * 1e3 * (high - low)
    bars_x = width + 2 * MARGIN
    total_width = bars_x + 190 + BAR_WIDTH + MARGIN
    plot_y = max(height, BAR_STEP * (len(inside.contacts) + 1)) + 2 * MARGIN
    total_height = plot_y + PLOT_HEIGHT + 2 * MARGIN
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {total_width:.0f} {total_height:.0f}" '
        'font-family="sans-serif" font-size="13" role="img">',
        f"<title>{html.escape(action.name)}: side view of a blow</title>",
        f'<rect width="{total_width:.0f}" height="{total_height:.0f}" fill="white"/>',
        # y up, metres to drawing units
        f'<g transform="translate({MARGIN - SCALE * 1e3 * low[0]:.2f} {MARGIN + SCALE * 1e3 * high[1]:.2f}) '
        f'scale({SCALE} {-SCALE})" stroke-linecap="round" stroke-linejoin="round" fill="none">',
        _surfaces(view, GROUND),
        *(_body(inside, view, i, rows, clock) for i in range(len(inside.bodies))),
        *(_glow(inside, c, rows, clock) for c in range(len(inside.contacts))),
        *_moving_names(inside, view, rows, clock),
        "</g>",
        f'<text x="{bars_x + 188:.0f}" y="{MARGIN - 6:.0f}" font-size="10" fill="#555555">now; at most</text>',
        *(_bar(action, inside, c, rows, clock, bars_x) for c in range(len(inside.contacts))),
        _legend(inside, bars_x),
        _plot(inside, force, rows, clock, plot_y),
        "</svg>",
    ]
    return "\n".join(parts)


def _extent(inside: Inside, view: SideView) -> tuple[Array, Array]:
    """Lower left and upper right corner of what is drawn, m."""
    points = [shape.points for shape in view.surfaces[GROUND]]
    for i, body in enumerate(inside.bodies):
        pose = inside.pose[:, i]
        own = np.concatenate([view.sticks[body].reshape(-1, 2), *(s.points for s in view.surfaces[body])])
        for x, y, turn in (pose[0], *pose[:: max(1, len(pose) // 40)]):
            c, s = np.cos(turn), np.sin(turn)
            points.append(np.array([x, y]) + own @ np.array([[c, s], [-s, c]]))
    every = np.concatenate(points)
    return every.min(axis=0) - 0.004, every.max(axis=0) + 0.004


def _path(points: Array) -> str:
    return "M" + "L".join(f"{1e3 * x:.2f} {1e3 * y:.2f}" for x, y in points)


def _surfaces(view: SideView, body: str) -> str:
    lines = "".join(_path(shape.points) for shape in view.surfaces[body])
    return f'<path d="{lines}" stroke="{COLORS.get(body, "#777777")}" stroke-width="1.1"/>'


def _body(inside: Inside, view: SideView, i: int, rows: NDArray[np.int64], clock: _Clock) -> str:
    """Sticks, surfaces and pivot of a body, moved by its pose."""
    body = inside.bodies[i]
    pose = inside.pose[rows, i]
    color = COLORS.get(body, "#777777")
    at = ";".join(f"{1e3 * x:.2f} {1e3 * y:.2f}" for x, y in pose[:, :2])
    sticks = "".join(_path(pair) for pair in view.sticks[body])
    dot = f'<circle r="1.6" fill="white" stroke="{color}" stroke-width="0.8"/>'
    if body == "key":
        rail = inside.contacts.index(RAIL) if RAIL in inside.contacts else None
        pull = inside.joint_n[rows, i, 1] < 0.0 if rail is None else inside.penetration_m[rows, rail] <= 0.0
        fills = ";".join("#D62728" if p else "#FFFFFF" for p in pull)
        radii = ";".join("4" if p else "2" for p in pull)
        dot = (
            f'<circle r="2" fill="white" stroke="{color}" stroke-width="0.8">'
            f"{clock.attribute('fill', fills)}{clock.attribute('r', radii)}</circle>"
        )
    return (
        f"<g>{clock.transform('translate', at)}<g>{clock.transform('rotate', _values_text(np.degrees(pose[:, 2]), 3))}"
        f'<path d="{sticks}" stroke="{color}" stroke-width="5" opacity="0.3"/>{_surfaces(view, body)}{dot}</g></g>'
    )


def _glow(inside: Inside, c: int, rows: NDArray[np.int64], clock: _Clock) -> str:
    """A disc at a contact, its area in proportion to the largest force since the previous frame."""
    radius = np.sqrt(GLOW_MM2_PER_N * _peak_since(inside.normal_n[:, c], rows) / np.pi)
    at = ";".join(f"{1e3 * x:.2f} {1e3 * y:.2f}" for x, y in inside.point_m[rows, c])
    return (
        f"<g>{clock.transform('translate', at)}"
        f'<circle r="0" fill="#FF7F0E" opacity="0.75">{clock.attribute("r", _values_text(radius))}</circle></g>'
    )


def _peak_since(values: Array, rows: NDArray[np.int64]) -> Array:
    """Largest value since the previous frame, so that no short peak is lost between two frames."""
    starts = np.concatenate([[rows[0]], rows[:-1] + 1])
    out: Array = np.maximum.reduceat(values, np.minimum(starts, len(values) - 1))
    return out


def _bar(action: Action, inside: Inside, c: int, rows: NDArray[np.int64], clock: _Clock, x: float) -> str:
    """Name, force against its largest, and that largest force."""
    y = MARGIN + BAR_STEP * c
    largest = float(inside.largest_normal_n[c])
    share = _peak_since(inside.normal_n[:, c], rows) / largest if largest > 0.0 else np.zeros(len(rows))
    label = html.escape(contact_label(action, inside.contacts[c]))
    return (
        f'<text x="{x + 180:.0f}" y="{y + 13:.0f}" text-anchor="end">{label}</text>'
        f'<rect x="{x + 188:.0f}" y="{y:.0f}" width="{BAR_WIDTH:.0f}" height="16" fill="#EEEEEE"/>'
        f'<rect x="{x + 188:.0f}" y="{y:.0f}" width="0" height="16" fill="#FF7F0E">'
        f"{clock.attribute('width', _values_text(BAR_WIDTH * np.minimum(share, 1.0), 1))}</rect>"
        f'<text x="{x + 186 + BAR_WIDTH:.0f}" y="{y + 12:.0f}" text-anchor="end" font-size="10" fill="#555555">'
        f"{largest:.3g} N</text>"
    )


def _legend(inside: Inside, x: float) -> str:
    """Names of the bodies in their colours."""
    y = MARGIN + BAR_STEP * len(inside.contacts) + 14
    label = " ".join(
        f'<tspan fill="{COLORS.get(body, "#777777")}" font-weight="bold">{html.escape(body)}</tspan>'
        for body in inside.turning_bodies
    )
    return (
        f'<text x="{x + 20:.0f}" y="{y:.0f}" font-size="11">{label}</text>'
        f'<text x="{x + 20:.0f}" y="{y + 18:.0f}" font-size="11" fill="#D62728">'
        f"red pivot: the key {'is off' if RAIL in inside.contacts else 'would lift from'} its rail</text>"
    )


def _plot(inside: Inside, force: Array, rows: NDArray[np.int64], clock: _Clock, top: float) -> str:
    """Force on the key and angles over real time, with a cursor at the frame's time."""
    time = inside.time_s
    span = float(time[-1] - time[0]) or 1.0
    x = MARGIN + PLOT_WIDTH * (time - time[0]) / span
    thin = np.unique(np.concatenate([np.arange(0, len(time), max(1, len(time) // 1500)), rows]))
    parts = [f'<rect x="{MARGIN}" y="{top:.0f}" width="{PLOT_WIDTH}" height="{PLOT_HEIGHT}" fill="#F7F7F7"/>']
    quantity, unit = input_label(inside)
    curves = [(quantity, force, "#000000")]
    for body in ("key", "hammer"):
        if body in inside.bodies:
            turn = inside.pose[:, inside.bodies.index(body), 2]
            curves.append((f"{body} turned", np.abs(turn - turn[0]), COLORS[body]))
    for k, (label, values, color) in enumerate(curves):
        largest = float(np.max(np.abs(values))) or 1.0
        y = top + PLOT_HEIGHT * (0.97 - 0.94 * np.clip(values / largest, 0.0, 1.0))
        line = "M" + "L".join(f"{a:.1f} {b:.1f}" for a, b in zip(x[thin], y[thin], strict=True))
        peak = f"{largest:.3g} {unit}" if k == 0 else f"{np.degrees(largest):.3g}°"
        parts.append(f'<path d="{line}" fill="none" stroke="{color}" stroke-width="1.3"/>')
        place = MARGIN + PLOT_WIDTH + 12
        parts.append(f'<text x="{place:.0f}" y="{top + 16 + 20 * k:.0f}" fill="{color}">{label}, to {peak}</text>')
    cursor = _values_text(x[rows], 1)
    parts.append(
        f'<line x1="0" x2="0" y1="{top:.0f}" y2="{top + PLOT_HEIGHT:.0f}" stroke="#D62728" stroke-width="1.2">'
        f"{clock.attribute('x1', cursor)}{clock.attribute('x2', cursor)}</line>"
    )
    for t in np.linspace(float(time[0]), float(time[-1]), 8):
        at = MARGIN + PLOT_WIDTH * (t - time[0]) / span
        parts.append(
            f'<text x="{at:.1f}" y="{top + PLOT_HEIGHT + 16:.0f}" text-anchor="middle" font-size="11">{t:.2f} s</text>'
        )
    return "".join(parts)


def _moving_names(inside: Inside, view: SideView, rows: NDArray[np.int64], clock: _Clock) -> list[str]:
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
    offsets = _name_offsets(np.array([way[0] for way in ways]), [name for name, _ in named])
    return [
        f"<g>{clock.transform('translate', ';'.join(f'{x:.2f} {y:.2f}' for x, y in way))}"
        f'<text x="{dx:.1f}" y="{-dy + 2.0:.1f}" transform="scale(1 -1)" font-size="6" fill="{color}" stroke="white" '
        f'stroke-width="1.5" paint-order="stroke" text-anchor="middle">{html.escape(name)}</text></g>'
        for (name, color), way, (dx, dy) in zip(named, ways, offsets, strict=True)
    ]


def _name_offsets(points: Array, names: Sequence[str]) -> Array:
    """Offsets (c, 2), mm, of the middle of each name from its point (c, 2), y up: beside it, on no other name or point.

    Names are placed one after the other, each at the nearest free place; one that has none takes the emptiest.
    """
    turns = np.linspace(0.25 * np.pi, 2.25 * np.pi, NAME_DIRECTIONS, endpoint=False)
    ways = np.column_stack([np.cos(turns), np.sin(turns)])
    taken: list[tuple[Array, Array]] = []
    out = np.zeros((len(names), 2))
    for k, name in enumerate(names):
        half = np.array([0.5 * LETTER_WIDTH * len(name), 0.5 * NAME_HEIGHT])
        tries = [(way * (distance + half * np.abs(way))) for distance in NAME_DISTANCES for way in ways]
        covered = [_covered(points[k] + offset, half, points, taken) for offset in tries]
        out[k] = tries[int(np.argmin(covered))]  # the first, nearest one of equals
        taken.append((points[k] + out[k], half))
    return out


def _covered(middle: Array, half: Array, points: Array, taken: Sequence[tuple[Array, Array]]) -> float:
    """Area, mm², that a name at ``middle`` shares with names and points."""
    total = 0.0
    for other, size in (*taken, *((point, np.full(2, POINT_FREE)) for point in points)):
        overlap = half + size - np.abs(middle - other)
        if np.all(overlap > 0.0):
            total += float(np.prod(np.minimum(overlap, 2.0 * np.minimum(half, size))))
    return total


def _values_text(values: Array, digits: int = 2) -> str:
    """A list of numbers of an animated attribute, one per frame."""
    return ";".join(f"{v:.{digits}f}".rstrip("0").rstrip(".") for v in values)


class _Clock:
    """Writes animated attributes that share the same frames."""

    def __init__(self, frames: int) -> None:
        self.end = f'dur="{(frames - 1) * FRAME_S:g}s" repeatCount="indefinite"'

    def attribute(self, name: str, values: str) -> str:
        """An attribute that takes one of ``values``, joined by semicolons, in each frame."""
        return f'<animate attributeName="{name}" values="{values}" {self.end}/>'

    def transform(self, kind: str, values: str) -> str:
        """A transformation of some kind, with values as for `attribute`."""
        return f'<animateTransform attributeName="transform" type="{kind}" values="{values}" {self.end}/>'
