"""Presses of a felt and what each law makes of them, on one sheet."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from model.felt.compare import LawComparison
from model.felt.pressing import Pressing
from model.files.figure_sheet import new_sheet


def draw(presses: Sequence[Pressing], found: LawComparison, title: str, path: str | Path) -> None:
    """Draw force over depth of every press under each law, and the misfits on presses left out.

    Parameters
    ----------
    presses : those compared
    found : the comparison
    title : for the sheet
    path : file to write, .svg, .pdf or .png

    Raises
    ------
    InputError : the file cannot be written

    Examples
    --------
    >>> import model
    >>> names = [f"presses/0.5mm_{speed}mm_per_s.csv" for speed in (2, 10, 50)]
    >>> presses = [model.felt.read_pressing(name) for name in names]
    >>> model.felt.figure.draw(presses, model.felt.compare_laws(presses), "contact02", "laws.svg")
    """
    with new_sheet(path, 3.6 * (len(found.fits) + 1), 4.2) as sheet:
        *panels, last = sheet.subplots(1, len(found.fits) + 1)
        for axes, fit, overall in zip(panels, found.fits, found.overall, strict=True):
            for k, press in enumerate(presses):
                answer = fit.law.response(press.time_s, press.depth_m).force_n
                axes.plot(1e3 * press.depth_m, press.force_n, color="0.6", lw=2.2, label="measured" if k == 0 else None)
                axes.plot(1e3 * press.depth_m, answer, color="k", lw=0.8, label="law" if k == 0 else None)
            axes.set_title(f"{fit.kind}: off by {overall:.1%} where left out", fontsize="medium")
            axes.set_xlabel("displacement, mm")
            axes.set_xlim(left=0.0)
            axes.grid(alpha=0.3)
            axes.legend(fontsize="small", loc="upper left")
        panels[0].set_ylabel(f"{title}: force, N")
        order = np.argsort([press.peak_n for press in presses], kind="stable")
        for k, fit in enumerate(found.fits):
            last.plot(100.0 * found.held_out[k][order], np.arange(len(order)), "os^Dv"[k % 5], label=fit.kind)
        last.plot(100.0 * found.noise[order], np.arange(len(order)), "|", color="0.5", label="noise of the force")
        names = [f"{1e3 * presses[i].speed_m_per_s:.3g} mm/s, {presses[i].peak_n:.3g} N" for i in order]
        last.set(
            xscale="log", xlabel="misfit where left out, % of the peak", yticks=np.arange(len(order)), yticklabels=names
        )
        last.xaxis.set_major_formatter("{x:g}")
        last.xaxis.set_minor_formatter("")
        last.grid(alpha=0.3)
        last.legend(fontsize="small", loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2, frameon=False)
