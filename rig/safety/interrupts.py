"""Ctrl-C and SIGTERM: turned into an exception, and deferred while the bench is made safe or a trial is sealed.

Only the main thread receives signals; elsewhere the blocks run as they are. A deferred interrupt is delivered when the
block ends. What is done then: `rig.recording.trial_run.run_trial`; what is told: `pianorig/workflows/recording.py`.
A program that is killed outright runs none of this; watchdog and journal are for that.
"""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from types import FrameType
from typing import Any

from rig import platform_calls


class Terminated(KeyboardInterrupt):
    """The system or another program asked this one to end."""


@contextlib.contextmanager
def _handle_signals(
    handler: Callable[[int, FrameType | None], object], numbers: Iterable[int], may_replace: Callable[[Any], bool]
) -> Iterator[dict[int, Any]]:
    """Handle signals in the block where their present handler may be replaced; yield those replaced, by number."""
    previous: dict[int, Any] = {}
    if threading.current_thread() is threading.main_thread():
        previous = {number: before for number in numbers if may_replace(before := signal.getsignal(number))}
    try:
        for number in previous:
            signal.signal(number, handler)
        yield previous
    finally:
        for number, before in previous.items():
            signal.signal(number, before)


@contextlib.contextmanager
def termination_as_interrupt() -> Iterator[None]:
    """Raise :class:`Terminated` inside the block when the program is asked to end, so that it ends like Ctrl-C."""

    def terminate(number: int, frame: FrameType | None) -> None:
        raise Terminated(f"stopped by {signal.Signals(number).name}")

    # a handler installed by somebody else stays
    with _handle_signals(terminate, platform_calls.ending_signals(), lambda before: before is signal.SIG_DFL):
        yield


@contextlib.contextmanager
def defer_interrupts() -> Iterator[None]:
    """Hold back Ctrl-C and the signals that end a program until the block has ended, then hand the last one to the
    handler that was there before."""
    waiting: list[tuple[int, FrameType | None]] = []
    previous: dict[int, Any] = {}
    numbers = platform_calls.ending_signals(with_keyboard=True)
    try:
        # callable: not installed by C code, nor the system's default
        with _handle_signals(lambda at, frame: waiting.append((at, frame)), numbers, callable) as previous:
            yield
    finally:
        if waiting:
            previous[waiting[-1][0]](*waiting[-1])
