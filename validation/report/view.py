"""One session on the page: its results, one for each model, and what its figures and tables are called there.

What does not depend on the model (trials, repeatability) is taken from the first result.
"""

from __future__ import annotations

from dataclasses import dataclass

from validation.report.thesis import condition_of
from validation.result import ValidationResult

MOST_CHARACTERS = 30


def shortened(name: str) -> str:
    """A name with its middle left out when it is too long for a legend."""
    half = MOST_CHARACTERS // 2
    return name if len(name) <= MOST_CHARACTERS else f"{name[:half]}…{name[-half + 1 :]}"


@dataclass(frozen=True)
class SessionView:
    """Results of one session; ``prefix`` leads every id of its part of the page."""

    results: tuple[ValidationResult, ...]
    prefix: str = ""

    @property
    def first(self) -> ValidationResult:
        """The result of the first model."""
        return self.results[0]

    @property
    def name(self) -> str:
        """Name of the session."""
        return self.first.session_name

    @property
    def condition(self) -> str:
        """Forte, piano, double, or an empty text."""
        return condition_of(self.name, str(self.first.provenance.get("session", {}).get("profile", "")))

    @property
    def names(self) -> list[str]:
        """How the models are named in figures and heads: ``model`` when there is no other; long names are cut."""
        if len(self.results) == 1:
            return ["model"]
        short = [shortened(r.action_name) for r in self.results]
        alike = len(set(short)) < len(short)
        return [f"{i}: {name}" if alike else name for i, name in enumerate(short, start=1)]

    def shown_trial(self) -> int:
        """The trial that is drawn with its predictions: the first that every model could predict."""
        common = [t for t in self.first.traces if all(t in r.traces for r in self.results)]
        return common[0] if common else next(iter(self.first.traces))


def shown_trials(view: SessionView, most: int) -> list[int]:
    """Trials to show when not all can be: the drawn one, filmed ones, the worst and best of each channel, then others
    evenly through the session."""
    trials = list(view.first.traces)
    if len(trials) <= most:
        return trials
    wanted = [view.shown_trial(), *view.first.film_traces]
    for _, part in view.first.scores.groupby("channel", sort=False):
        known = part.dropna(subset=["rmse_rad"]).sort_values("rmse_rad", kind="stable")["trial"]
        wanted += [int(t) for t in (*known.iloc[-1:], *known.iloc[:1])]
    step = len(trials) / most
    wanted += [trials[int(i * step)] for i in range(most)]
    chosen = [t for t in dict.fromkeys(wanted) if t in view.first.traces][:most]
    return sorted(chosen, key=trials.index)
