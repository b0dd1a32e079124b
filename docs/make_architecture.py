"""Draw `docs/images/architecture.svg` from the imports: packages, their subpackages, and which of them import which.

Run after moving or adding a folder:  python docs/make_architecture.py
A test redraws it and compares, so that the picture cannot become outdated. An arrow points from a subpackage to one
that it imports; arrows implied by others (A → B → C makes A → C redundant) are omitted. Subpackages are drawn above
what they import.
"""

from __future__ import annotations

import ast
from itertools import pairwise
from pathlib import Path

import grimp

ROOT = Path(__file__).parents[1]
PICTURE = ROOT / "docs" / "images" / "architecture.svg"
PAGE = ROOT / "docs" / "architecture.md"
MARK = "<!-- below: made by docs/make_architecture.py from the docstrings of the folders -->"
ROWS = (("pianorig",), ("validation",), ("rig",), ("model", "vision"))
WIDTH, MARGIN = 1120, 16
ROOM_HEIGHT, LEVEL_GAP, ROOM_GAP, TITLE = 36, 26, 12, 30
DATA_FLOW = (
    "profile.toml",
    "rig",
    "session (raw, sealed)",
    "vision: angles",
    "model: prediction",
    "validation",
    "report",
)
COLOURS = {"pianorig": "#f3ead9", "validation": "#e3eef9", "rig": "#e6f4e6", "model": "#fbe5e1", "vision": "#efe6f6"}
TOP = "top level"

Box = tuple[float, float, float, float]


def rooms_of(graph: grimp.ImportGraph, package: str) -> dict[str, list[str]]:
    """Map each subpackage of a package, and its top level, to their modules."""
    rooms: dict[str, list[str]] = {}
    for child in sorted(graph.find_children(package)):
        below = sorted(graph.find_descendants(child))
        name = child.removeprefix(package + ".") if below else TOP
        rooms.setdefault(name, []).extend(below or [child])
    return rooms


def imports_between(graph: grimp.ImportGraph, package: str, rooms: dict[str, list[str]]) -> dict[str, set[str]]:
    """Map each subpackage to those of the same package that it imports, without arrows implied by others."""
    home = {module: room for room, modules in rooms.items() for module in modules}
    home |= {f"{package}.{room}": room for room in rooms if room != TOP}
    uses: dict[str, set[str]] = {room: set() for room in rooms}
    for module, room in home.items():
        for imported in graph.find_modules_directly_imported_by(module):
            if home.get(imported, room) != room:
                uses[room].add(home[imported])
    if TOP in uses:  # errors and entry points share the top level: it is drawn without arrows
        uses.pop(TOP)
        uses = {room: found - {TOP} for room, found in uses.items()}
    reach: dict[str, set[str]] = {}

    def reached(room: str) -> set[str]:
        if room not in reach:
            reach[room] = set().union(*({b} | reached(b) for b in uses[room])) if uses[room] else set()
        return reach[room]

    return {room: {b for b in found if not any(b in reached(c) for c in found - {b})} for room, found in uses.items()}


def levels(uses: dict[str, set[str]]) -> list[list[str]]:
    """Subpackages by level: each above everything it imports, the highest first."""
    height: dict[str, int] = {}

    def high(room: str) -> int:
        if room not in height:
            height[room] = 1 + max((high(b) for b in uses[room]), default=-1)
        return height[room]

    for room in uses:
        high(room)
    return [sorted(r for r in uses if height[r] == level) for level in sorted(set(height.values()), reverse=True)]


def draw_package(graph: grimp.ImportGraph, package: str, x: float, y: float, width: float) -> tuple[list[str], float]:
    """Return the SVG lines of one package, and its height."""
    rooms = rooms_of(graph, package)
    uses = imports_between(graph, package, rooms)
    rows = levels(uses)
    boxes: dict[str, Box] = {}
    for i, row in enumerate(rows):
        room_width = min(150.0, (width - ROOM_GAP * (len(row) + 1)) / len(row))
        left = x + (width - len(row) * room_width - (len(row) - 1) * ROOM_GAP) / 2
        for j, room in enumerate(row):
            top = y + TITLE + i * (ROOM_HEIGHT + LEVEL_GAP)
            boxes[room] = (left + j * (room_width + ROOM_GAP), top, room_width, ROOM_HEIGHT)
    height = TITLE + len(rows) * (ROOM_HEIGHT + LEVEL_GAP) - LEVEL_GAP + MARGIN
    total = len(graph.find_descendants(package))
    loose = ", ".join(m.rpartition(".")[2] for m in rooms.get(TOP, []))
    out = [
        f'<rect x="{x:g}" y="{y:g}" width="{width:g}" height="{height:g}" rx="8" fill="{COLOURS[package]}"/>',
        f'<text x="{x + 12:g}" y="{y + 20:g}"><tspan class="name">{package}/</tspan>'
        f'<tspan class="note" dx="8">{total} modules{"; top: " + loose if loose else ""}</tspan></text>',
    ]
    for room, found in sorted(uses.items()):
        out += [_arrow(boxes[room], boxes[other]) for other in sorted(found)]
    for room, (left, top, room_width, room_height) in sorted(boxes.items()):
        middle = left + room_width / 2
        out += [
            f'<rect class="room" x="{left:g}" y="{top:g}" width="{room_width:g}" height="{room_height:g}" rx="5"/>',
            f'<text class="label" x="{middle:g}" y="{top + 16:g}">{room}</text>',
            f'<text class="count" x="{middle:g}" y="{top + 29:g}">{len(rooms[room])}</text>',
        ]
    return out, height


def _arrow(start: Box, end: Box) -> str:
    x1, y1 = start[0] + start[2] / 2, start[1] + start[3]
    x2, y2 = end[0] + end[2] / 2, end[1] - 2
    bend = (y2 - y1) / 2
    return f'<path class="arrow" d="M{x1:g},{y1:g} C{x1:g},{y1 + bend:g} {x2:g},{y2 - bend:g} {x2:g},{y2:g}"/>'


def draw() -> str:
    """Return the complete picture as SVG text."""
    packages = [package for row in ROWS for package in row]
    graph = grimp.build_graph(*packages, cache_dir=None)
    body: list[str] = []
    step = (WIDTH - 2 * MARGIN) / len(DATA_FLOW)
    for i, text in enumerate(DATA_FLOW):
        left = MARGIN + i * step
        body.append(f'<rect class="flow" x="{left:g}" y="{MARGIN}" width="{step - 22:g}" height="30" rx="15"/>')
        body.append(f'<text class="label" x="{left + step / 2 - 11:g}" y="{MARGIN + 19}">{text}</text>')
    for i, _ in enumerate(pairwise(DATA_FLOW)):
        left = MARGIN + (i + 1) * step - 20
        body.append(f'<path class="arrow" d="M{left:g},{MARGIN + 15} h16"/>')
    y = MARGIN + 48.0
    for row in ROWS:
        width = (WIDTH - MARGIN * (len(row) + 1)) / len(row)
        heights = []
        for i, package in enumerate(row):
            lines, height = draw_package(graph, package, MARGIN + i * (width + MARGIN), y, width)
            body += lines
            heights.append(height)
        y += max(heights) + MARGIN
    head = f"""<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {y:g}" role="img">
<title>The packages of piano-action-rig, their subpackages and imports</title>
<style>
text {{ font: 12px system-ui, sans-serif; fill: #222 }} .name {{ font-weight: 700; font-size: 15px }}
.note, .count {{ fill: #666; font-size: 10px }} .label, .count {{ text-anchor: middle }}
.room {{ fill: #fff; stroke: #999 }} .flow {{ fill: #fff; stroke: #333 }}
.arrow {{ fill: none; stroke: #777; stroke-width: 1; marker-end: url(#head) }}
</style>
<defs><marker id="head" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7" orient="auto">
<path d="M0,0 L8,4 L0,8 z" fill="#777"/></marker></defs>
<rect width="{WIDTH}" height="{y:g}" fill="#fff"/>
"""
    return head + "\n".join(body) + "\n</svg>\n"


def rooms() -> str:
    """The rooms of each package with what their docstrings say, and the names of their modules, as Markdown."""
    lines: list[str] = []
    for package in (name for row in ROWS for name in row):
        lines.append(f"## {package}/\n")
        for face in sorted((ROOT / package).rglob("__init__.py"), key=lambda path: path.parent.parts):
            folder = face.parent
            said = " ".join((ast.get_docstring(ast.parse(face.read_text(encoding="utf-8"))) or "").split())
            said = said.split(" >>> ")[0].replace("``", "`")
            modules = sorted(path.stem for path in folder.glob("*.py") if not path.stem.startswith("__"))
            name = folder.relative_to(ROOT).as_posix()
            lines.append(f"**`{name}/`** {said}  \n<small>{' · '.join(modules)}</small>\n")
    return "\n".join(lines)


def page() -> str:
    """`docs/architecture.md` with its rooms written anew."""
    head, _, _ = PAGE.read_text(encoding="utf-8").partition(MARK)
    return f"{head}{MARK}\n\n{rooms()}"


if __name__ == "__main__":
    PICTURE.write_text(draw(), encoding="utf-8")
    PAGE.write_text(page(), encoding="utf-8")
