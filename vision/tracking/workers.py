"""Threads that track parts of one film."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from typing import ParamSpec, TypeVar

from vision.item_map import serial_map

MOST_THREADS = 8  # choice: more wait for the memory bus
A = TypeVar("A")
B = TypeVar("B")
P = ParamSpec("P")
T = TypeVar("T")


class StoppedError(Exception):
    """The run has ended before this part of it."""


def usable_threads() -> int:
    """Processors this program may use, at most `MOST_THREADS`."""
    # platform: only Linux tells which processors a program is restricted to
    allowed = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(allowed, MOST_THREADS)


class Workers:
    """Does work in threads; without a pool of them, where it is asked for."""

    def __init__(self, pool: ThreadPoolExecutor | None) -> None:
        self._pool = pool
        self.stop = threading.Event()

    def submit(self, work: Callable[P, T], *arguments: P.args, **named: P.kwargs) -> Future[T]:
        if self._pool is not None:
            return self._pool.submit(work, *arguments, **named)
        future: Future[T] = Future()
        future.set_result(work(*arguments, **named))
        return future

    def map_items(self, work: Callable[[A], B], items: Iterable[A], /) -> list[B]:
        """Have work done for each of several items; an error is that of the first item that has one."""
        return (
            serial_map(work, items)
            if self._pool is None
            else serial_map(wait_for_result, [self.submit(work, i) for i in items])
        )

    def check(self) -> None:
        """Raise `StoppedError` when the run has ended."""
        if self.stop.is_set():
            raise StoppedError


@contextmanager
def workers(threads: int) -> Iterator[Workers]:
    """Context manager: ``threads`` threads to which work is submitted, which end with the block, at once where it ends
    by an error; with 1 work is done in the thread that submits it."""
    if threads == 1:
        yield Workers(None)
        return
    with ThreadPoolExecutor(threads) as pool:
        crew = Workers(pool)
        try:
            yield crew
        finally:
            crew.stop.set()
            pool.shutdown(wait=True, cancel_futures=True)


def wait_for_result(future: Future[T]) -> T:
    """Result of a future, or the exception of its work, waited for in short intervals, so that Ctrl-C is handled on
    Windows."""
    while True:
        try:
            return future.result(timeout=0.5)
        except TimeoutError:
            if future.done():
                raise
