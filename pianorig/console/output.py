"""What commands print: one JSON object, the verdict of a comparison, names of written files."""

from __future__ import annotations

import json
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from pianorig.console.live_line import drawing_width


def _plain(value: Any) -> Any:
    """NumPy's numbers and arrays as Python's, anything else, paths above all, as text."""
    return value.tolist() if hasattr(value, "tolist") else str(value)


def print_json(item: Mapping[str, Any]) -> None:
    """One JSON object on a line of standard output, at once."""
    print(json.dumps(item, default=_plain), flush=True)


def nan_as_null(row: Mapping[str, Any]) -> dict[str, Any]:
    """A row of plain values for JSON, with None where there is no number."""
    return {key: None if value != value else value for key, value in row.items()}


def print_verdict(lines: Sequence[str]) -> None:
    """Headline of a comparison, then its details one below the other."""
    headline, *details = lines
    print(headline)
    for line in details:
        print(f"  - {line}")


def print_paragraphs(texts: Iterable[str]) -> None:
    """Sentences for people, wrapped to the terminal, at most 100 characters wide."""
    for text in texts:
        print(textwrap.fill(text, min(drawing_width(), 100), initial_indent="  ", subsequent_indent="  "))


def print_files(paths: Iterable[Path | None]) -> None:
    """Names of the files that were written, one per line."""
    for path in paths:
        if path is not None:
            print(path)
