"""Print how many numbers in the packages' code somebody has chosen, by package and place, and what is exempt.

    python docs/count_thresholds.py [-v] [-u] [FOLDER ...]     (-v: each with file and line; -u: those without a reason)

A number is a choice unless one of `EXEMPTIONS` says otherwise; each of them prints how much it takes away. A bare value
at module level (``LIMIT = 3.0``) is a choice whatever its size, except 0 and 1; in a formula the numbers of `FORM` are
none. A choice has a *reason* where a comment or a docstring stands at it: on its line, on the line above, or below.
"""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

PLACES = ("module", "inline", "field", "default")
EXEMPTIONS = {
    "formats and codes": "files, masks, powers of two, seeds, ports, codes, enumerations, bounds of a file's fields",
    "tableaux and series": "files, divisors, mathematical constants such as 1.4826",
    "published standards": "constants and rules of ISO/TS 18571 in its file, grades of Kass and Raftery (1995)",
    "declared physical data": "what the thesis prescribes, one place each: targets of regulation, key dip",
    "units and physical constants": "conversions, gravity, declared parameters of a law or a screw",
    "sizes of plots": "files, figure sizes, fonts, lines, columns of a terminal",
    "instruments of the virtual bench": "what is simulated there: constants, fields, defaults that say unit and source",
    "indices and shapes": "subscripts, ranges, shapes, axes, type annotations",
    "form of a formula": "halves, squares, twelfths, powers of ten of a unit, inside an expression",
    "range of a double": "up to 1e-12 or from 1e100 inside an expression: they keep it finite",
}
FORM = {0.25, 0.5, 1.5, 2.0, 3.0, 4.0, 12.0, 60.0, 100.0, 180.0, 360.0, 1e3, 1e6, 1e9, 1e-3, 1e-6, 1e-9}
MATHEMATICAL = {1.4826, 0.6745, 0.4549, 0.158655, 1.96, 700.0, 0.3186}
FULL_SCALE = {255.0, 1023.0, 4095.0, 65535.0}
PHYSICAL = {9.81, 9.80665, 9.80665e-3, 4.448222, 4.4482216152605}
FILES = {
    "tableaux and series": r"methods\.py|elementary|banded|force_library",
    "published standards": r"scores/iso18571\.py",
    "sizes of plots": r"figure|plots|drawing|colours|report/(.*layout|overview|view)|curves/(style|plot)"
    r"|contact_sheet|console/(terminal|output)",
    "formats and codes": r"layout|workspace|signatures|mraw|cine_|avi_|tiff_|video_index|machine_code|orientation"
    r"|daqmx\.py|status|/rpc/|product|journal_records|tdms|lvm|messages|/flags|/quantity\.py|/native\.py|daq/faults",
}
INSTRUMENTS = r"rig/simulated/(bench/|device/state|backend|signals)|vision/synthetic/|workflows/examples"
"""Files that describe what is simulated; what decides there (a step, a tolerance, a wait) stays a choice."""
DECIDING = r".*(TOLERANCE|STEP|POLL|KEPT|MAX|BALANCED|STILL|INSTANTS|OVERSAMPLING|SUBPIXELS).*"
BITS = r".*\b(bits?|bit_depth|itemsize)\b.*"
NAMES = {
    "units and physical constants": r"_?(DEG|RAD|UNITS?|UNIT_\w+|G|NEWTON\w*|SECONDS|FACTORS|OUTLINES_M)",
    "formats and codes": r"_?(SCHEMA\w*|VERSION\w*|\w*FORMAT\w*|CODES?|EXIT\w*|exit_code|\w*PORT|\w*SEED|\w*STREAM"
    r"|ALLOWED_M|AWAKE|UNTOUCHED|QUIET|BYTES_PER_VALUE|DOTS|\w*BITS|DEPTHS|\w+_CODES|INTERRUPTED|GONE|KINDS"
    r"|(self\.)?bit_depth)",
    "tableaux and series": r"_?(GAUSS\w*|QUARTIC|BASIS)",
    "published standards": r"GRADES",
    "declared physical data": r"DIP_M",
    "indices and shapes": r"N_[A-Z_]+|PRESS_NUMBERS|STAGES",
    "sizes of plots": r"(SIZE_IN|ROW_IN|WIDTH_IN|DPI|MODEL_DASHES)",
}
ARGUMENTS = {
    "indices and shapes": r"ndim|axis|stacklevel|maxlen|ddof|align|shape",
    "formats and codes": r"ge|gt|le|lt|multiple_of|digits|bit_depth",
    "sizes of plots": r"indent|width|height|dpi|\w*fontsize|labelsize|lw|linewidths?|\w*alpha|pad|figsize|rotation"
    r"|height_ratios|shrink|borderaxespad",
}
CALLS = {
    "indices and shapes": r"range|slice|round|np\.(zeros|empty|ones|full|eye|diff)|.*\.reshape|s\.number|_table",
    "units and physical constants": r"Number|_pair|Screw",
    "declared physical data": r"RegulationTarget",
    "formats and codes": r"ir\.IntType|KINDS|check_numbers|chr|OSError|IsADirectoryError|(self\.)?refuse|Refused"
    r"|HTTPError",
    "sizes of plots": r"new_sheet|_write_label|Chart|Pen|.*\.shade",
}


class Literal(NamedTuple):
    """A number in a file: where it stands, and the exemption that takes it, if any."""

    line: int
    place: str
    value: float
    exemption: str
    statement: tuple[int, int]


def find_name(table: dict[str, str], text: str) -> str:
    """Exemption of a table whose pattern the whole text matches."""
    return next((exemption for exemption, pattern in table.items() if re.fullmatch(pattern, text)), "")


def find_exemption(node: ast.AST, place: str) -> str:
    """Exemption of a whole assignment, argument, call or expression by its name or its form."""
    if isinstance(node, ast.Assign | ast.AnnAssign):
        name = ast.unparse(node.targets[0] if isinstance(node, ast.Assign) else node.target)
        return find_name(NAMES, name) if place == "module" or name.endswith(("exit_code", "bit_depth")) else ""
    if isinstance(node, ast.keyword):
        return find_name(ARGUMENTS, node.arg or "")
    if isinstance(node, ast.Call):
        return find_name(CALLS, ast.unparse(node.func))
    if isinstance(node, ast.Tuple) and place == "module":
        values = [part.value if isinstance(part, ast.Constant) else None for part in node.elts]
        is_enumeration = len(values) > 1 and values in (list(range(len(values))), list(range(1, len(values) + 1)))
        return "formats and codes" if is_enumeration else ""
    if isinstance(node, ast.Compare | ast.BinOp) and re.fullmatch(BITS, ast.unparse(node)):
        parts = list(ast.iter_child_nodes(node))
        is_depth = any(isinstance(part, ast.Constant) and part.value in (8, 10, 12, 16) for part in parts)
        return "formats and codes" if is_depth else ""
    if isinstance(node, ast.BinOp) and re.fullmatch(r"\d+ \* (self\.)?seed \+ \w+", ast.unparse(node)):
        return "formats and codes"
    if isinstance(node, ast.BinOp) and isinstance(node.left, ast.Constant):
        is_power = isinstance(node.op, ast.LShift) or (isinstance(node.op, ast.Pow) and node.left.value == 2)
        return "formats and codes" if is_power else ""
    return ""


def classify_number(node: ast.Constant, text: str, place: str, inside: str) -> str:
    """Exemption of one literal by its value and what it stands in: '' for a choice."""
    size = abs(float(node.value))  # type: ignore[arg-type]
    if text[:2].lower() in ("0x", "0o", "0b") or size in FULL_SCALE:
        return "formats and codes"
    if size in PHYSICAL:
        return "units and physical constants"
    if size in MATHEMATICAL or (inside == "divisor" and size == round(size) and size % 10):
        return "tableaux and series"
    if size in (0.0, 1.0) or (inside and size in FORM):
        return "form of a formula"
    return "range of a double" if inside and (size <= 1e-12 or size >= 1e100) else ""


def list_parts(node: ast.AST, place: str, inside: str) -> Iterator[tuple[ast.AST, str, str, str]]:
    """Each child of a node with its place, what it stands in, and the exemption that takes all below it."""
    for name, field in ast.iter_fields(node):
        for child in field if isinstance(field, list) else [field]:
            if not isinstance(child, ast.AST):
                continue
            here, form, exemption = place, inside, ""
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                here = "inline" if name == "body" else place
                form = "body" if name == "body" else inside
                exemption = "indices and shapes" if name in ("returns", "decorator_list") else ""
            elif isinstance(node, ast.arguments):
                here = "default" if name in ("defaults", "kw_defaults") else place
                exemption = "" if here == "default" else "indices and shapes"
            elif isinstance(node, ast.ClassDef):
                here = "field"
            elif (name == "annotation") or (isinstance(node, ast.Subscript) and name == "slice"):
                exemption = "indices and shapes"
            elif isinstance(node, ast.BinOp):
                divides = isinstance(node.op, ast.Div) and name == "right"
                form = "divisor" if divides else inside or "formula"
            elif isinstance(node, ast.Call) and ast.unparse(node.func) in ("np.sqrt", "math.sqrt"):
                form = "divisor"
            elif isinstance(node, ast.Call | ast.Compare):
                form = inside or "formula"
            yield child, here, form, exemption


def find_literals(
    node: ast.AST,
    source: str,
    *,
    place: str = "module",
    inside: str = "",
    taken: str = "",
    statement: tuple[int, int] | None = None,
) -> list[Literal]:
    """Every number below a node, with its exemption."""
    if isinstance(node, ast.Constant):
        if isinstance(node.value, bool) or not isinstance(node.value, int | float):
            return []
        text = ast.get_source_segment(source, node) or ""
        exemption = taken or classify_number(node, text, place, inside)
        return [Literal(node.lineno, place, node.value, exemption, statement or (node.lineno, node.lineno))]
    taken = taken or find_exemption(node, place)
    if isinstance(node, ast.Assign | ast.AnnAssign):
        statement = (node.lineno, node.end_lineno or node.lineno)
    return [
        found
        for child, here, form, exemption in list_parts(node, place, inside)
        for found in find_literals(
            child, source, place=here, inside=form, taken=taken or exemption, statement=statement
        )
    ]


def has_reason(lines: list[str], found: Literal) -> bool:
    """Whether a comment or a docstring stands on a literal's line, or above, in or below its assignment."""
    first, last = found.statement
    above, below = (lines[i].strip() if 0 <= i < len(lines) else "" for i in (first - 2, last))
    at = "\n".join({lines[first - 1], lines[found.line - 1], lines[last - 1]})
    return "  # " in at or above.startswith("# ") or below.startswith('"""')


def describes_instrument(file: str, line: str, place: str) -> bool:
    """Whether a line declares, by a name that decides nothing, a quantity of what is simulated."""
    name = re.split(r"[:=]", line)[0]
    return bool(re.search(INSTRUMENTS, file)) and place != "inline" and not re.fullmatch(DECIDING, name.strip())


def main(arguments: list[str]) -> None:
    folders = [a for a in arguments if not a.startswith("-")] or ["model", "rig", "vision", "validation", "pianorig"]
    counts: dict[str, Counter[str]] = {"all": Counter()}
    exempt: Counter[str] = Counter()
    files = subprocess.run(["git", "ls-files", *folders], capture_output=True, text=True, check=True).stdout.split()
    for name in (file for file in files if file.endswith(".py")):
        source = Path(name).read_text(encoding="utf-8")
        lines = source.splitlines()
        whole = next((exemption for exemption, pattern in FILES.items() if re.search(pattern, name)), "")
        for found in find_literals(ast.parse(source), source, taken=whole):
            reason = has_reason(lines, found)
            exemption = found.exemption
            if not exemption and reason and describes_instrument(name, lines[found.statement[0] - 1], found.place):
                exemption = "instruments of the virtual bench"
            if exemption:
                exempt[exemption] += 1
                continue
            for of in (counts["all"], counts.setdefault(name.split("/")[0], Counter())):
                of[found.place] += 1
                of["no reason"] += not reason
            if "-v" in arguments or ("-u" in arguments and not reason):
                print(f"{name}:{found.line} {found.place} {found.value}")
    print(f"{'package':12}", *(f"{place:>8}" for place in PLACES), "     sum   without a reason")
    for package, of in counts.items():
        total = sum(of[place] for place in PLACES)
        print(f"{package:12}", *(f"{of[place]:8}" for place in PLACES), f"{total:8} {of['no reason']:18}")
    print("\nexempt")
    for exemption, meaning in EXEMPTIONS.items():
        print(f"{exempt[exemption]:6}  {exemption}: {meaning}")


if __name__ == "__main__":
    main(sys.argv[1:])
