"""Draw one picture a package from the imports, and write what each folder is for into `docs/architecture.md`.

Run after moving or adding a folder:  python docs/make_architecture.py
A test redraws the pictures and compares, so that they cannot become outdated. An arrow points from a subpackage to one
that it imports; arrows implied by others (A → B → C makes A → C redundant) are omitted. Subpackages are drawn above
what they import.
"""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path

import grimp

ROOT = Path(__file__).parents[1]
PICTURES = ROOT / "docs" / "images"
PAGE = ROOT / "docs" / "architecture.md"
MARK = "<!-- below: made by docs/make_architecture.py from the docstrings of the folders -->"
PACKAGES = ("pianorig", "validation", "rig", "model", "vision")
WIDTH, MARGIN = 900, 16
ROOM_HEIGHT, LEVEL_GAP, ROOM_GAP, TITLE = 36, 26, 12, 30
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
    out = [
        f'<rect x="{x:g}" y="{y:g}" width="{width:g}" height="{height:g}" rx="8" fill="{COLOURS[package]}"/>',
        f'<text x="{x + 12:g}" y="{y + 20:g}" class="name">{package}/</text>',
    ]
    for room, found in sorted(uses.items()):
        out += [_arrow(boxes[room], boxes[other]) for other in sorted(found)]
    for room, (left, top, room_width, room_height) in sorted(boxes.items()):
        middle = left + room_width / 2
        out += [
            f'<rect class="room" x="{left:g}" y="{top:g}" width="{room_width:g}" height="{room_height:g}" rx="5"/>',
            f'<text class="label" x="{middle:g}" y="{top + 22:g}">{room}</text>',
        ]
    return out, height


def _arrow(start: Box, end: Box) -> str:
    x1, y1 = start[0] + start[2] / 2, start[1] + start[3]
    x2, y2 = end[0] + end[2] / 2, end[1] - 2
    bend = (y2 - y1) / 2
    return f'<path class="arrow" d="M{x1:g},{y1:g} C{x1:g},{y1 + bend:g} {x2:g},{y2 - bend:g} {x2:g},{y2:g}"/>'


def picture(package: str) -> Path:
    """Where the picture of a package lies."""
    return PICTURES / f"architecture_{package}.svg"


@cache
def imports() -> grimp.ImportGraph:
    """Who imports whom in the five packages."""
    return grimp.build_graph(*PACKAGES, cache_dir=None)


def draw(package: str) -> str:
    """Return the picture of one package as SVG text."""
    body, height = draw_package(imports(), package, 0.0, 0.0, WIDTH)
    head = f"""<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height:g}" role="img">
<title>The subpackages of {package} and which of them import which</title>
<style>
text {{ font: 12px system-ui, sans-serif; fill: #222 }} .name {{ font-weight: 700; font-size: 15px }}
.label {{ text-anchor: middle }}
.room {{ fill: #fff; stroke: #999 }}
.arrow {{ fill: none; stroke: #777; stroke-width: 1; marker-end: url(#head) }}
</style>
<defs><marker id="head" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7" orient="auto">
<path d="M0,0 L8,4 L0,8 z" fill="#777"/></marker></defs>
"""
    return head + "\n".join(body) + "\n</svg>\n"


def said(face: Path) -> str:
    """What the docstring of a package says in its first paragraph, as Markdown."""
    text = ast.get_docstring(ast.parse(face.read_text(encoding="utf-8"))) or ""
    return " ".join(text.partition("\n\n")[0].split()).replace("``", "`")


def rooms(package: str) -> str:
    """A package as Markdown: what it is for, its picture, and one line for each of its rooms."""
    folder = ROOT / package
    lines = [f"## {package}/", "", said(folder / "__init__.py"), ""]
    lines += [f"![Subpackages of {package} and which of them import which](images/{picture(package).name})", ""]
    order = [room for row in levels(imports_between(imports(), package, rooms_of(imports(), package))) for room in row]
    lines += [f"- `{room}/`: {said(folder / room / '__init__.py')}" for room in order]
    return "\n".join(lines) + "\n"


def page() -> str:
    """`docs/architecture.md` with its rooms written anew."""
    head, _, _ = PAGE.read_text(encoding="utf-8").partition(MARK)
    return f"{head}{MARK}\n\n" + "\n".join(rooms(package) for package in PACKAGES)


if __name__ == "__main__":
    for name in PACKAGES:
        picture(name).write_text(draw(name), encoding="utf-8")
    PAGE.write_text(page(), encoding="utf-8")
