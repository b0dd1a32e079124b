"""A session seen from a second process while it is recorded, as numbers or as text."""

from __future__ import annotations

import textwrap
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from pianorig.console.braille_plot import curve
from rig.session.journal.live_reader import LiveView, SessionFollower
from rig.session.trial_data import absent_bodies


def view_facts(view: LiveView) -> dict[str, Any]:
    """The state of the recording, its last force and angles."""
    return {
        "trial": view.trial,
        "trials": view.trials,
        "state": view.state,
        "condition": view.condition,
        "samples": int(view.time_s.size),
        "time_s": float(view.time_s[-1]),
        "force_n": float(view.force_n[-1]),
        "peak_force_n": float(view.force_n.max()),
        "not_recorded": list(absent_bodies(view.names)),
        **{f"{name}_rad": float(view.angle_rad[-1, k]) for k, name in enumerate(view.names)},
    }


def view_as_text(view: LiveView, width: int = 72, *, braille: bool = True) -> str:
    """Force and the last body's angle, the hammer's, over time as lines of text of at most ``width`` characters.

    Without ``braille`` the curves are drawn with signs that every terminal has.
    """
    head = f"trial {view.trial} of {view.trials}  {view.state}" + (f"  {view.condition}" if view.condition else "")
    lines = [f"{head}  t = {view.time_s[-1]:.2f} s  force {view.force_n[-1]:.2f} N (peak {view.force_n.max():.1f})"]
    curves = [("force, N", view.force_n)]
    if view.names:
        turned = "  ".join(f"{name} {np.degrees(view.angle_rad[-1, k]):+.2f}" for k, name in enumerate(view.names))
        lines.append(f"turned: {turned} deg")
        curves.append((f"{view.names[-1]}, deg", np.degrees(view.angle_rad[:, -1])))
    if absent := absent_bodies(view.names):
        lines.append(f"not recorded: {', '.join(absent)}")
    drawn: list[str] = []
    for label, values in curves:
        drawn += [f"{label}: {values.min():.2f} to {values.max():.2f}"[:width], *curve(values, width, 6, braille)]
    return "\n".join([*(part for line in lines for part in textwrap.wrap(line, width)), *drawn])


def watch(
    session: Path,
    show: Callable[[LiveView], None],
    *,
    every_s: float = 0.5,
    once: bool = False,
    wait: Callable[[float], None] = time.sleep,
) -> LiveView | None:
    """Show a session whenever there is something new, until its plan is complete; return the last view.

    Raises
    ------
    rig.errors.InputError : no session there, or a trial that cannot be read
    """
    follower = SessionFollower(session)
    seen: tuple[int, str, int] | None = None
    view: LiveView | None = None
    while True:
        view = follower.poll() or view
        if view is not None and (now := (view.trial, view.state, view.time_s.size)) != seen:
            show(view)
            seen = now
        if once or (view is not None and view.finished):
            return view
        wait(every_s)
