"""Presses of a felt and what each law makes of them, on one sheet."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from model.felt.fit import LawFit
from model.felt.pressing import Pressing
from model.files.figure_sheet import new_sheet


def draw(presses: Sequence[Pressing], fits: Sequence[LawFit], title: str, path: str | Path) -> None:
    """Write a figure to ``path`` (.svg, .pdf or .png), replacing a file: for each law fitted (``fits``) a panel with
    measured force over depth of all ``presses`` and what the law gives for each.

    Parameters
    ----------
    presses : those fitted
    fits : one for each law
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
    >>> fits = [model.felt.fit_law(kind, presses) for kind in ("hunt-crossley", "hysteresis")]
    >>> model.felt.figure.draw(presses, fits, "contact02", "laws.svg")
    """
    with new_sheet(path, 3.6 * len(fits), 4.2) as sheet:
        panels = sheet.subplots(1, len(fits), squeeze=False)[0]
        for axes, fit in zip(panels, fits, strict=True):
            for k, press in enumerate(presses):
                answer = fit.law.response(press.time_s, press.depth_m).force_n
                axes.plot(1e3 * press.depth_m, press.force_n, color="0.6", lw=2.2, label="measured" if k == 0 else None)
                axes.plot(1e3 * press.depth_m, answer, color="k", lw=0.8, label="law" if k == 0 else None)
            axes.set_title(f"{fit.kind}: held-out error {fit.typical_held_out:.1%}", fontsize="medium")
            axes.set_xlabel("displacement, mm")
            axes.set_xlim(left=0.0)
            axes.grid(alpha=0.3)
            axes.legend(fontsize="small", loc="upper left")
        panels[0].set_ylabel(f"{title}: force, N")
