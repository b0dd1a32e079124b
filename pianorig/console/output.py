"""What commands print: one JSON object, a table of 80 columns, names of written files."""

from __future__ import annotations

import json
import math
import re
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from pianorig.console.terminal import drawing_width


def _encode_for_json(value: Any) -> Any:
    """NumPy's numbers and arrays as Python's, anything else, paths above all, as text."""
    return value.tolist() if hasattr(value, "tolist") else str(value)


def _make_json_ready(content: Any) -> Any:
    """Copy of nested content in which arrays and tuples are lists, and numbers that are not finite None, which JSON
    does not know."""
    if hasattr(content, "tolist"):
        content = content.tolist()
    if isinstance(content, float):
        return content if math.isfinite(content) else None
    if isinstance(content, dict):
        return {key: _make_json_ready(value) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [_make_json_ready(value) for value in content]
    return content


def json_text(content: Any) -> str:
    """JSON of plain values, NumPy's, and paths; a number that is none, or not finite, is null."""
    try:
        return json.dumps(content, default=_encode_for_json, allow_nan=False)
    except ValueError:
        return json.dumps(_make_json_ready(content), default=_encode_for_json)


def print_json(item: Mapping[str, Any]) -> None:
    """One JSON object on a line of standard output, at once."""
    print(json_text(item), flush=True)


OPTION = {
    "overrides": "set", "factors": "scale", "fixed": "fix", "priors": "prior", "budget_s": "budget",
    "camera": "calibration", "rows_per_s": "shutter", "frame_rate_hz": "frame-rate", "key_bottom_s": "key-bottom",
    "first_frame": "from", "last_frame": "to",
}  # fmt: skip
"""Options whose name is not that of the Python argument; the packages below name arguments, `in backticks`."""
ARGUMENT = re.compile(r"`([a-z][a-z_]*)`")


def name_options(text: str) -> str:
    """A message of a package with the command's options in place of Python's arguments."""
    return ARGUMENT.sub(lambda found: "--" + OPTION.get(found[1], found[1].replace("_", "-")), text)


def tell(as_json: bool, facts: Mapping[str, Any], lines: Iterable[str]) -> None:
    """What a command found, for programs as one JSON object, or for people as lines, which are made only then."""
    if as_json:
        print_json(facts)
        return
    for line in lines:
        print(name_options(line))


MOST_COLUMNS, MOST_ROWS = 80, 20


def table_lines(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Lines of a table under ``head``, at most 80 characters wide and 20 lines long: first column to the left, others
    to the right, cells cut where needed; the last line counts rows left out."""
    shown = rows[: MOST_ROWS - 2] if len(rows) > MOST_ROWS - 1 else rows
    cells = [[str(cell) for cell in row] for row in (head, *shown)]
    wide = [max(map(len, column)) for column in zip(*cells, strict=True)]
    while sum(wide) + 2 * (len(wide) - 1) > MOST_COLUMNS and max(wide) > 1:
        wide[wide.index(max(wide))] -= 1
    lines = []
    for row in cells:
        parts = [_shorten_text(cell, n).ljust(n) if i == 0 else _shorten_text(cell, n).rjust(n) for i, (cell, n) in
                 enumerate(zip(row, wide, strict=True))]  # fmt: skip
        lines.append("  ".join(parts).rstrip())
    more = [f"and {len(rows) - len(shown)} more"] if len(shown) < len(rows) else []
    return lines + more


def _shorten_text(text: str, n: int) -> str:
    return text if len(text) <= n else text[: max(n - 1, 0)] + "…"


def wrap_text(text: str, begin: str = "") -> list[str]:
    """A text in lines of at most 80 columns, those after the first indented by two."""
    return textwrap.wrap(begin + text, MOST_COLUMNS, subsequent_indent="  ", break_long_words=False)


def paragraphs(texts: Iterable[str]) -> list[str]:
    """Sentences for people, wrapped to the terminal, at most 80 characters wide."""
    wide = min(drawing_width(), MOST_COLUMNS)
    return [textwrap.fill(text, wide, initial_indent="  ", subsequent_indent="  ") for text in texts]


def file_lines(paths: Iterable[Path | None]) -> list[str]:
    return [str(path) for path in paths if path is not None]
