"""Print how many number literals in the packages' code somebody has chosen, by package and place.

    python docs/count_thresholds.py [-v] [FOLDER ...]        (-v: each literal with file and line)

Not counted: numbers that give a formula or a unit its form (`FORM`), subscripts, ranges and shapes, type annotations,
arguments such as ``ndim``; files and names of formats, codes, tableaux, series, physical constants and tables of data.
"""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections import Counter
from pathlib import Path

PLACES = ("module", "inline", "field", "default")
FORM = {0.0, 0.25, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 60.0, 100.0, 180.0, 360.0, 1e3, 1e6, 1e9, 1e-3, 1e-6, 1e-9}
FILES = re.compile(
    r"methods\.py|layout|workspace|signatures|mraw|cine_|avi_|tiff_|video_index|machine_code|elementary|banded|flags"
    r"|orientation|colours|figure|/page/|plots|drawing|daqmx|status|/rpc/|product|journal|tdms|lvm|messages|force_library"
    r"|/quantity\.py"
)
NAMES = re.compile(r"_?(DEG|RAD|UNITS?|UNIT_\w+|G|SCHEMA\w*|VERSION\w*|\w*FORMAT\w*|CODES?|EXIT\w*|GAUSS\w*|PORT)")
ARGUMENTS = re.compile(r"ndim|axis|stacklevel|digits|indent|width|height|dpi|fontsize|lw|linewidth|alpha|maxlen|ddof")
SHAPES = ("range", "slice", "round", "np.zeros", "np.empty", "np.ones")


def is_choice(value: object) -> bool:
    """Whether a literal is a number that is not in `FORM`."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) not in FORM


def is_exempt(node: ast.AST, place: str) -> bool:
    """Whether a whole argument, call or assignment is left out by its name."""
    if isinstance(node, ast.Assign):
        return place == "module" and NAMES.fullmatch(ast.unparse(node.targets[0])) is not None
    if isinstance(node, ast.keyword):
        return ARGUMENTS.fullmatch(node.arg or "") is not None
    return isinstance(node, ast.Call) and ast.unparse(node.func) in SHAPES


def find_literals(node: ast.AST, place: str = "module") -> list[tuple[int, str, object]]:
    """Line, place and value of each literal below a node that counts."""
    if isinstance(node, ast.Constant):
        return [(node.lineno, place, node.value)] if is_choice(node.value) else []
    parts: list[tuple[ast.AST, str]] = [(child, place) for child in ast.iter_child_nodes(node)]
    if isinstance(node, ast.Subscript):
        parts = [(node.value, place)]
    elif is_exempt(node, place):
        parts = []
    elif isinstance(node, ast.AnnAssign):
        parts = [(node.value, place)] if node.value else []
    elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
        defaults = [d for d in (*node.args.defaults, *node.args.kw_defaults) if d]
        parts = [*((d, "default") for d in defaults), *((child, "inline") for child in node.body)]
    elif isinstance(node, ast.ClassDef):
        parts = [(child, "field") for child in node.body]
    return [found for part, inner in parts for found in find_literals(part, inner)]


def main(arguments: list[str]) -> None:
    folders = [a for a in arguments if a != "-v"] or ["model", "rig", "vision", "validation", "pianorig"]
    counts: dict[str, Counter[str]] = {"all": Counter()}
    files = subprocess.run(["git", "ls-files", *folders], capture_output=True, text=True, check=True).stdout.split()
    for name in files:
        if name.endswith(".py") and not FILES.search(name):
            for line, place, value in find_literals(ast.parse(Path(name).read_text(encoding="utf-8"))):
                counts.setdefault(name.split("/")[0], Counter())[place] += 1
                counts["all"][place] += 1
                if "-v" in arguments:
                    print(f"{name}:{line} {place} {value}")
    print(f"{'package':12}", *(f"{place:>8}" for place in PLACES), "     sum")
    for package, of in counts.items():
        print(f"{package:12}", *(f"{of[place]:8}" for place in PLACES), f"{of.total():8}")


if __name__ == "__main__":
    main(sys.argv[1:])
