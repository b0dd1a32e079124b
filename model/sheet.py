"""Figure sheets on disk, whole or absent: shared by everything of ``model`` that draws with matplotlib.

matplotlib is imported when a sheet is begun, never before.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from .errors import InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ENDINGS = (".svg", ".pdf", ".png")


def check_ending(path: Path) -> None:
    """Refuse a file whose ending is none of `ENDINGS`."""
    if path.suffix not in ENDINGS:
        raise InputError(f"{path}: ending found {path.suffix!r}, allowed {', '.join(ENDINGS)}")


def new_sheet(width_inch: float, height_inch: float) -> Figure:
    """An empty sheet without a window."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width_inch, height_inch), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def save_sheet(figure: Figure, path: Path) -> None:
    """Write a sheet to ``path`` (.svg, .pdf or .png); ``InputError`` where that is not possible."""
    check_ending(path)
    part = path.with_name(f".{path.stem}.{os.getpid()}.part{path.suffix}")
    try:
        figure.savefig(part)
        os.replace(part, path)
    except OSError as problem:
        raise InputError(f"{path}: cannot be written ({problem.strerror}); choose another file") from None
    finally:
        part.unlink(missing_ok=True)
