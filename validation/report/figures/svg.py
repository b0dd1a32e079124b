"""Turning a matplotlib figure into small, self-contained, accessible inline SVG; thinning curves for it.

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

from validation.conventions import Array

COLUMNS = 560
STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",
    "svg.hashsalt": "pianorig",
    "font.family": "sans-serif",
    "font.size": 9,
    "axes.linewidth": 0.8,
    "path.simplify": True,
}


def decimate(time: Array, values: Array, *, columns: int = COLUMNS, keep: str = "both") -> tuple[Array, Array]:
    """Thin a curve to the smallest and largest value of each pixel column, so that no spike is lost.

    Parameters
    ----------
    time, values : (n,) arrays
        NaN breaks the line and is kept as a break.
    columns : int
    keep : {"both", "min", "max"}
        One value per column for the edge of a band.
    """
    t, v = np.asarray(time, dtype=float), np.asarray(values, dtype=float)
    per = 2 if keep == "both" else 1
    if t.size <= per * columns:
        return t, v
    size = int(np.ceil(t.size / columns))
    pad = (-t.size) % size
    blocks = np.concatenate([v, np.full(pad, v[-1])]).reshape(-1, size)
    starts = np.arange(blocks.shape[0]) * size
    gap = np.isnan(blocks).any(axis=1)
    low = starts + np.where(np.isnan(blocks), np.inf, blocks).argmin(axis=1)
    high = starts + np.where(np.isnan(blocks), -np.inf, blocks).argmax(axis=1)
    if keep != "both":
        index = np.minimum(low if keep == "min" else high, t.size - 1)
        out = v[index].copy()
        out[gap] = np.nan
        return t[np.minimum(starts + size // 2, t.size - 1)], out
    pair = np.sort(np.stack([low, high], axis=1), axis=1)
    index = np.minimum(pair.reshape(-1), t.size - 1)
    out = v[index].copy()
    out[np.repeat(gap, 2)] = np.nan
    return t[index], out


def time_panels(figure: Figure, key: str, start_s: float, end_s: float) -> str:
    """Places of the panels that show the whole window, as JSON in the units of the SVG, for the page's zoom.

    Known once the figure has been drawn: its layout is decided then.
    """
    width, height = (72 * float(v) for v in figure.get_size_inches())
    panels = []
    for i, axes in enumerate(figure.axes, start=1):
        if not np.allclose(axes.get_xlim(), (start_s, end_s), rtol=0, atol=1e-9):
            continue
        box = axes.get_position()
        panels.append(
            {
                "id": f"{key}-axes_{i}",
                "left": round(width * box.x0, 3),
                "right": round(width * box.x1, 3),
                "top": round(height * (1 - box.y1), 3),
                "bottom": round(height * (1 - box.y0), 3),
                "labelled": bool(axes.get_xlabel()),
            }
        )
    return json.dumps(panels, separators=(",", ":"))


def figure_svg(figure: Figure, key: str, title: str, description: str, window_s: tuple[float, float]) -> str:
    """SVG text of a figure for a page: role img, title and description, unique ids, no addresses.

    Panels that show ``window_s`` are named in the attribute ``data-panels``.
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
    head, body = text.split(">", 1)
    head = re.sub(r'\s(width|height)="[^"]*"', "", head)
    panels = html.escape(time_panels(figure, key, *window_s))
    label = (
        f'{head} role="img" data-panels="{panels}" aria-labelledby="{key}-title {key}-desc">'
        f'<title id="{key}-title">{html.escape(title)}</title>'
        f'<desc id="{key}-desc">{html.escape(description)}</desc>'
    )
    return re.sub(r"\n\s*\n+", "\n", label + body)
