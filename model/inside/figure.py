"""One sheet of an inside view: force of each contact, energy losses, whether the key stays on its rail."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.errors import InputError
from model.files.figure_sheet import new_sheet
from model.files.time_table import two_columns
from model.inside.labels import BODY_COLORS, contact_label, input_label
from model.parameters.action import STRING, Action, ActionLike, as_action
from model.parameters.effects import RAIL
from model.simulation.loads_and_losses import Inside
from model.simulation.solution import Solution

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]

NORMAL, FRICTION, FELT, TENSE = "#0072B2", "#C04A00", "#7A9E3B", "#D62728"
BEFORE_S, AFTER_S = 0.012, 0.018  # of the close-up, around the strike
WORTH_A_LABEL = 0.1  # of the largest, in the close-up; weaker ones would only cover each other


def draw_sheet(
    action: ActionLike,
    solution: Solution,
    force_n: ArrayLike,
    path: str | Path,
    events_s: Mapping[str, float] | None = None,
) -> None:
    """Write the inside view of a blow, which ``solution`` must hold, to ``path`` (.svg, .pdf or .png), in place of a
    file there; ``force_n`` (m,): the run's input at its times; ``events_s``: name -> time, s.

    Parameters
    ----------
    action, solution : the simulated action and its solution, with an inside view
    force_n : (m,) input at the solution's times, N (with a motor arm N m, its drive V, a finger m)
    path : file to write, .svg, .pdf or .png
    events_s : name and time of what happens in the blow, s; marked where given

    Raises
    ------
    InputError : a solution without an inside view, not one force for each of its times, a file that cannot be written

    Examples
    --------
    >>> import model
    >>> action, (time_s, force_n) = model.load_action(), model.force_table("forte")
    >>> solution = model.simulate(action, time_s, force_n, inside=True)
    >>> model.inside.draw_sheet(action, solution, force_n, "inside.svg")
    """
    action = as_action(action)
    inside = solution.inside
    if inside is None:
        raise InputError("sheet: the solution has no inside view; simulate with inside=True")
    force_n = two_columns(solution.time_s, force_n, "sheet")[1]
    with new_sheet(path, 16.5, 11.7) as figure:
        layout: Any = figure.get_layout_engine()
        layout.set(hspace=0.0, h_pad=0.01, rect=(0.0, 0.0, 1.0, 0.965))  # the title stands above
        count = len(inside.contacts)
        halves = figure.add_gridspec(1, 2, width_ratios=[8.2, 3.4])
        grid = halves[0].subgridspec(count + 8, 2, width_ratios=[5, 3.2])
        right = halves[1].subgridspec(3, 1, height_ratios=[count + len(inside.bodies), 8, 6])
        near = _close_up(inside)
        top = [figure.add_subplot(grid[:3, k]) for k in (0, 1)]
        for axes, ends in zip(top, (None, near), strict=True):
            _draw_motion(axes, action, solution, force_n, ends, legend=ends is None)
        for k in (0, 1):
            axes = figure.add_subplot(grid[3:6, k], sharex=top[k])
            _draw_angles(axes, solution, legend=k == 0)
            _mark_events((top[k], axes), events_s or {}, near, closer=k == 1)
        words = f"{action.name}. Contacts: pressure blue, friction orange, each row to its own largest force"
        figure.text(0.01, 0.99, words, va="top", fontsize="large")
        top[1].set_title("the strike" if STRING in inside.contacts else "closer", loc="left")
        for c, name in enumerate(inside.contacts):
            for k in (0, 1):
                axes = figure.add_subplot(grid[c + 6, k], sharex=top[k])
                _draw_contact(axes, inside, c, contact_label(action, name) if k == 0 else None)
                axes.tick_params(labelbottom=False, bottom=False)
        for k, ends in enumerate((None, near)):
            axes = figure.add_subplot(grid[count + 6 :, k], sharex=top[k])
            _draw_rail(axes, inside, ends)
        _draw_losses(figure.add_subplot(right[0]), action, inside)
        _draw_sliding(figure.add_subplot(right[1]), action, inside)
        _draw_speeds(figure.add_subplot(right[2]), inside)


def _close_up(inside: Inside) -> tuple[float, float]:
    """Interval (s) around the largest force on the string, else of any contact."""
    k = inside.contacts.index(STRING) if STRING in inside.contacts else None
    force = inside.normal_n[:, k] if k is not None and inside.normal_n[:, k].any() else inside.normal_n.sum(axis=1)
    middle = float(inside.time_s[int(np.argmax(force))]) if len(inside.contacts) else float(inside.time_s[0])
    return max(float(inside.time_s[0]), middle - BEFORE_S), min(float(inside.time_s[-1]), middle + AFTER_S)


def _draw_motion(
    axes: Axes, action: Action, solution: Solution, force_n: Array, shown_s: tuple[float, float] | None, legend: bool
) -> None:
    """Draw input, dip of the key's front and distance of the hammer from the string into one panel, between the times
    ``shown_s`` (None: all)."""
    time = solution.time_s
    assert solution.inside is not None
    quantity, unit = input_label(solution.inside.scene)
    lines = axes.plot(time, force_n, color="black", linewidth=1.0, label=f"{quantity}, {unit}")
    axes.set_ylabel(unit)
    other = axes.twinx()
    lines += other.plot(time, 1e3 * solution.key_dip_m, color=FRICTION, label="key dip, mm")
    if "hammer" in solution.bodies:
        lines += other.plot(time, 1e3 * solution.hammer_height_m, color=NORMAL, label="hammer to string, mm")
    other.set_ylabel("mm")
    axes.set_xlim(*(shown_s or (time[0], time[-1])))
    axes.grid(alpha=0.3)
    if legend:
        other.legend(handles=lines, fontsize="small", ncols=3, loc="lower right", bbox_to_anchor=(1.0, 1.0))


def _draw_angles(axes: Axes, solution: Solution, legend: bool) -> None:
    """Draw the angle of each body since the first time, degrees, in its colour."""
    for i, body in enumerate(solution.bodies):
        if body in BODY_COLORS:
            turned = np.degrees(solution.angle_rad[:, i] - solution.angle_rad[0, i])
            axes.plot(solution.time_s, turned, color=BODY_COLORS[body], linewidth=1.0, label=body)
    axes.set_ylabel("angle, °")
    axes.tick_params(labelbottom=False)
    axes.grid(alpha=0.3)
    if legend:
        axes.legend(fontsize="x-small", ncols=5, loc="upper right", framealpha=0.7)


def _mark_events(
    panels: Sequence[Axes], events_s: Mapping[str, float], near: tuple[float, float], *, closer: bool
) -> None:
    """Draw a dotted line at each event, named in the lowest panel; those within ``near`` (s) are named in the close-up
    (``closer``) alone."""
    for name, time in events_s.items():
        is_near = near[0] <= time <= near[1]
        if closer and not is_near:
            continue
        for axes in panels:
            axes.axvline(time, color="#777777", linewidth=0.6, linestyle=":")
        if is_near and not closer:
            continue
        panels[-1].text(
            time, 0.02, name, rotation=90, fontsize="xx-small", va="bottom", ha="right", clip_on=True,
            transform=panels[-1].get_xaxis_transform(),
        )  # fmt: skip


def _draw_contact(axes: Axes, inside: Inside, c: int, label: str | None) -> None:
    """Draw a contact's normal force filled, friction as a line, on the scale of its own largest force; ``c``: its
    index."""
    largest = float(inside.largest_normal_n[c])
    axes.fill_between(inside.time_s, inside.normal_n[:, c], color=NORMAL, alpha=0.55, linewidth=0)
    if np.any(inside.friction_n[:, c]):
        axes.plot(inside.time_s, inside.friction_n[:, c], color=FRICTION, linewidth=0.8)
    scale = largest if largest > 0.0 else 1.0
    low = min(0.0, float(inside.friction_n[:, c].min(initial=0.0)))
    axes.set_ylim(min(-0.05 * scale, 1.1 * low), 1.1 * scale)
    axes.set_yticks([])
    axes.grid(alpha=0.3)
    for side in ("top", "right", "left"):
        axes.spines[side].set_visible(False)
    if label is not None:
        axes.text(
            -0.01,
            0.35,
            f"{label}  {largest:.3g} N",
            transform=axes.transAxes,
            ha="right",
            va="center",
            fontsize="small",
        )


def _draw_rail(axes: Axes, inside: Inside, shown_s: tuple[float, float] | None) -> None:
    """Draw the rail's upward force on the key, N, red where a joint there would have to pull or the key is off its
    felt; the largest are labelled, within the times ``shown_s`` only (None: all)."""
    time, force = inside.dense_time_s, inside.dense_joint_n[:, inside.bodies.index("key"), 1]
    if RAIL in inside.contacts:
        time, force = inside.time_s, inside.normal_n[:, inside.contacts.index(RAIL)]
    axes.plot(time, force, color="black", linewidth=0.9)
    axes.fill_between(time, np.minimum(force, 0.0), color=TENSE, alpha=0.7, linewidth=0)
    gaps = inside.key_lifts()
    for lift in gaps:
        axes.axvspan(lift.start_s, lift.end_s, color=TENSE, alpha=0.3, linewidth=0)
    for lift in _intervals_to_label(gaps, [g.largest_m for g in gaps], shown_s):
        axes.annotate(
            f"off {lift.start_s:.4f} s,\n{1e3 * (lift.end_s - lift.start_s):.1f} ms, {1e3 * lift.largest_m:.2f} mm",
            (lift.start_s, 0.0), xytext=(2, 12), textcoords="offset points", fontsize="x-small", color=TENSE,
        )  # fmt: skip
    axes.axhline(0.0, color="black", linewidth=0.6)
    pulls = inside.key_tensions()
    for one in _intervals_to_label(pulls, [p.largest_n for p in pulls], shown_s):
        axes.annotate(
            f"would lift {one.start_s:.4f} s,\n{1e3 * (one.end_s - one.start_s):.1f} ms, {one.largest_n:.1f} N",
            (one.largest_at_s, -one.largest_n), xytext=(8, 2), textcoords="offset points",
            fontsize="x-small", color=TENSE,
        )  # fmt: skip
    shown = (time >= shown_s[0]) & (time <= shown_s[1]) if shown_s else np.ones(len(time), dtype=bool)
    low, high = float(force[shown].min()), float(force[shown].max())
    axes.set_ylim(min(low, 0.0) - 0.15 * (high - low), high + 0.05 * (high - low))
    axes.set_xlabel("time, s")
    axes.grid(alpha=0.3)
    if shown_s is None:
        red = "off" if RAIL in inside.contacts else "pull"
        axes.set_ylabel(
            f"balance rail\non the key, N\n(red: {red})", rotation=0, ha="right", va="center", fontsize="small"
        )


def _intervals_to_label(found: Sequence[Any], size: Sequence[float], shown_s: tuple[float, float] | None) -> list[Any]:
    """Those of the intervals ``found`` to annotate: the largest in the whole view, similar ones in the close-up."""
    limit = max(size, default=0.0) * (1.0 if shown_s is None else WORTH_A_LABEL)
    return [
        one
        for one, s in zip(found, size, strict=True)
        if s >= limit and (shown_s is None or shown_s[0] <= one.start_s <= shown_s[1])
    ]


def _draw_losses(axes: Axes, action: Action, inside: Inside) -> None:
    """Draw the energy (mJ) lost by the end, a bar each contact and joint."""
    names = [contact_label(action, n) for n in inside.contacts] + [f"joint of {b}" for b in inside.bodies]
    joints = np.zeros(len(inside.bodies))
    felt = 1e3 * np.concatenate([inside.felt_j[-1], joints])
    rubbed = 1e3 * np.concatenate([inside.rubbed_j[-1], inside.joint_j[-1]])
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


def _draw_sliding(axes: Axes, action: Action, inside: Inside) -> None:
    """Draw the sliding distance (mm) under pressure over time, of the contacts that have friction."""
    sliding = [c for c in range(len(inside.contacts)) if np.any(inside.friction_n[:, c])]
    for c in sliding:
        label = f"{contact_label(action, inside.contacts[c])}: {1e3 * inside.slid_m[-1, c]:.2f} mm"
        axes.plot(inside.time_s, 1e3 * inside.slid_m[:, c], label=label, linewidth=1.2)
    axes.set_title("sliding distance where there is friction, mm", loc="left", fontsize="medium")
    axes.set_xlim(inside.time_s[0], inside.time_s[-1])
    axes.grid(alpha=0.3)
    if sliding:
        axes.margins(y=0.06 + 0.11 * len(sliding))  # room for the legend above the curves
        axes.set_ylim(bottom=0.0)
        axes.legend(fontsize="x-small", loc="upper left")


def _draw_speeds(axes: Axes, inside: Inside) -> None:
    """Draw the speed (m/s) of each body's centre of mass over time."""
    for body in inside.turning_bodies:
        i = inside.bodies.index(body)
        speed = np.hypot(inside.center_m_per_s[:, i, 0], inside.center_m_per_s[:, i, 1])
        acceleration = np.hypot(inside.center_m_per_s2[:, i, 0], inside.center_m_per_s2[:, i, 1])
        label = f"{body}: to {speed.max():.2g} m/s, {acceleration.max():.2g} m/s²"
        axes.plot(inside.time_s, speed, label=label, linewidth=1.0, color=BODY_COLORS.get(body, "#777777"))
    axes.set_title("speed of centres of mass, m/s", loc="left", fontsize="medium")
    axes.set_xlim(inside.time_s[0], inside.time_s[-1])
    axes.set_xlabel("time, s")
    axes.grid(alpha=0.3)
    axes.legend(fontsize="x-small")
