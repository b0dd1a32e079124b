"""Asking whoever sits at the terminal; where nobody does, there is no answer."""

from __future__ import annotations

import sys


def type_answer(question: str) -> str | None:
    """Show a question on standard error and return the line that was typed; None without a terminal."""
    if sys.stdin is None or not sys.stdin.isatty():
        return None
    print(question, end="", file=sys.stderr, flush=True)
    line = sys.stdin.readline()
    return line.rstrip("\n") if line else None
