"""Progress of long work on the terminal; silent where standard error is no terminal, or where JSON is printed."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any


@contextmanager
def bar(label: str, quiet: bool = False) -> Iterator[Callable[[int, int], None] | None]:
    """Progress bar on standard error: yields ``update(done, total)``, or None when quiet."""
    if quiet or not sys.stderr.isatty():
        yield None
        return
    # start-up: rich costs 30 ms, only a progress bar on a terminal needs it
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn(label), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task(label, total=None)

        def update(done: int, total: int) -> None:
            progress.update(task, completed=done, total=total)

        yield update


def say(text: str, quiet: bool = False) -> None:
    """One line about where the work is, on standard error, so that standard output stays the result."""
    if not quiet:
        print(text, file=sys.stderr, flush=True)


@contextmanager
def recording_line(quiet: bool = False) -> Iterator[Callable[[Any], None] | None]:
    """One line that follows a recording: trial, time, peak force; yields the recorder's callback."""
    if quiet or not sys.stderr.isatty():
        yield None
        return
    peak_n = 0.0

    def update(at: Any) -> None:
        nonlocal peak_n
        peak_n = at.peak_force_n if at.time_s < 0.05 else max(peak_n, at.peak_force_n)
        left = "" if at.left_s is None else "{}:{:02d} left".format(*divmod(round(at.left_s), 60))
        line = f"\rtrial {at.trial}/{at.trials}  t = {at.time_s:5.2f} s  peak {peak_n:5.1f} N  {left:18s}"
        print(line, end="", file=sys.stderr, flush=True)

    try:
        yield update
    finally:
        print("\r" + " " * 60 + "\r", end="", file=sys.stderr, flush=True)
