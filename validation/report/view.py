"""One session on the page: its results, one for each model, and what its figures and tables are called there.

What does not depend on the model (trials, repeatability) is taken from the first result.
"""

from __future__ import annotations

from dataclasses import dataclass

from validation.conventions import BODIES, ENCODER_CHANNELS, FILM_CHANNELS
from validation.result import ValidationResult
from validation.side_by_side import SideBySide

MOST_CHARACTERS = 30


def shorten_name(name: str) -> str:
    """A name with its middle left out when it is too long for a legend."""
    half = MOST_CHARACTERS // 2
    return name if len(name) <= MOST_CHARACTERS else f"{name[:half]}…{name[-half + 1 :]}"


def as_sentence(line: str) -> str:
    """A line with a full stop, and with a capital where it does not begin with a name or a number."""
    first = line.split(" ")[0]
    head = line[0].upper() if first.isalpha() else line[0]
    return f"{head}{line[1:]}{'' if line.endswith('.') else '.'}"


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
    def names(self) -> list[str]:
        """How the models are named in figures and heads: ``model`` when there is no other; long names are cut."""
        if len(self.results) == 1:
            return ["model"]
        short = [shorten_name(r.action_name) for r in self.results]
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
        """Bodies compared with a prediction: not the key where it drives the model."""
        return [c for c in BODIES if (self.first.scores["channel"] == c).any()]

    def shown_trial(self, channel: str = "") -> int:
        """The trial that is drawn with its predictions: of a body's trials the first that every model could predict."""
        own = self.first.film_traces if channel in FILM_CHANNELS else self.first.traces
        common = [t for t in own if all(t in r.traces for r in self.results)]
        return common[0] if common else next(iter(own))


def shown_trials(view: SessionView, max_trials: int) -> list[int]:
    """At most ``max_trials`` numbers of trials to show: all, or the drawn one, filmed ones, the worst and best of each
    channel, then others evenly through the session."""
    trials = list(view.first.traces)
    if len(trials) <= max_trials:
        return trials
    wanted = [view.shown_trial(), *view.first.film_traces]
    for _, part in view.first.scores.groupby("channel", sort=False):
        known = part.dropna(subset=["rmse_rad"]).sort_values("rmse_rad", kind="stable")["trial"]
        wanted += [int(t) for t in (*known.iloc[-1:], *known.iloc[:1])]
    step = len(trials) / max_trials
    wanted += [trials[int(i * step)] for i in range(max_trials)]
    chosen = [t for t in dict.fromkeys(wanted) if t in view.first.traces][:max_trials]
    return sorted(chosen, key=trials.index)


def netcdf_names(side: SideBySide) -> list[str]:
    """Names of the netCDF files, one for each session and model."""
    if len(side.results) == 1:
        return ["curves.nc"]
    return [f"curves_{i}.nc" for i in range(1, len(side.results) + 1)]
