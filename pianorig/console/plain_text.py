"""Text for a terminal that lacks a character: its nearest plain spelling, never a crash and seldom a question mark.

A Windows console or pipe may know cp1252, cp437 or ASCII only. Every message of the toolkit passes through the streams
set up here.
"""

from __future__ import annotations

import codecs
import io
import sys

HANDLER = "pianorig.plain"
SPELLED = {
    "°": " deg", "µ": "u", "μ": "u", "×": "x", "·": "*", "±": "+-", "−": "-", "–": "-", "—": "-", "…": "...",
    "→": "->", "≤": "<=", "≥": ">=", "²": "^2", "³": "^3", "“": '"', "”": '"', "‘": "'", "’": "'",
    "θ": "theta", "σ": "sigma", "é": "e", "\u00a0": " ", "\u202f": " ", "\u2009": " ",
}  # fmt: skip


def _spell(problem: UnicodeError) -> tuple[str, int]:
    if not isinstance(problem, UnicodeEncodeError):
        raise problem
    lacking = problem.object[problem.start : problem.end]
    return "".join(SPELLED.get(sign, "?") for sign in lacking), problem.end


def write_what_the_terminal_can() -> None:
    """Let standard output and standard error spell out what their encoding lacks."""
    codecs.register_error(HANDLER, _spell)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors=HANDLER)


def can_print(text: str) -> bool:
    """Whether standard output knows every character of ``text``."""
    try:
        text.encode(getattr(sys.stdout, "encoding", None) or "ascii")
    except UnicodeEncodeError:
        return False
    return True
