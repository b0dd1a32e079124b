"""Mapping of a function over items: serially, or by threads that the caller provides."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Protocol, TypeVar

A = TypeVar("A")
B = TypeVar("B")


class ItemMap(Protocol):
    """Calls ``work`` with every item and returns the results in the order of the items."""

    def __call__(self, work: Callable[[A], B], items: Iterable[A], /) -> list[B]: ...


def serial_map(work: Callable[[A], B], items: Iterable[A], /) -> list[B]:
    return [work(item) for item in items]
