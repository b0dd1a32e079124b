"""Questions to the operator at the terminal; without a terminal there is no answer."""

from __future__ import annotations

import sys
from collections.abc import Callable


def type_answer(question: str) -> str | None:
    """Show a question on standard error and return the line that was typed; None without a terminal."""
    if operator() is None:
        return None
    print(question, end="", file=sys.stderr, flush=True)
    line = sys.stdin.readline()
    return line.rstrip("\n") if line else None


def operator() -> Callable[[str], str | None] | None:
    """Return :func:`type_answer` where a terminal is attached, else None: nobody can be asked."""
    return type_answer if sys.stdin is not None and sys.stdin.isatty() else None
