"""Figure sheets: an empty sheet without a window, and its file; for everything of ``model`` that uses matplotlib."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from model.errors import InputError
from model.files.atomic_write import whole_file

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ENDINGS = (".svg", ".pdf", ".png")


@contextmanager
def new_sheet(path: str | Path, width_inch: float, height_inch: float) -> Iterator[Figure]:
    """Yield an empty figure without a window; when the block ends it is written to ``path`` (.svg, .pdf or .png), in
    place of a file that is there."""
    target = Path(path)
    if target.suffix not in ENDINGS:
        raise InputError(f"{target}: ending found {target.suffix!r}, allowed {', '.join(ENDINGS)}")
    # start-up: matplotlib costs 0.3 s
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width_inch, height_inch), layout="constrained")
    FigureCanvasAgg(figure)
    yield figure
    with whole_file(target) as part:
        figure.savefig(part, format=target.suffix[1:])
