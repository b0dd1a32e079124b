"""A matplotlib figure without a window, saved as a PNG that is whole or absent."""

from __future__ import annotations

from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from rig.storage.atomic_write import replace_when_complete


def new_figure(width_in: float, height_in: float) -> Figure:
    """An empty figure."""
    figure = Figure(figsize=(width_in, height_in), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def save_png(figure: Figure, path: Path, dpi: int) -> None:
    """Write the figure, whole or not at all."""
    with replace_when_complete(path) as part:
        figure.savefig(part, format="png", dpi=dpi)
