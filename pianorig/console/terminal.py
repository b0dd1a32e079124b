"""The terminal: a line that changes in place, lines that stay above it, what it can print, its width, a question.

Nothing but a carriage return and blanks moves the cursor: that works in every terminal and console. What its encoding
lacks is spelled plainly.
"""

from __future__ import annotations

import codecs
import io
import os
import shutil
import sys
import threading
import time
from collections.abc import Callable
from typing import TextIO

REFRESH_S = 0.1
NARROWEST, WIDEST = 20, 200
USUAL_COLUMNS = 80


def drawing_width() -> int:
    """Characters a drawing on standard output may be wide: the terminal's, or what ``COLUMNS`` says, else 72."""
    return min(max(shutil.get_terminal_size((73, 24)).columns - 1, NARROWEST), WIDEST)


def clear_screen() -> None:
    """Begin standard output at the top of an empty screen; nothing where it is no terminal."""
    if not sys.stdout.isatty() or os.environ.get("TERM") == "dumb":
        return
    if os.name == "nt":
        os.system("cls")  # an older console knows no escape sequences
    else:
        print("\x1b[2J\x1b[H", end="", flush=True)


class LiveLine:
    """A line that is drawn over; silent where standard error is no terminal."""

    def __init__(self) -> None:
        self._drawn = ""
        self._next_s = 0.0
        self._lock = threading.RLock()  # compiling, a ticker and the work itself may report from their own threads

    @property
    def is_on(self) -> bool:
        return sys.stderr is not None and sys.stderr.isatty()

    @property
    def columns(self) -> int:
        """Characters the line may have: one less than the terminal's width, which would start a new line."""
        try:
            width = os.get_terminal_size(sys.stderr.fileno()).columns
        except (OSError, ValueError):
            width = 0
        return max((width or USUAL_COLUMNS) - 1, 10)

    def show(self, text: str, *, at_once: bool = False) -> None:
        """Draw ``text`` over the line on standard error, cut to the terminal's width, at most ten times a second unless
        ``at_once``; nothing where that is no terminal."""
        now = time.monotonic()
        with self._lock:
            if not self.is_on or (now < self._next_s and not at_once):
                return
            self._next_s = now + REFRESH_S
            self._draw(text[: self.columns].rstrip())

    def clear(self) -> None:
        """Leave an empty line, the cursor at its beginning."""
        with self._lock:
            self._next_s = 0.0
            if self._drawn:
                self._draw("")

    def say(self, text: str) -> None:
        """Print text of one or several lines that stays on standard error; a line drawn by `show` returns below it."""
        with self._lock:
            drawn = self._drawn
            self.clear()
            print(text, file=sys.stderr, flush=True)
            if drawn:
                self._draw(drawn)

    def _draw(self, text: str) -> None:
        stream: TextIO = sys.stderr
        stream.write("\r" + text.ljust(len(self._drawn)) + ("" if text else "\r"))
        stream.flush()
        self._drawn = text


LIVE = LiveLine()
"""The line of this process."""


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
