"""Turning a matplotlib figure into small, self-contained, accessible inline SVG.

Conventions: every id carries the figure's key, so that many figures live on one page; no name space, document
type or metadata is left, so the page holds no address of any kind.
"""

from __future__ import annotations

import html
import io
import json
import re
import warnings
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",
    "svg.hashsalt": "pianorig",
    "font.family": "sans-serif",
    "font.size": 9,
    "axes.linewidth": 0.8,
    "path.simplify": True,
}


def panels(figure: Figure, key: str, start_s: float, end_s: float) -> str:
    """Places and limits of the panels that show the whole window, as JSON in the units of the SVG, for the scripts.

    Known once the figure has been drawn: its layout is decided then.
    """
    width, height = (72 * float(v) for v in figure.get_size_inches())
    found: list[dict[str, object]] = []
    for i, axes in enumerate(figure.axes, start=1):
        if not np.allclose(axes.get_xlim(), (start_s, end_s), rtol=0, atol=1e-9):
            continue
        box = axes.get_position()
        found.append(
            {
                "id": f"{key}-axes_{i}",
                "left": round(width * box.x0, 3),
                "right": round(width * box.x1, 3),
                "top": round(height * (1 - box.y1), 3),
                "bottom": round(height * (1 - box.y0), 3),
                "labelled": bool(axes.get_xlabel()),
                "x": [round(float(v), 6) for v in axes.get_xlim()],
                "y": [round(float(v), 6) for v in axes.get_ylim()],
            }
        )
    return json.dumps(found, separators=(",", ":"))


def _shortened(path: str) -> str:
    """A path with two decimals, a hundredth of a point, and no blank beside a command."""
    return re.sub(r"\s*([MLCQZ])\s*", r"\1", re.sub(r"(\.\d\d)\d+", r"\1", path))


def figure_svg(
    figure: Figure, key: str, title: str, description: str, window_s: tuple[float, float] | None = None
) -> str:
    """SVG text of a figure for a page: role img, title and description, unique ids, no addresses.

    Where ``window_s`` is given, scripts may zoom: panels that show it are named in the attribute ``data-panels``.
    """
    with rc_context(STYLE):
        FigureCanvasSVG(figure)
        buffer = io.StringIO()
        with warnings.catch_warnings():
            # letters are drawn with the reader's fonts; what ours lacks matters for widths only
            warnings.filterwarnings("ignore", r"Glyph \d+ .*missing from")
            figure.savefig(buffer, format="svg", metadata={"Date": None}, transparent=True)
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.S)
    text = re.sub(r'\s+xmlns(:\w+)?="[^"]*"', "", text)
    text = text.replace("xlink:href", "href")
    text = re.sub(r'\bid="([^"]+)"', rf'id="{key}-\1"', text)
    text = re.sub(r'href="#([^"]+)"', rf'href="#{key}-\1"', text)
    text = re.sub(r"url\(#([^)]+)\)", rf"url(#{key}-\1)", text)
    text = re.sub(r'\bd="([^"]*)"', lambda path: f'd="{_shortened(path[1])}"', text)
    head, body = text.split(">", 1)
    head = re.sub(r'\s(width|height)="[^"]*"', "", head)
    zoomed = ""
    if window_s is not None:
        zoomed = f' data-panels="{html.escape(panels(figure, key, *window_s))}"'
    label = (
        f'{head} role="img"{zoomed} aria-labelledby="{key}-title {key}-desc">'
        f'<title id="{key}-title">{html.escape(title)}</title>'
        f'<desc id="{key}-desc">{html.escape(description)}</desc>'
    )
    return re.sub(r"\n\s*\n+", "\n", label + body)
