"""Progress of long work, on standard error, so that standard output stays the result; silent where JSON is printed.

Numba's listener is added when numba is imported, so that a command that compiles nothing does not pay for it.
"""

from __future__ import annotations

import importlib.util
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any

from pianorig.console.output import name_options
from pianorig.console.terminal import LIVE

EVENTS = "numba.core.event"
ONCE = "compiling kernels (once, up to half a minute) ..."
EVERY_TIME = (
    "compiling kernels (half a minute, at every call: their cache cannot be written; set PIANORIG_CACHE_DIR to a "
    "folder that can) ..."
)


class _OnImport(MetaPathFinder):
    """Registers the notice as soon as numba's events are imported."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Import hook: where ``fullname`` is numba's event module, its spec, whose loader afterwards registers the
        notice of compilation; None for every other module.

        The finder takes itself off ``sys.meta_path``.
        """
        if fullname != EVENTS:
            return None
        sys.meta_path.remove(self)
        spec = importlib.util.find_spec(fullname)
        if spec is None or spec.loader is None:
            return spec
        execute = spec.loader.exec_module

        def exec_module(module: ModuleType) -> None:
            execute(module)
            module.register("numba:compile", _listener(module))

        spec.loader.exec_module = exec_module  # type: ignore[method-assign]
        return spec


def _listener(events: Any) -> Any:
    """A listener to numba's compile events that says one line at the first outermost compilation of this process;
    ``events``: the module ``numba.core.event``."""
    inside, said = threading.local(), threading.Event()

    class Listener(events.Listener):  # type: ignore[misc]
        def on_start(self, event: Any) -> None:
            depth = getattr(inside, "depth", 0)
            if not depth and not said.is_set():
                said.set()
                say(EVERY_TIME if event.data["dispatcher"].stats.cache_path is None else ONCE)
            inside.depth = depth + 1

        def on_end(self, event: Any) -> None:
            inside.depth = getattr(inside, "depth", 0) - 1

    return Listener()


def tell_when_compiling() -> None:
    """Say one line when the first kernel of this process is compiled; does nothing where numba is imported already."""
    if EVENTS not in sys.modules and not any(isinstance(finder, _OnImport) for finder in sys.meta_path):
        sys.meta_path.insert(0, _OnImport())


PROGRESS = "PIANORIG_PROGRESS"
"""Environment variable; at ``lines`` a bar is plain lines, one a per cent, for a program that shows them."""
BAR = 20  # signs
PATIENCE_S = 5.0  # after which work that still runs is named
UNLIMITED = 9999  # as rig's MAX_TRIALS
"""So many trials are planned where their number is not known."""


def say(text: str, quiet: bool = False) -> None:
    """Say where the work is, in lines that stay."""
    if not quiet:
        LIVE.say(name_options(text))


def clock(seconds: float) -> str:
    """A duration as ``m:ss``."""
    return "{}:{:02d}".format(*divmod(round(seconds), 60))


def bar_text(label: str, done: int, total: int, spent_s: float, columns: int) -> str:
    """Text of a progress line: ``label done/total``, then a drawn bar and the time left, each only where it fits into
    ``columns`` characters; ``spent_s``: time since the beginning."""
    text = f"{label} {done}/{total}"
    left = f"  {clock(spent_s * (total - done) / done)} left" if 0 < done < total and spent_s > 1.0 else ""
    filled = BAR * done // total if total else 0
    drawn = f"  [{'#' * filled}{'.' * (BAR - filled)}]"
    for more in (drawn, left):
        if len(text) + len(more) <= columns:
            text += more
    return text


@contextmanager
def bar(label: str, quiet: bool = False, what: str = "frames") -> Iterator[Callable[[int, int], None] | None]:
    """Context that yields ``update(done, total)``, which draws a bar on standard error, or None when quiet; without a
    terminal one line is printed after 5 s; ``what``: plural of what is counted."""
    if quiet:
        yield None
        return
    began_s: float | None = None
    told = LIVE.is_on
    for_program, said = os.environ.get(PROGRESS) == "lines" and not LIVE.is_on, -1

    def update(done: int, total: int) -> None:
        nonlocal began_s, told, said
        if for_program:
            share = 100 * done // max(total, 1)
            if share > said:
                said = share
                say(f"{label} {done}/{total}")
            return
        began_s = time.monotonic() if began_s is None else began_s
        spent_s = time.monotonic() - began_s
        if not told and spent_s >= PATIENCE_S:
            told = True
            say(f"{label}: {total} {what}, {clock(spent_s * (total - done) / max(done, 1))} left")
        LIVE.show(bar_text(label, done, total, spent_s, LIVE.columns))

    try:
        yield update
    finally:
        LIVE.clear()


@contextmanager
def working(text: str, quiet: bool = False) -> Iterator[Callable[[str], None]]:
    """Context that shows ``text`` on standard error while its block works, on a terminal with the time spent, else once
    after 5 s; yields a function that replaces the text."""
    if quiet:
        yield lambda words: None
        return
    words, ended, began_s = text, threading.Event(), time.monotonic()

    def show() -> None:
        spent_s = time.monotonic() - began_s
        LIVE.show(words + (" ..." if spent_s < 2.0 else f" ... {clock(spent_s)}"), at_once=True)

    def tick() -> None:
        if not LIVE.is_on:
            if not ended.wait(PATIENCE_S):
                say(f"{words} ...")
            return
        while not ended.wait(1.0):
            show()

    def replace(new: str) -> None:
        nonlocal words
        words = new
        show()

    show()
    ticker = threading.Thread(target=tick, name="progress", daemon=True)
    ticker.start()
    try:
        yield replace
    finally:
        ended.set()
        ticker.join()
        LIVE.clear()


@contextmanager
def recording_line(quiet: bool = False, title: str = "") -> Iterator[Callable[[Any], None] | None]:
    """Context that yields the callback for a recorder's progress (None when quiet), which shows trial, time, largest
    raw force so far and time left; ``title`` is said with the first block.

    Elsewhere than on a terminal a trial that begins is a line once the recording has taken a while.
    """
    if quiet:
        yield None
        return
    peak_n, trial, began_s = 0.0, 0, time.monotonic()

    def count_of(at: Any, word: str = " of ") -> str:
        return "" if at.trials >= UNLIMITED else f"{word}{at.trials}"

    def update(at: Any) -> None:
        nonlocal peak_n, trial
        if not trial and title and LIVE.is_on:
            say(title)
        if at.trial != trial:
            trial, peak_n = at.trial, 0.0
            if not LIVE.is_on and time.monotonic() - began_s >= PATIENCE_S:
                say(f"trial {at.trial}{count_of(at)}" + (f", {title}" if title else ""))
        peak_n = max(peak_n, at.raw_peak_force_n)
        left = "" if at.left_s is None else f"  {clock(at.left_s)} left"
        LIVE.show(f"trial {at.trial}{count_of(at, '/')}  {at.time_s:5.2f} s  peak {peak_n:5.1f} N{left}")

    try:
        yield update
    finally:
        LIVE.clear()
