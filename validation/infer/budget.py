"""Processor time that an estimation may take, and how it ended."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

CONVERGED = "converged"
BIFURCATION = "at a bifurcation"
NOT_IDENTIFIABLE = "not identifiable"
OUT_OF_BUDGET = "out of budget"


@dataclass(frozen=True)
class End:
    """How an estimation ended: one of the four kinds above, and what there is to say of it."""

    kind: str
    detail: str = ""
    by_user: bool = False  # whether Ctrl-C ended it

    @property
    def is_settled(self) -> bool:
        """Whether the values are those of a minimum, or of one up to a bifurcation."""
        return self.kind != OUT_OF_BUDGET

    def __str__(self) -> str:
        return f"{self.kind}: {self.detail}" if self.detail else self.kind


class Budget:
    """Processor time of this process that may still be used.

    Parameters
    ----------
    seconds : from now on
    clock : seconds of processor time so far

    Examples
    --------
    >>> budget = Budget(10.0, clock=lambda: 0.0)
    >>> budget.is_spent, budget.fraction(0.5).left_s
    (False, 5.0)
    """

    def __init__(self, seconds: float, clock: Callable[[], float] = time.process_time) -> None:
        self.clock, self.until_s, self._whole = clock, clock() + seconds, self
        self._interrupted = False

    @property
    def left_s(self) -> float:
        """Seconds left; none after Ctrl-C."""
        return 0.0 if self.is_interrupted else self.until_s - self.clock()

    @property
    def is_interrupted(self) -> bool:
        """Whether Ctrl-C ended it."""
        return self._whole._interrupted

    @property
    def is_spent(self) -> bool:
        """Whether nothing is left."""
        return self.left_s <= 0.0

    def fraction(self, share: float) -> Budget:
        """A budget of a share of what is left; Ctrl-C ends both."""
        part = Budget(share * max(self.left_s, 0.0), self.clock)
        part._whole = self._whole
        return part

    @contextmanager
    def interruptible(self) -> Iterator[None]:
        """Take Ctrl-C for the end of the budget: what was found before is kept."""
        try:
            yield
        except KeyboardInterrupt:
            self._whole._interrupted = True
