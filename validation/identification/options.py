"""Options of an identification, as one frozen record."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import TypedDict

from validation.identification.observations import PHASES
from validation.identification.runs.placed import TOLERANCE
from validation.options import utc_now


class IdentifyKeywords(TypedDict, total=False):
    """Keywords of `validation.identify`, see `IdentifyOptions`."""

    fixed: tuple[str, ...]
    priors: Mapping[str, float]
    hold_out: tuple[str | Path, ...]
    hold_out_trials: tuple[int, ...]
    starts: int
    profiles: tuple[str, ...] | None
    phases: int
    tolerance: float
    condition: str | None
    motion_driven: bool
    film: bool
    executor: Executor | None
    progress: Callable[[str], None] | None
    now: Callable[[], datetime]


@dataclass(frozen=True)
class IdentifyOptions:
    """How to identify.

    Attributes
    ----------
    fixed : names held at the action's values, see `validation.identification.unknowns.naming`
    priors : name -> standard uncertainty before the strokes; relative for laws of friction, felt and springs, SI else
    hold_out : sessions that are not fitted and only predicted
    hold_out_trials : numbers of trials that are not fitted, in every session
    starts : how many points the fit starts from; the first is the action's own values
    profiles : names to make a profile of; by default all that were asked for
    phases : how many times of each trial are compared
    tolerance : largest error of any angle of a run, rad
    condition : condition of the trial plan to use
    motion_driven : the key's measured motion drives the model in all trials, not only in those without a force
    film : compare jack and repetition lever as tracked on films, too
    executor : where the model runs; by default threads of this process
    progress : called with a line of text
    now : the clock of the date in the provenance
    """

    fixed: tuple[str, ...] = ()
    priors: Mapping[str, float] = field(default_factory=dict)
    hold_out: tuple[str | Path, ...] = ()
    hold_out_trials: tuple[int, ...] = ()
    starts: int = 1
    profiles: tuple[str, ...] | None = None
    phases: int = PHASES
    tolerance: float = TOLERANCE
    condition: str | None = None
    motion_driven: bool = False
    film: bool = False
    executor: Executor | None = None
    progress: Callable[[str], None] | None = None
    now: Callable[[], datetime] = utc_now

    def say(self, text: str) -> None:
        """Report progress."""
        if self.progress is not None:
            self.progress(text)
