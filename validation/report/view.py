"""One session on the page: its results, one for each model, and what its figures and tables are called there.

Place in the data flow: `SideBySide.sessions` → here → figures and tables of one session.
Conventions: what does not depend on the model (trials, repeatability) is taken from the first result.
Failure: none.
"""

from __future__ import annotations

from dataclasses import dataclass

from validation.report.thesis import condition_of
from validation.result import ValidationResult


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

    def called(self, result: ValidationResult) -> str:
        """How a model is named in legends and captions: ``model`` when there is no other."""
        return "model" if len(self.results) == 1 else result.action_name

    def shown_trial(self) -> int:
        """The trial that is drawn with its predictions: the first that every model could predict."""
        common = [t for t in self.first.traces if all(t in r.traces for r in self.results)]
        return common[0] if common else next(iter(self.first.traces))
