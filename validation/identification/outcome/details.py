"""What an identification was made with, kept for what comes after it: its page, its tables, what to record next."""

from __future__ import annotations

from dataclasses import dataclass

from validation.identification.fit import Fitted, Problem
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
    followed : the problem whose residuals at the fit are those of the fit: each trial at its own scatter
    """

    problem: Problem
    fitted: Fitted
    profiles: tuple[Profile, ...]
    sources: Sources
    followed: Problem
