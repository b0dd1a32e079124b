"""Pictures of what a command found: a session's force and angles, targets of a regulation, checks, calibrations."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from model.arrays import as_numbers
from model.files.figure_sheet import new_sheet
from model.inside.labels import BODY_COLORS

if TYPE_CHECKING:
    import model
    import rig

MOST_POINTS = 4000
GOOD, BAD = "#00785A", "#B3261E"
CHECK_IN = 0.32  # height of a row
ONSET_SHARE = 0.01  # of the largest force: what is less is rest
FEWEST_QUIET = 10  # samples of rest that a level is read from


def draw_session(session: rig.Session, path: Path) -> None:
    """Draw into the picture ``path`` a panel for the raw force, N, and one for each encoder (degrees since the first
    sample), over time, all readable trials of the session laid over one another."""
    trials = [trial.read() for trial in session.trials if not trial.problem]
    names = list(dict.fromkeys(encoder.name for data in trials for encoder in data.encoders))
    has_force = any(data.has_force for data in trials)
    panels = [*(["force"] if has_force else []), *names]
    with new_sheet(path, 9.0, 0.6 + 1.9 * max(len(panels), 1)) as figure:
        grid = figure.subplots(max(len(panels), 1), 1, sharex=True, squeeze=False)[:, 0]
        for data in trials:
            step = max(1, data.time_s.size // MOST_POINTS)
            time = data.time_s[::step]
            angles = np.degrees(data.angle_rad)[::step]
            recorded = [encoder.name for encoder in data.encoders]
            for axes, name in zip(grid, panels, strict=False):
                if name == "force":
                    axes.plot(time, data.raw_force_n[::step], color="black", linewidth=0.8, alpha=0.7)
                elif name in recorded:
                    color = BODY_COLORS.get(name, "#555555")
                    axes.plot(time, angles[:, recorded.index(name)], color=color, linewidth=0.9, alpha=0.8)
        for axes, name in zip(grid, panels, strict=False):
            axes.set_ylabel("force, N" if name == "force" else f"{name}, °")
            axes.grid(alpha=0.3)
        grid[-1].set_xlabel("time, s")
        n = f"{len(trials)} trial{'' if len(trials) == 1 else 's'}"
        figure.suptitle(f"{session.info.name or session.path.name}: {n}, as recorded; angles since the first sample")


def draw_targets(rows: Sequence[dict[str, Any]], before: str, path: Path) -> None:
    """Draw how far each regulated length is from the wanted one, mm, before (key ``before`` of a row, m) and, where
    rows have ``after_m``, after regulating, into the picture ``path``; ``rows``: also ``wanted_m``, ``words``."""
    with new_sheet(path, 8.0, 1.1 + CHECK_IN * len(rows)) as figure:
        axes = figure.subplots()
        for name, marker, color in ((before, "o", BAD), ("after_m", "s", GOOD)):
            if name in rows[0]:
                away = [1e3 * (row[name] - row["wanted_m"]) for row in rows]
                label = {"after_m": "after"}.get(name, "before" if "after_m" in rows[0] else "measured")
                axes.plot(away, range(len(rows)), marker, color=color, label=label, markersize=6)
        axes.axvline(0.0, color="#777777", linewidth=0.8)
        axes.set_yticks(range(len(rows)), [f"{row['words']} ({1e3 * row['wanted_m']:.2f} mm)" for row in rows])
        axes.invert_yaxis()
        axes.set_xscale("symlog", linthresh=0.1)
        axes.set_xlabel("away from what is wanted, mm (linear to 0.1 mm)")
        axes.grid(alpha=0.3)
        axes.legend(loc="best", fontsize="small")


def draw_checks(findings: Sequence[Any], path: Path) -> None:
    """Draw the checks of a self-test (`SelftestFinding`), a row each, into the picture ``path``: passed or not, what
    was found, what is allowed."""
    with new_sheet(path, 9.0, 0.8 + CHECK_IN * len(findings)) as figure:
        axes = figure.subplots()
        for i, one in enumerate(findings):
            axes.plot([0.0], [i], "s" if one.passed else "X", color=GOOD if one.passed else BAD, markersize=9)
            axes.text(0.03, i, one.check, va="center")
            axes.text(0.33, i, one.found, va="center")
            axes.text(0.70, i, f"allowed {one.allowed}", va="center", color="#4a4a4a")
        axes.set(xlim=(-0.03, 1.1), ylim=(len(findings) - 0.5, -0.5))
        axes.axis("off")
        passed = sum(one.passed for one in findings)
        axes.set_title(f"self-test: {passed} of {len(findings)} checks passed", loc="left")


def draw_deviations(
    at: Sequence[float], away: Sequence[float], words: tuple[str, str, str], path: Path, u: Sequence[float] = ()
) -> None:
    """Draw what a calibration left over (``away``) at each reference (``at``), with bars of standard uncertainty ``u``
    where given, into the picture ``path``; ``words``: title, horizontal and vertical label."""
    title, along, up = words
    at_1d, away_1d, u_1d = (as_numbers(v, name, 1) for name, v in (("at", at), ("away", away), ("u", u)))
    with new_sheet(path, 7.0, 3.6) as figure:
        axes = figure.subplots()
        if u_1d.size:
            axes.errorbar(at_1d, away_1d, yerr=u_1d, fmt="o", color=BODY_COLORS["whippen"], capsize=3)
        else:
            axes.plot(at_1d, away_1d, "o", color=BODY_COLORS["whippen"])
        axes.axhline(0.0, color="#777777", linewidth=0.8)
        axes.set(title=title, xlabel=along, ylabel=up)
        axes.grid(alpha=0.3)


def draw_uncertainties(estimates: Sequence[Any], path: Path) -> None:
    """Draw the relative standard uncertainty, %, of each estimated parameter of a drive, a row each, or that it is not
    determined, into the picture ``path``."""
    with new_sheet(path, 8.0, 1.1 + 0.26 * len(estimates)) as figure:
        axes = figure.subplots()
        known = [(i, abs(e.u / e.value)) for i, e in enumerate(estimates) if e.is_determined and e.value]
        for i, share in known:
            axes.plot([100 * share], [i], "o", color=BODY_COLORS["whippen"])
        for i, e in enumerate(estimates):
            if not e.is_determined:
                axes.text(0.02, i, "not determined", transform=axes.get_yaxis_transform(), va="center", color=BAD)
        axes.set_yticks(range(len(estimates)), [f"{e.name.replace('_', ' ')} ({e.unit})" for e in estimates])
        axes.set(xscale="log", xlabel="relative standard uncertainty, %", ylim=(len(estimates) - 0.5, -0.5))
        axes.grid(alpha=0.3)


def draw_distortion(to_picture: Callable[[Any], Any], size_px: tuple[int, int], path: Path) -> None:
    """Draw how far points of the plane are displaced in the picture of a camera, as arrows ten times as long, into the
    file ``path``.

    ``to_picture``: where points (n, 2) of the plane appear; ``size_px``: width and height of the picture.
    """
    width, height = size_px
    x, y = np.meshgrid(np.linspace(0, width - 1, 13), np.linspace(0, height - 1, 9))
    flat = np.stack([x.ravel(), y.ravel()], axis=1)
    away = np.asarray(to_picture(flat)) - flat
    with new_sheet(path, 7.0, 1.0 + 6.0 * height / width) as figure:
        axes = figure.subplots()
        axes.quiver(*flat.T, *(10 * away.T), angles="xy", scale_units="xy", scale=1, color=BODY_COLORS["whippen"])
        largest = float(np.hypot(*away.T).max())
        axes.set_title(f"displacement in the picture, ten times: {largest:.2f} px at most", loc="left")
        axes.set(xlabel="x (px)", ylabel="y (px)", aspect="equal")
        axes.invert_yaxis()


def blow_events(action: model.Action, solution: model.Solution, force: np.ndarray) -> dict[str, float]:
    """Times, s, by title of the events found in a blow that begins at rest; ``force`` (m,): at the solution's times, of
    which only the onset counts. Empty where a body is missing or there is no rest before the onset."""
    # start-up: 0.3 s of validation, which a run without a figure does not need
    from validation.conventions import BODIES, ENCODER_BODIES
    from validation.events.definitions import EVENTS
    from validation.events.detect import find_events
    from validation.measurement.geometry import geometry_of, motion_of

    force = as_numbers(force, "force", 1)
    away = np.abs(force - force[:1])
    quiet = int(np.argmax(away > ONSET_SHARE * away.max())) if away.size and away.max() > 0 else 0
    if tuple(solution.bodies[: len(BODIES)]) != tuple(BODIES) or quiet < FEWEST_QUIET:
        return {}
    rest = solution.angle_rad[0, : len(BODIES)]
    change = (solution.angle_rad[:, : len(BODIES)] - rest)[:, ENCODER_BODIES]
    motion = motion_of(geometry_of(action, rest), solution.time_s, change, np.full(3, 1e-5))
    found = find_events(motion, quiet).values()
    return {EVENTS[e.name].title: e.value for e in found if EVENTS[e.name].unit == "s" and e.status != "absent"}
