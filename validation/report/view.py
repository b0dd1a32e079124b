"""One session on the page: its results, one for each model, and what its figures and tables are called there.

What does not depend on the model (trials, repeatability) is taken from the first result.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from validation.conventions import ENCODER_CHANNELS
from validation.result import ValidationResult
from validation.side_by_side import SideBySide

CONDITIONS = ("forte", "piano", "double")
MEASURED = {"force": "3.9", "key": "3.10", "whippen": "3.11", "hammer": "3.12", "film": "3.13"}
COMPARED = {
    "forte": {"force": "4.1", "key": "4.2", "whippen": "4.3", "hammer": "4.4"},
    "piano": {"force": "4.5", "key": "4.6", "whippen": "4.7", "hammer": "4.8"},
    "double": {"force": "4.12", "key": "4.13", "whippen": "4.14", "hammer": "4.15"},
}
RECALIBRATED = {"key": "4.9", "whippen": "4.10", "hammer": "4.11"}


def condition_of(session_name: str, profile: str) -> str:
    """The one of forte, piano and double that is named by the session or else by its profile; else an empty text."""
    for text in (session_name, profile):
        named = set(re.findall(r"[a-z]+", text.lower())) & set(CONDITIONS)
        if len(named) == 1:
            return named.pop()
    return ""


def measured_anchor(condition: str, kind: str) -> str:
    """The thesis's figure of repeated trials; it has them for the forte only."""
    return f"{'As' if condition == 'forte' else 'Drawn like'} thesis Fig. {MEASURED[kind]}."


def compared_anchor(condition: str, kind: str, n_models: int) -> str:
    """The thesis's figure of model against experiment, with two models also that of the damping calibrated anew.

    For a blow that the thesis does not have, the figure is said to be drawn like the forte's. Source: M. Hirschkorn
    (2004), Figures 3.9–3.13 (forte) and 4.1–4.15 (forte, piano, double; 4.9–4.11: piano with the damping calibrated
    anew beside the first calibration).
    """
    if condition not in COMPARED:
        return f"Drawn like thesis Fig. {COMPARED['forte'][kind]}."
    number = COMPARED[condition][kind]
    if condition == "piano" and n_models > 1 and kind in RECALIBRATED:
        return f"As thesis Figs {number} and {RECALIBRATED[kind]}."
    return f"As thesis Fig. {number}."


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

    @property
    def has_force(self) -> bool:
        """Whether a force was recorded."""
        return any(frame["force_n"].notna().any() for frame in self.first.traces.values())

    @property
    def measured(self) -> list[str]:
        """Encoders, or position sensors, that measured something."""
        frames = self.first.traces.values()
        return [c for c in ENCODER_CHANNELS if any(frame[f"{c}_measured_rad"].notna().any() for frame in frames)]

    @property
    def compared(self) -> list[str]:
        """Those of them that are compared with a prediction: not the key where it drives the model."""
        return [c for c in self.measured if (self.first.scores["channel"] == c).any()]

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


def netcdf_names(side: SideBySide) -> list[str]:
    """Names of the netCDF files, one for each session and model."""
    if len(side.results) == 1:
        return ["curves.nc"]
    return [f"curves_{i}.nc" for i in range(1, len(side.results) + 1)]
