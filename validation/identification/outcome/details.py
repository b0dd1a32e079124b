"""What an identification was made with, kept for what comes after it: its page, its tables, what to record next."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from validation.identification.fit import Fitted
from validation.identification.outcome.explained import explained_lines
from validation.identification.problem import Problem
from validation.identification.profiles import Profile
from validation.identification.sources import Sources


@dataclass(frozen=True)
class Details:
    """The fit behind an `Identification`.

    Attributes
    ----------
    problem : what was fitted to what
    fitted : where it ended
    profiles : those that were made
    sources : the trials, measured
    """

    problem: Problem
    fitted: Fitted
    profiles: tuple[Profile, ...]
    sources: Sources

    @cached_property
    def explained(self) -> tuple[str, ...]:
        """Sentences on which part of the model explains the difference; found when first asked for, in seconds."""
        return explained_lines(self.problem.action, self.sources)
