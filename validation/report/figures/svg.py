"""Charts as small, self-contained, accessible inline SVG: panels with lines, bands, ticks and a legend.

Conventions: lengths in points, y down; every id carries the chart's key, so that many charts live on one page; a path
has at most the points that `decimate` leaves; what moves when the time axis is zoomed lies in a group ``moving``.
"""

from __future__ import annotations

import html
import json
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from validation.conventions import Array
from validation.curves.marks import Mark
from validation.curves.style import BAND_COLUMNS, BLACK, COLUMNS, GREY, ORANGE, decimate
from validation.events.crossings import find_runs

FONT, LEGEND_FONT = 9.0, 8.0
CHARACTER = 0.58  # mean width of a character, in its font's size: choice, wider than most sans-serif fonts
HANDLE, HANDLE_GAP, ENTRY_GAP, LEGEND_LINE = 20.0, 5.0, 16.0, 13.0
MARGIN = 0.05  # of the range of a panel, above and below its curves: choice
STEPS = (1.0, 2.0, 2.5, 5.0, 10.0)
MOST_INTERVALS = 9  # between ticks
GRID, FRAME, FAINT = "#DDDDDD", "#1a1a1a", "#777777"
HATCH = 5.0


@dataclass(frozen=True)
class Pen:
    """How a line is drawn: colour, width in points, dashes in widths, opacity."""

    color: str
    width: float = 1.0
    dashes: tuple[float, ...] = ()
    opacity: float = 1.0

    @property
    def attributes(self) -> str:
        """SVG attributes."""
        text = f'stroke="{self.color}" stroke-width="{self.width:g}"'
        if self.dashes:
            text += f' stroke-dasharray="{" ".join(f"{self.width * d:.3g}" for d in self.dashes)}"'
        return text + (f' stroke-opacity="{self.opacity:g}"' if self.opacity < 1 else "")


@dataclass(frozen=True)
class _Shape:
    """A path in data units: a line, or an area where it has an upper edge."""

    x: Array
    y: Array
    attributes: str
    name: str = ""
    upper: Array | None = None
    is_dotted: bool = False


@dataclass
class Panel:
    """Axes of a chart. ``x``, ``y``: limits, from the data where left out; ``note`` stands in its middle."""

    title: str = ""
    is_bold: bool = False
    x_label: str = ""
    y_label: str = ""
    x: tuple[float, float] | None = None
    y: tuple[float, float] | None = None
    least: float | None = None
    is_log: bool = False
    has_integers: bool = False
    intervals: int = MOST_INTERVALS
    note: str = ""
    marks: Sequence[Mark] = ()
    has_letters: bool = False
    legend: dict[str, str] = field(default_factory=dict)
    shapes: list[_Shape] = field(default_factory=list)
    areas: list[_Shape] = field(default_factory=list)

    def line(self, x: Array, y: Array, pen: Pen, label: str = "", *, name: str = "", columns: int = COLUMNS) -> None:
        """Draw a thinned curve, with gaps where it is NaN; ``name``: its id for the page's scripts."""
        x, y = decimate(x, y, columns=columns)
        self.shapes.append(_Shape(x, y, f'fill="none" {pen.attributes}', name))
        if label:
            self.legend.setdefault(label, f'<path d="M0 0H{HANDLE:g}" fill="none" {pen.attributes}/>')

    def band(
        self, x: Array, low: Array, high: Array, look: tuple[str, float] = (GREY, 0.35), label: str = "", *,
        name: str = "", columns: int = BAND_COLUMNS,
    ) -> None:  # fmt: skip
        """Add the area between the curves ``low`` and ``high`` (n,) over ``x`` (n,), in colour and opacity ``look``,
        with gaps at NaN; ``label``: in the legend, ``name``: its id for scripts, ``columns``: places it is thinned to.
        """
        if not np.isfinite(low + high).any():
            return
        at, lower = decimate(x, low, columns=columns, keep="min")
        _, upper = decimate(x, high, columns=columns, keep="max")
        fill = f'fill="{look[0]}" fill-opacity="{look[1]:g}"'
        self.areas.append(_Shape(at, lower, fill, name, upper))
        self._show_area(label, fill)

    def shade(self, start: float, end: float, label: str = "", look: tuple[str, float] | None = None) -> None:
        """Shade the whole height between two places; hatched where no colour and opacity are given."""
        fill = f'fill="{look[0]}" fill-opacity="{look[1]:g}"' if look else 'fill="url(#hatch)"'
        edge = np.array([start, end])
        self.areas.append(_Shape(edge, np.full(2, -np.inf), fill, "", np.full(2, np.inf)))
        self._show_area(label, fill)

    def level(self, y: float, pen: Pen) -> None:
        """Draw a horizontal line over the whole width."""
        self.shapes.append(_Shape(np.array([-np.inf, np.inf]), np.array([y, y]), f'fill="none" {pen.attributes}'))

    def points(self, x: Array, y: Array, color: str, size: float, *, is_square: bool = False) -> None:
        """Draw dots or squares."""
        cap = "square" if is_square else "round"
        look = f'fill="none" stroke="{color}" stroke-width="{size:g}" stroke-linecap="{cap}"'
        self.shapes.append(_Shape(x, y, look, is_dotted=True))

    def _show_area(self, label: str, fill: str) -> None:
        if label:
            self.legend.setdefault(label, f'<rect y="-3.5" width="{HANDLE:g}" height="7" {fill}/>')

    def y_limits(self) -> tuple[float, float]:
        """Lower and upper limit of the vertical axis: those set, else from all curves, bands and levels with a margin
        of 5 %; (0, 1) without any, (0.1, 1) on a logarithmic axis."""
        if self.y is not None:
            return self.y
        ends = [s.y for s in (*self.shapes, *self.areas)] + [s.upper for s in self.areas if s.upper is not None]
        known = np.concatenate([np.empty(0), *ends])
        known = known[np.isfinite(known) & ((known > 0) | (not self.is_log))]
        if not known.size:
            return (0.1, 1.0) if self.is_log else (0.0, 1.0)
        low, high = (
            float(v) for v in (np.log10(known) if self.is_log else known).take([known.argmin(), known.argmax()])
        )
        margin = MARGIN * (high - low) or 0.5
        low, high = low - margin, high + margin
        if self.is_log:
            return 10.0**low, 10.0**high
        return (low if self.least is None else self.least), high


@dataclass
class Chart:
    """Panels in rows and columns on a sheet of this size; ``rows``: their heights in proportion.

    Time axes are shared: only the lowest row labels its ticks.
    """

    width: float
    height: float
    rows: Sequence[float] = (1.0,)
    columns: int = 1
    left: float = 47.5
    right: float = 9.0
    top: float = 9.0
    bottom: float = 33.0
    between: float = 17.0
    beside: float = 44.0
    font: float = FONT
    is_shared: bool = True

    def __post_init__(self) -> None:
        self.grid = [[Panel() for _ in range(self.columns)] for _ in self.rows]

    @property
    def panels(self) -> list[Panel]:
        """All panels, row after row."""
        return [panel for row in self.grid for panel in row]

    def svg(self, key: str, title: str, description: str, window_s: tuple[float, float] | None = None) -> str:
        """SVG element as text for a page, with title and description for screen readers and ids led by ``key``;
        ``window_s``: begin and end of the time axis of panels without their own, which scripts may then zoom.

        Panels that scripts may zoom stand in the attribute ``data-panels``, with their frames and limits.
        """
        entries: dict[str, str] = {}
        for panel in self.panels:
            entries |= {label: handle for label, handle in panel.legend.items() if label not in entries}
        legend, legend_height = _legend(entries, self.width)
        zoomed: list[dict[str, object]] = []
        body = [legend]
        for i, (panel, box, is_lowest) in enumerate(self._frames(legend_height), start=1):
            x, y = panel.x or window_s or _extent(panel), panel.y_limits()
            is_zoomed = window_s is not None and panel.x is None
            frame = _Frame(f"{key}-axes_{i}", *box, x, y, panel.is_log, self.font, is_zoomed)
            body.append(frame.draw(panel, is_lowest))
            if is_zoomed:
                zoomed.append(frame.frame_data() | {"labelled": bool(panel.x_label)})
        text = "".join(body)
        if "url(#hatch)" in text:
            text = text.replace("url(#hatch)", f"url(#{key}-hatch)") + (
                f'<pattern id="{key}-hatch" width="{HATCH:g}" height="{HATCH:g}" patternUnits="userSpaceOnUse" '
                f'patternTransform="rotate(45)"><rect width="{HATCH:g}" height="{HATCH:g}" fill="{ORANGE}" '
                f'fill-opacity="0.25"/><path d="M0 0V{HATCH:g}" stroke="{BLACK}" stroke-opacity="0.35"/></pattern>'
            )
        data = html.escape(json.dumps(zoomed, separators=(",", ":")))
        scripted = "" if window_s is None else f' data-panels="{data}"'
        return (
            f'<svg viewBox="0 0 {self.width:g} {self.height:g}" role="img"{scripted} font-family="sans-serif" '
            f'font-size="{self.font:g}" aria-labelledby="{key}-title {key}-desc">'
            f'<title id="{key}-title">{html.escape(title)}</title>'
            f'<desc id="{key}-desc">{html.escape(description)}</desc>{text}</svg>'
        )

    def file_text(self, key: str, title: str, description: str) -> str:
        """The same for a file of its own, on white and with the title above."""
        text = self.svg(key, title, description).replace("<svg ", '<svg xmlns="http://www.w3.org/2000/svg" ', 1)
        head, end, body = text.partition("</desc>")
        shown = f'<rect width="100%" height="100%" fill="#fff"/><text x="{self.left:g}" y="16">{escape(title)}</text>'
        return f"{head}{end}{shown}{body}\n"

    def _frames(self, legend_height: float) -> Iterator[tuple[Panel, tuple[float, float, float, float], bool]]:
        """Yield each panel, row after row, with left, right, top and bottom of its frame, points, and whether its time
        axis is labelled; ``legend_height``: points kept free above."""
        top = self.top + legend_height
        inside = self.height - top - self.bottom - self.between * (len(self.rows) - 1)
        width = (self.width - self.left - self.right - self.beside * (self.columns - 1)) / self.columns
        for i, (row, part) in enumerate(zip(self.grid, self.rows, strict=True)):
            bottom = top + inside * part / sum(self.rows)
            for j, panel in enumerate(row):
                left = self.left + j * (width + self.beside)
                yield panel, (left, left + width, top, bottom), i == len(self.rows) - 1 or not self.is_shared
            top = bottom + self.between


def _extent(panel: Panel) -> tuple[float, float]:
    ends = np.concatenate([np.empty(0), *(shape.x for shape in panel.shapes)])
    known = ends[np.isfinite(ends)]
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 1.0)
    return (low, high) if high > low else (low - 0.5, low + 0.5)


@dataclass(frozen=True)
class _Frame:
    """Where a panel stands, and what its edges are in data units."""

    id: str
    left: float
    right: float
    top: float
    bottom: float
    x: tuple[float, float]
    y: tuple[float, float]
    is_log: bool
    font: float
    is_zoomed: bool

    def frame_data(self) -> dict[str, object]:
        """Frame and limits for the page's scripts."""
        frame = {name: round(getattr(self, name), 3) for name in ("left", "right", "top", "bottom")}
        return {"id": self.id, **frame, "x": [round(v, 6) for v in self.x], "y": [round(v, 6) for v in self.y]}

    def x_points(self, x: Array) -> Array:
        """Horizontal places in the chart, points, of values ``x`` in the axis's unit; infinite ones at the edges."""
        share = (np.clip(x, *self.x) if np.isinf(x).any() else x) - self.x[0]
        return np.asarray(self.left + (self.right - self.left) * share / (self.x[1] - self.x[0]))

    def y_points(self, y: Array) -> Array:
        """Vertical places in the chart, points, downwards, of values ``y`` in the panel's unit; infinite values lie at
        the edges, NaN and, on a logarithmic axis, values of 0 or less are NaN."""
        low, high = self.y
        y = np.clip(y, low, high) if np.isinf(y).any() else y
        if self.is_log:
            low, high = math.log10(low), math.log10(high)
            y = np.log10(np.where(y > 0, y, np.nan))
        return np.asarray(self.bottom - (self.bottom - self.top) * (y - low) / (high - low))

    def draw(self, panel: Panel, is_lowest: bool) -> str:
        """SVG text of a whole panel in this frame: curves, frame, ticks, marks, title and labels; ``is_lowest``:
        whether the time axis has numbers."""
        clip, width, height = f"{self.id}-clip", self.right - self.left, self.bottom - self.top
        curves = "".join(self._path(shape) for shape in (*panel.areas, *panel.shapes))
        box = f'x="{self.left:.2f}" y="{self.top:.2f}" width="{width:.2f}" height="{height:.2f}"'
        parts = [
            f'<g id="{self.id}"><clipPath id="{clip}"><rect {box}/></clipPath>',
            f'<g class="x-ticks">{self._x_ticks(panel, is_lowest)}</g>{self._y_ticks(panel)}',
            f'<g clip-path="url(#{clip})"><g class="moving">{curves}</g></g>',
            f'<rect class="frame" {box} fill="none" stroke="{FRAME}" stroke-width="0.8"/>',
            self._marks(panel),
        ]
        middle_x, middle_y = 0.5 * (self.left + self.right), 0.5 * (self.top + self.bottom)
        if panel.title:
            weight = ' font-weight="bold"' if panel.is_bold else ""
            parts.append(f'<text x="{self.left:.2f}" y="{self.top - 4:.2f}"{weight}>{escape(panel.title)}</text>')
        if panel.x_label:
            down = self.bottom + 2.6 * self.font
            parts.append(
                f'<text x="{middle_x:.2f}" y="{down:.2f}" text-anchor="middle">{set_math(panel.x_label)}</text>'
            )
        if panel.y_label:
            place = f"translate({self.left - 36:.2f} {middle_y:.2f}) rotate(-90)"
            parts.append(f'<text transform="{place}" text-anchor="middle">{set_math(panel.y_label)}</text>')
        if panel.note:
            parts.append(
                f'<text x="{middle_x:.2f}" y="{middle_y + 3:.2f}" text-anchor="middle" fill="#4a4a4a">'
                f"{escape(panel.note)}</text>"
            )
        return "".join(parts) + "</g>"

    def _path(self, shape: _Shape) -> str:
        """SVG path of a shape: a line, dots, or the area up to its upper edge, with gaps at NaN; empty text for a shape
        with neither a point nor a name."""
        x, y = self.x_points(shape.x), self.y_points(shape.y)
        if shape.upper is not None:
            d = "".join(
                f"M{_pairs(np.concatenate([x[run], x[run][::-1]]), np.concatenate([y[run], upper[run][::-1]]))}Z"
                for upper in (self.y_points(shape.upper),)
                for run in _finite_runs(y + upper)
            )
        elif shape.is_dotted:
            d = "".join(f"M{a:.2f} {b:.2f}h0" for a, b in zip(x, y, strict=True) if math.isfinite(b))
        else:
            d = "".join(f"M{_pairs(x[run], y[run])}" for run in _finite_runs(y))
        if not d and not shape.name:
            return ""
        named = f' id="{self.id.rpartition("-")[0]}-{shape.name}"' if shape.name else ""
        effect = ' vector-effect="non-scaling-stroke"' if self.is_zoomed else ""
        return f'<path{named} d="{d}" {shape.attributes}{effect}/>'

    def _x_ticks(self, panel: Panel, is_lowest: bool) -> str:
        """SVG text of grid lines and ticks of the horizontal axis, with numbers where ``is_lowest``."""
        most = min(panel.intervals, max(1, int((self.right - self.left) / (3 * self.font))))
        text = ""
        for value, label in linear_ticks(*self.x, most, has_integers=panel.has_integers):
            x = float(self.x_points(np.array(value)))
            text += f'<path d="M{x:.2f} {self.bottom:.2f}V{self.top:.2f}" stroke="{GRID}" stroke-width="0.6"/>'
            text += f'<path d="M{x:.2f} {self.bottom:.2f}v3.5" stroke="{FRAME}" stroke-width="0.8"/>'
            if is_lowest:
                down = self.bottom + 4.5 + self.font
                text += f'<text x="{x:.2f}" y="{down:.2f}" text-anchor="middle">{label}</text>'
        return text

    def _y_ticks(self, panel: Panel) -> str:
        """SVG text of grid lines, ticks and labels of the vertical axis; empty where a note stands in the panel."""
        if panel.note:
            return ""
        most = min(panel.intervals, max(1, int((self.bottom - self.top) / (1.6 * self.font))))
        text = ""
        for value, label in log_ticks(*self.y) if self.is_log else linear_ticks(*self.y, most):
            y = float(self.y_points(np.array(value)))
            text += f'<path d="M{self.left:.2f} {y:.2f}H{self.right:.2f}" stroke="{GRID}" stroke-width="0.6"/>'
            text += f'<path d="M{self.left:.2f} {y:.2f}h-3.5" stroke="{FRAME}" stroke-width="0.8"/>'
            text += f'<text x="{self.left - 5.5:.2f}" y="{y + 0.35 * self.font:.2f}" text-anchor="end">{label}</text>'
        return text

    def _marks(self, panel: Panel) -> str:
        """SVG text of a vertical line at every mark of a panel inside its time axis, solid at positions of the thesis
        and dotted at events; the former have their letters above where the panel says so. Empty without any."""
        text = ""
        for mark in panel.marks:
            if not self.x[0] <= mark.time_s <= self.x[1]:
                continue
            x = float(self.x_points(np.array(mark.time_s)))
            pen = Pen(BLACK, 0.8) if mark.position else Pen(FAINT, 0.6, (1.5, 2.5))
            text += f'<path d="M{x:.2f} {self.top:.2f}V{self.bottom:.2f}" fill="none" {pen.attributes}/>'
            if mark.position and panel.has_letters:
                place = f'x="{x:.2f}" y="{self.top - 3:.2f}" text-anchor="middle" font-weight="bold"'
                text += f"<text {place}>{escape(mark.label)}</text>"
        return f'<g class="marks">{text}</g>' if text else ""


def linear_ticks(low: float, high: float, most: int, *, has_integers: bool = False) -> list[tuple[float, str]]:
    """Round values from ``low`` to ``high``, in steps of 1, 2, 2.5 or 5 times a power of ten that make ``most``
    intervals at most, each with its label; steps are whole numbers where ``has_integers``."""
    rough = max((high - low) / most, 1e-300)
    power = 10.0 ** math.floor(math.log10(rough))
    step = next((m * power for m in STEPS if m * power >= rough * (1 - 1e-9)), 10 * power)
    if has_integers:
        step = float(max(1, math.ceil(step - 1e-9)))
    digits = next(d for d in range(310) if math.isclose(round(step, d), step, rel_tol=1e-9))
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [(k * step, f"{k * step:.{digits}f}".replace("-", "−")) for k in range(first, last + 1)]


def log_ticks(low: float, high: float) -> list[tuple[float, str]]:
    """Powers of ten from ``low`` to ``high``, both above 0, each with its label; with 2 and 5 times them where fewer
    than two lie there."""
    powers = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    for factors in ((1,), (1, 2, 5)):
        found = [f * 10.0**p for p in powers for f in factors if low <= f * 10.0**p <= high]
        if len(found) > 1:
            break
    return [(value, f"{value:g}") for value in found]


def escape(text: str) -> str:
    """Text from a session or model, letter by letter, nothing unprintable."""
    return html.escape("".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in text))


def set_math(label: str) -> str:
    r"""Label as SVG text, escaped; in formulas between dollar signs ``\theta``, subscripts of one letter and minus
    signs are typeset."""
    parts = html.escape(label).split("$")
    for i in range(1, len(parts), 2):
        formula = parts[i].replace(r"\theta", "θ").replace("-", "−")
        lowered = r'\1<tspan font-size="70%" dy="2">\2</tspan><tspan dy="-2">&#8203;</tspan>'
        parts[i] = re.sub(r"(\w)_(\w)", lowered, formula)
    return "".join(parts)


def _finite_runs(values: Array) -> list[slice]:
    return [slice(first, end) for first, end in find_runs(np.isfinite(values)).tolist()]


def _pairs(x: Array, y: Array) -> str:
    """Points of a path with two decimals, a hundredth of a point."""
    texts = json.dumps(np.round(np.column_stack([x, y]), 2).ravel().tolist(), separators=(" ", ":"))
    return texts[1:-1].replace(".0 ", " ")


def _legend(entries: dict[str, str], width: float) -> tuple[str, float]:
    """SVG text of the legend above all panels, centred in ``width`` points, in as many lines as it needs, and its
    height, points (0 without ``entries``); ``entries``: label → SVG of its sample."""
    lines: list[list[tuple[float, str, str]]] = [[]]
    filled = 0.0
    for label, handle in entries.items():
        own = HANDLE + HANDLE_GAP + CHARACTER * LEGEND_FONT * len(label) + ENTRY_GAP
        if filled + own > width and lines[-1]:
            lines.append([])
            filled = 0.0
        lines[-1].append((own, label, handle))
        filled += own
    text = ""
    for i, line in enumerate(lines if entries else []):
        x, y = 0.5 * (width - sum(own for own, *_ in line) + ENTRY_GAP), 10.0 + LEGEND_LINE * i
        for own, label, handle in line:
            text += f'<g transform="translate({x:.2f} {y - 3:.2f})">{handle}</g>'
            place = f'x="{x + HANDLE + HANDLE_GAP:.2f}" y="{y:.2f}" font-size="{LEGEND_FONT:g}"'
            text += f"<text {place}>{escape(label)}</text>"
            x += own
    return text, LEGEND_LINE * len(lines) if entries else 0.0
