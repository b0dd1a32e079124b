"""Ctrl-C and SIGTERM: turned into an exception, and deferred while the bench is made safe or a trial is sealed.

Only the main thread receives signals; elsewhere the blocks run as they are. A deferred interrupt is delivered when the
block ends. A program that is killed outright runs none of this; watchdog and journal are for that.
"""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Iterator
from types import FrameType
from typing import Any

from rig.storage import platform_calls


class Terminated(KeyboardInterrupt):
    """The system or another program asked this one to end."""


@contextlib.contextmanager
def termination_as_interrupt() -> Iterator[None]:
    """Raise :class:`Terminated` inside the block when the program is asked to end, so that it ends like Ctrl-C."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def terminate(number: int, frame: FrameType | None) -> None:
        raise Terminated(f"stopped by {signal.Signals(number).name}")

    previous: dict[int, Any] = {}
    for number in platform_calls.ending_signals():
        if signal.getsignal(number) is signal.SIG_DFL:  # a handler installed by somebody else stays
            previous[number] = signal.signal(number, terminate)
    try:
        yield
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)


@contextlib.contextmanager
def deferred() -> Iterator[None]:
    """Defer Ctrl-C and the signals that end a program until the block has ended."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    waiting: list[tuple[int, FrameType | None]] = []
    previous: dict[int, Any] = {}
    for number in platform_calls.ending_signals(with_keyboard=True):
        handler = signal.getsignal(number)
        if callable(handler):  # not installed by C code, nor the system's default
            previous[number] = handler
            signal.signal(number, lambda at, frame: waiting.append((at, frame)))
    try:
        yield
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)
        if waiting:
            previous[waiting[-1][0]](*waiting[-1])
