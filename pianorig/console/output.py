"""What commands print: one JSON object, the verdict of a comparison, names of written files."""

from __future__ import annotations

import json
import math
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from pianorig.console.terminal import drawing_width


def _plain(value: Any) -> Any:
    """NumPy's numbers and arrays as Python's, anything else, paths above all, as text."""
    return value.tolist() if hasattr(value, "tolist") else str(value)


def _finite(content: Any) -> Any:
    if hasattr(content, "tolist"):
        content = content.tolist()
    if isinstance(content, float):
        return content if math.isfinite(content) else None
    if isinstance(content, dict):
        return {key: _finite(value) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [_finite(value) for value in content]
    return content


def json_text(content: Any) -> str:
    """JSON of plain values, NumPy's, and paths; a number that is none, or not finite, is null."""
    try:
        return json.dumps(content, default=_plain, allow_nan=False)
    except ValueError:
        return json.dumps(_finite(content), default=_plain)


def print_json(item: Mapping[str, Any]) -> None:
    """One JSON object on a line of standard output, at once."""
    print(json_text(item), flush=True)


def tell(as_json: bool, facts: Mapping[str, Any], lines: Iterable[str]) -> None:
    """What a command found, for programs as one JSON object, or for people as lines, which are made only then."""
    if as_json:
        print_json(facts)
        return
    for line in lines:
        print(line)


def verdict_lines(lines: Sequence[str]) -> list[str]:
    """Headline of a comparison, then its details one below the other."""
    return [lines[0], *(f"  - {line}" for line in lines[1:])]


def paragraphs(texts: Iterable[str]) -> list[str]:
    """Sentences for people, wrapped to the terminal, at most 100 characters wide."""
    wide = min(drawing_width(), 100)
    return [textwrap.fill(text, wide, initial_indent="  ", subsequent_indent="  ") for text in texts]


def file_lines(paths: Iterable[Path | None]) -> list[str]:
    """Names of the files that were written."""
    return [str(path) for path in paths if path is not None]
