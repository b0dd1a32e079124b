"""``pianorig watch``: a recording seen from a second process, as numbers, as text, as a picture that is refreshed."""

from __future__ import annotations

import textwrap
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pianorig.console.column_file import check_writable
from pianorig.console.options import AsJson
from pianorig.console.output import print_json
from pianorig.console.terminal import can_print, clear_screen, drawing_width
from pianorig.errors import CommandInputError
from rig.atomic_write import replace_when_complete

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from rig.session.live_view import LiveView

DOTS = ((0x01, 0x08), (0x02, 0x10), (0x04, 0x20), (0x40, 0x80))  # bits of a braille character by row and column
PLAIN = (" ", "'", ".", ":")

BLANK = chr(0x2800)  # a braille character; what prints one prints all


def command(
    session: Annotated[Path, typer.Argument(help="Session folder that is being recorded, or a finished one.")],
    png: Annotated[Path | None, typer.Option("--out", help="Refresh this picture instead of drawing text.")] = None,
    every: Annotated[float, typer.Option("--every", help="Time between updates, s.")] = 0.5,  # choice
    once: Annotated[bool, typer.Option("--once", help="Show the present state and end.")] = False,
    as_json: AsJson = False,
) -> None:
    """Show force and angles of the trial being recorded.
    Until the plan is complete, or Ctrl-C; it only reads, so that the recording is not disturbed.

    Example:  pianorig watch sessions/try
    """
    if not 0.05 <= every <= 60:  # s: faster burdens the bench, slower shows nothing
        raise CommandInputError(f"--every {every:g}: allowed 0.05 to 60 s")
    if png is not None:
        check_writable(png)

    def show(view: LiveView) -> None:
        if png is not None:
            draw_view(png, view)
        if as_json:
            print_json(view_facts(view))
        elif png is None:
            clear_screen()
            print(view_text(view, drawing_width(), braille=can_print(BLANK)), flush=True)

    try:
        last = follow_session(session, show, every_s=every, once=once)
    except KeyboardInterrupt:
        return  # the recording goes on; only the watching ends
    if last is None:
        raise CommandInputError(f"{session}: nothing has been recorded yet")
    if png is not None and not as_json:
        print(f"trial {last.trial} of {last.trials}, {last.state}: {png}")


def draw_curve(values: NDArray[np.float64], width: int, height: int, braille: bool = True) -> list[str]:
    """Draw evenly spaced values (n,), n from 1, as ``height`` lines of ``width`` characters, from their least at the
    bottom to their largest at the top; each column spans minimum to maximum of its values.

    A constant is a line in the middle. Without ``braille``
    the signs are ``'``, ``.`` and ``:``, the upper, the lower and both halves of a cell.
    """
    import numpy as np  # start-up: 0.1 s that --help does not need

    across, down = (2, 4) if braille else (1, 2)
    columns, rows = across * width, down * height
    low, high = float(np.min(values)), float(np.max(values))
    span = high - low
    cells = np.zeros((height, width), dtype=int)
    edges = np.linspace(0, values.size, columns + 1)
    for column in range(columns):
        first = min(int(edges[column]), values.size - 1)
        part = values[first : max(int(np.ceil(edges[column + 1])), first + 1)]
        ends = np.array([part.max(), part.min()])
        level = (high - ends) / span if span > 0 else np.array([0.5, 0.5])
        top, bottom = np.minimum((level * rows).astype(int), rows - 1)
        for row in range(top, bottom + 1):
            dot = DOTS[row % 4][column % 2] if braille else 1 + row % 2
            cells[row // down, column // across] |= int(dot)
    if not braille:
        return ["".join(PLAIN[cell] for cell in line) for line in cells]
    return ["".join(chr(0x2800 + int(cell)) for cell in line) for line in cells]


def view_facts(view: LiveView) -> dict[str, Any]:
    """Facts of what a session shows now, as ``--json`` prints them: trial, state, samples, last raw force and its peak,
    N, last angle of each body, rad since the first sample."""
    from rig.session.trial_data import absent_bodies  # start-up: 0.4 s of h5py

    return {
        "trial": view.trial,
        "trials": view.trials,
        "state": view.state,
        "condition": view.condition,
        "samples": int(view.time_s.size),
        "time_s": float(view.time_s[-1]),
        "raw_force_n": float(view.raw_force_n[-1]),
        "raw_peak_force_n": float(view.raw_force_n.max()),
        "not_recorded": list(absent_bodies(view.names)),
        **{f"{name}_rad": float(view.angle_rad[-1, k]) for k, name in enumerate(view.names)},
    }


HEIGHT = 6  # lines of a curve: three of them and the title fit 24 lines


def view_text(view: LiveView, width: int, *, braille: bool = True) -> str:
    """Text for the terminal, lines of at most ``width`` characters: state of the recording, and curves over time of the
    raw force, N, and the angle of the last body, degrees (the hammer's, where it was recorded).

    Without ``braille`` the curves are drawn with signs that every terminal has.
    """
    import numpy as np  # start-up: 0.1 s that --help does not need

    from rig.session.trial_data import absent_bodies  # start-up: 0.4 s of h5py

    head = f"trial {view.trial} of {view.trials}  {view.state}" + (f"  {view.condition}" if view.condition else "")
    raw_n = view.raw_force_n
    lines = [f"{head}  t = {view.time_s[-1]:.2f} s  raw force {raw_n[-1]:.2f} N (peak {raw_n.max():.1f})"]
    curves = [("raw force, N", raw_n)]
    if view.names:
        turned = "  ".join(f"{name} {np.degrees(view.angle_rad[-1, k]):+.2f}" for k, name in enumerate(view.names))
        lines.append(f"turned: {turned} deg")
        curves.append((f"{view.names[-1]}, deg", np.degrees(view.angle_rad[:, -1])))
    if absent := absent_bodies(view.names):
        lines.append(f"not recorded: {', '.join(absent)}")
    drawn: list[str] = []
    for label, values in curves:
        drawn += [
            f"{label}: {values.min():.2f} to {values.max():.2f}"[:width],
            *draw_curve(values, width, HEIGHT, braille),
        ]
    return "\n".join([*(part for line in lines for part in textwrap.wrap(line, width)), *drawn])


def follow_session(
    session: Path,
    show: Callable[[LiveView], None],
    *,
    every_s: float,
    once: bool = False,
    wait: Callable[[float], None] = time.sleep,
) -> LiveView | None:
    """Call ``show`` with each new view of a session, looking every ``every_s``, until its plan is complete, its
    recording has ended or, with ``once``, after one look; return the last view, None where there was none."""
    from rig.session.live_view import SessionFollower  # start-up: 0.4 s of h5py

    follower = SessionFollower(session)
    seen: tuple[int, str, int] | None = None
    view: LiveView | None = None
    while True:
        view = follower.poll() or view
        if view is not None and (now := (view.trial, view.state, view.time_s.size)) != seen:
            show(view)
            seen = now
        if once or follower.has_ended or (view is not None and view.is_finished):
            return view
        wait(every_s)


def draw_view(path: Path, view: LiveView) -> None:
    """Write a PNG picture to ``path``, replaced whole: raw force, N, and angles of the recorded bodies, degrees, over
    time."""
    # start-up: 0.5 s that text needs not
    import numpy as np
    from matplotlib.figure import Figure

    from rig.session.trial_data import absent_bodies  # start-up: 0.4 s of h5py

    figure = Figure(figsize=(8.0, 5.0), layout="constrained")
    top, bottom = figure.subplots(2, 1, sharex=True)
    top.plot(view.time_s, view.raw_force_n, lw=0.8, color="C3")
    top.set(ylabel="Raw force (N)", title=f"trial {view.trial} of {view.trials}: {view.state} {view.condition}".strip())
    for k, name in enumerate(view.names):
        bottom.plot(view.time_s, np.degrees(view.angle_rad[:, k]), lw=0.9, label=name)
    absent = absent_bodies(view.names)
    bottom.set(xlabel="Time (s)", ylabel="Angle from rest (deg)")
    bottom.set_title(f"not recorded: {', '.join(absent)}" if absent else "", fontsize=9)
    if view.names:
        bottom.legend(fontsize=8)
    for axes in (top, bottom):
        axes.grid(alpha=0.3)
    with replace_when_complete(path) as part:
        figure.savefig(part, format="png", dpi=100)
