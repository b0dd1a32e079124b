"""Figure sheets: an empty sheet without a window, and its file; for everything of ``model`` that uses matplotlib."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from model.errors import InputError
from model.files.atomic_write import whole_file

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ENDINGS = (".svg", ".pdf", ".png")


def check_ending(path: Path) -> None:
    """Refuse a file whose ending is not in `ENDINGS`."""
    if path.suffix not in ENDINGS:
        raise InputError(f"{path}: ending found {path.suffix!r}, allowed {', '.join(ENDINGS)}")


def new_sheet(width_inch: float, height_inch: float) -> Figure:
    """An empty sheet without a window."""
    # start-up: matplotlib costs 0.3 s, and commands check the ending of a file long before they draw
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width_inch, height_inch), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def save_sheet(figure: Figure, path: Path) -> None:
    """Write a sheet to ``path`` (.svg, .pdf or .png); ``InputError`` where that is not possible."""
    check_ending(path)
    with whole_file(path) as part:
        figure.savefig(part, format=path.suffix[1:])
