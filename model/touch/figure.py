"""One sheet that compares the touch of several actions: force over dip, hammer speed over force."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from model.files.figure_sheet import new_sheet
from model.touch.measure import Touch


def draw(feels: Sequence[Touch], path: str | Path) -> None:
    """Write force over dip, hammer speed over force and the fastest repetition of several actions to ``path`` (.svg,
    .pdf or .png), in place of a file that is there.

    Parameters
    ----------
    feels : one per action
    path : file to write, .svg, .pdf or .png

    Examples
    --------
    >>> import model
    >>> model.touch.figure.draw([model.measure_touch(model.load_action(), forces_n=[5.0, 10.0])], "touch.svg")
    """
    with new_sheet(path, 10.0, 4.2) as figure:
        press, blow = figure.subplots(1, 2)
        for i, one in enumerate(feels):
            color = f"C{i}"
            (dip, force), (dip_up, force_up) = one.weights.curve()
            press.plot(1e3 * dip, force, color=color, label=f"{one.name}, down")
            press.plot(1e3 * dip_up, force_up, color=color, linestyle="--", label=f"{one.name}, up")
            short = np.isnan(one.hammer_m_per_s)
            label = f"{one.name}, up to {one.repetition_hz:.1f} blows/s"
            if np.isnan(one.repetition_hz):
                label = f"{one.name}, repeats at no rate tried"
            blow.plot(one.blow_n, one.hammer_m_per_s, color=color, marker="o", markersize=4, label=label)
            if short.any():
                blow.plot(one.blow_n[short], np.zeros(short.sum()), color=color, marker="x", linestyle="none")
        press.set(xlabel="key dip, mm", ylabel="force at the key front, N", title="Slow press and release")
        blow.set(
            xlabel="force of the blow, N",
            ylabel="hammer speed at the string, m/s",
            title="Blows (x: string not reached)",
        )
        blow.set_xscale("log")
        ticks = sorted({float(f) for one in feels for f in one.blow_n})
        blow.set_xticks(ticks, [f"{t:g}" for t in ticks])
        blow.minorticks_off()
        blow.set_ylim(bottom=0.0)
        for axes in (press, blow):
            axes.grid(alpha=0.3)
            axes.legend(fontsize="small")
