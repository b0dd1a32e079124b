"""One sheet of an inside view: what each contact does, where energy goes, whether the key stays on its rail.

Rows of the contacts carry their own scale and largest force; the second column looks at the strike alone.
matplotlib is imported when the sheet is drawn.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from model.errors import InputError
from model.files.figure_sheet import check_ending, new_sheet, save_sheet
from model.kernels import layout as L
from model.observables import hammer_height_m, key_dip_m
from model.parameters.action import BODIES, STRING, Action
from model.parameters.effects import RAIL
from model.simulation.loads_and_losses import Inside
from model.simulation.solution import Solution

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]

NORMAL, FRICTION, FELT, TENSE = "#0072B2", "#C04A00", "#7A9E3B", "#D62728"
WORTH_A_LABEL = 0.1  # of the largest, in the close-up; weaker ones would only cover each other
BEFORE_S, AFTER_S = 0.012, 0.018  # of the close-up, around the strike


def close_up(seen: Inside) -> tuple[float, float]:
    """Interval (s) worth a closer look: around the largest force on the string, else of any contact."""
    k = seen.contacts.index(STRING) if STRING in seen.contacts else None
    force = seen.normal_n[:, k] if k is not None and seen.normal_n[:, k].any() else seen.normal_n.sum(axis=1)
    middle = float(seen.time_s[int(np.argmax(force))]) if len(seen.contacts) else float(seen.time_s[0])
    return max(float(seen.time_s[0]), middle - BEFORE_S), min(float(seen.time_s[-1]), middle + AFTER_S)


def input_words(seen: Inside | None) -> tuple[str, str]:
    """What the input of a run is, and its unit."""
    torque = seen is not None and any(kind == L.JOINT_TORQUE for kind, _ in seen.scene.tables.drive)
    return ("torque of the motor", "N m") if torque else ("force on the key", "N")


def contact_words(action: Action, name: str) -> str:
    """Number and name of a contact."""
    number, said = name.removeprefix("contact"), action.structure.get(f"{name}.description", "")
    return f"{number} {said}" if said else number.replace("_", " ")


def draw_sheet(action: Action, solution: Solution, force_n: Array, path: str | Path) -> None:
    """Write the sheet to ``path`` (.svg, .pdf or .png); ``force_n`` (m,) is the input at the solution's times."""
    target = Path(path)
    check_ending(target)
    seen = solution.inside
    if seen is None:
        raise InputError("sheet: the solution has no inside view; simulate with inside=True")
    figure = new_sheet(16.5, 11.7)
    layout: Any = figure.get_layout_engine()
    layout.set(hspace=0.0, h_pad=0.01)
    count = len(seen.contacts)
    halves = figure.add_gridspec(1, 2, width_ratios=[8.2, 3.4])
    grid = halves[0].subgridspec(count + 5, 2, width_ratios=[5, 3.2])
    right = halves[1].subgridspec(3, 1, height_ratios=[count + len(seen.bodies), 8, 6])
    near = close_up(seen)
    top = [figure.add_subplot(grid[:3, k]) for k in (0, 1)]
    for axes, ends in zip(top, (None, near), strict=True):
        _draw_motion(axes, action, solution, force_n, ends, legend=ends is None)
    figure.suptitle(f"{action.name}. Contacts: pressure blue, friction orange, each row to its own largest force")
    top[1].set_title("the strike" if STRING in seen.contacts else "closer", loc="left")
    for c, name in enumerate(seen.contacts):
        for k in (0, 1):
            axes = figure.add_subplot(grid[c + 3, k], sharex=top[k])
            _draw_contact(axes, seen, c, contact_words(action, name) if k == 0 else None)
            axes.tick_params(labelbottom=False, bottom=False)
    for k, ends in enumerate((None, near)):
        axes = figure.add_subplot(grid[count + 3 :, k], sharex=top[k])
        _draw_rail(axes, seen, ends)
    _draw_losses(figure.add_subplot(right[0]), action, seen)
    _draw_rubbing(figure.add_subplot(right[1]), action, seen)
    _draw_speeds(figure.add_subplot(right[2]), seen)
    save_sheet(figure, target)


def _draw_motion(
    axes: Axes, action: Action, solution: Solution, force_n: Array, ends: tuple[float, float] | None, legend: bool
) -> None:
    """Force on the key, dip of its front and way of the hammer to the string, in one panel."""
    time = solution.time_s
    said, unit = input_words(solution.inside)
    lines = axes.plot(time, force_n, color="black", linewidth=1.0, label=f"{said}, {unit}")
    axes.set_ylabel(unit)
    other = axes.twinx()
    whole = np.zeros((len(time), len(BODIES)))
    for i, body in enumerate(solution.bodies):
        if body in BODIES:
            whole[:, BODIES.index(body)] = solution.angle_rad[:, i]
    lines += other.plot(time, 1e3 * key_dip_m(action, whole), color=FRICTION, label="key dip, mm")
    if "hammer" in solution.bodies:
        lines += other.plot(time, 1e3 * hammer_height_m(action, whole), color=NORMAL, label="hammer to string, mm")
    other.set_ylabel("mm")
    axes.set_xlim(*(ends or (time[0], time[-1])))
    axes.grid(alpha=0.3)
    if legend:
        other.legend(handles=lines, fontsize="small", ncols=3, loc="lower right", bbox_to_anchor=(1.0, 1.0))


def _draw_contact(axes: Axes, seen: Inside, c: int, words: str | None) -> None:
    """Normal force filled, friction as a line; the row's scale is its own largest force."""
    largest = float(seen.largest_normal_n[c])
    axes.fill_between(seen.time_s, seen.normal_n[:, c], color=NORMAL, alpha=0.55, linewidth=0)
    if np.any(seen.friction_n[:, c]):
        axes.plot(seen.time_s, seen.friction_n[:, c], color=FRICTION, linewidth=0.8)
    scale = largest if largest > 0.0 else 1.0
    low = min(0.0, float(seen.friction_n[:, c].min(initial=0.0)))
    axes.set_ylim(min(-0.05 * scale, 1.1 * low), 1.1 * scale)
    axes.set_yticks([])
    axes.grid(alpha=0.3)
    for side in ("top", "right", "left"):
        axes.spines[side].set_visible(False)
    if words is not None:
        label = f"{words}  {largest:.3g} N"
        axes.text(-0.01, 0.35, label, transform=axes.transAxes, ha="right", va="center", fontsize="small")


def _draw_rail(axes: Axes, seen: Inside, ends: tuple[float, float] | None) -> None:
    """Upward force of the balance rail on the key; red where the rail would have to pull."""
    time, force = seen.dense_time_s, seen.dense_joint_n[:, seen.bodies.index("key"), 1]
    if RAIL in seen.contacts:
        time, force = seen.time_s, seen.normal_n[:, seen.contacts.index(RAIL)]
    axes.plot(time, force, color="black", linewidth=0.9)
    axes.fill_between(time, np.minimum(force, 0.0), color=TENSE, alpha=0.7, linewidth=0)
    gaps = seen.key_lifts()
    for gone in gaps:
        axes.axvspan(gone.start_s, gone.end_s, color=TENSE, alpha=0.3, linewidth=0)
    for gone in _labelled(gaps, [g.largest_m for g in gaps], ends):
        axes.annotate(
            f"off {gone.start_s:.4f} s,\n{1e3 * (gone.end_s - gone.start_s):.1f} ms, {1e3 * gone.largest_m:.2f} mm",
            (gone.start_s, 0.0), xytext=(2, 12), textcoords="offset points", fontsize="x-small", color=TENSE,
        )  # fmt: skip
    axes.axhline(0.0, color="black", linewidth=0.6)
    pulls = seen.key_tensions()
    for one in _labelled(pulls, [p.largest_n for p in pulls], ends):
        axes.annotate(
            f"would lift {one.start_s:.4f} s,\n{1e3 * (one.end_s - one.start_s):.1f} ms, {one.largest_n:.1f} N",
            (one.largest_at_s, -one.largest_n), xytext=(8, 2), textcoords="offset points",
            fontsize="x-small", color=TENSE,
        )  # fmt: skip
    inside = (time >= ends[0]) & (time <= ends[1]) if ends else np.ones(len(time), dtype=bool)
    low, high = float(force[inside].min()), float(force[inside].max())
    axes.set_ylim(min(low, 0.0) - 0.15 * (high - low), high + 0.05 * (high - low))
    axes.set_xlabel("time, s")
    axes.grid(alpha=0.3)
    if ends is None:
        red = "off" if RAIL in seen.contacts else "pull"
        axes.set_ylabel(
            f"balance rail\non the key, N\n(red: {red})", rotation=0, ha="right", va="center", fontsize="small"
        )


def _labelled(found: Sequence[Any], size: Sequence[float], ends: tuple[float, float] | None) -> list[Any]:
    """Intervals that get words: the largest in the whole view, those of its order in the close-up."""
    limit = max(size, default=0.0) * (1.0 if ends is None else WORTH_A_LABEL)
    return [
        one
        for one, s in zip(found, size, strict=True)
        if s >= limit and (ends is None or ends[0] <= one.start_s <= ends[1])
    ]


def _draw_losses(axes: Axes, action: Action, seen: Inside) -> None:
    """Energy lost by the end, per contact and joint."""
    names = [contact_words(action, n) for n in seen.contacts] + [f"joint of {b}" for b in seen.bodies]
    joints = np.zeros(len(seen.bodies))
    felt = 1e3 * np.concatenate([seen.felt_j[-1], joints])
    rubbed = 1e3 * np.concatenate([seen.rubbed_j[-1], seen.joint_j[-1]])
    at = np.arange(len(names))
    axes.barh(at, rubbed, color=FRICTION, label="friction")
    axes.barh(at, felt, left=rubbed, color=FELT, label="felt")
    for y, total in enumerate(rubbed + felt):
        axes.text(total, y, f" {total:.2g}", va="center", fontsize="x-small")
    axes.set_yticks(at, names, fontsize="x-small")
    axes.invert_yaxis()
    axes.margins(x=0.12)
    total = float(np.sum(rubbed + felt))
    axes.set_title(f"energy lost by the end, mJ (all: {total:.3g})", loc="left", fontsize="medium")
    axes.legend(fontsize="small", loc="lower right")
    axes.grid(alpha=0.3, axis="x")


def _draw_rubbing(axes: Axes, action: Action, seen: Inside) -> None:
    """Way rubbed under pressure, of the contacts that have friction."""
    rubs = [c for c in range(len(seen.contacts)) if np.any(seen.friction_n[:, c])]
    for c in rubs:
        words = f"{contact_words(action, seen.contacts[c])}: {1e3 * seen.slid_m[-1, c]:.2f} mm"
        axes.plot(seen.time_s, 1e3 * seen.slid_m[:, c], label=words, linewidth=1.2)
    axes.set_title("way rubbed where there is friction, mm", loc="left", fontsize="medium")
    axes.set_xlim(seen.time_s[0], seen.time_s[-1])
    axes.grid(alpha=0.3)
    if rubs:
        axes.legend(fontsize="x-small")


def _draw_speeds(axes: Axes, seen: Inside) -> None:
    """Speed of each body's centre of mass."""
    for body in seen.turning_bodies:
        i = seen.bodies.index(body)
        speed = np.hypot(seen.center_m_per_s[:, i, 0], seen.center_m_per_s[:, i, 1])
        acceleration = np.hypot(seen.center_m_per_s2[:, i, 0], seen.center_m_per_s2[:, i, 1])
        words = f"{body}: to {speed.max():.2g} m/s, {acceleration.max():.2g} m/s²"
        axes.plot(seen.time_s, speed, label=words, linewidth=1.0)
    axes.set_title("speed of centres of mass, m/s", loc="left", fontsize="medium")
    axes.set_xlim(seen.time_s[0], seen.time_s[-1])
    axes.set_xlabel("time, s")
    axes.grid(alpha=0.3)
    axes.legend(fontsize="x-small")
