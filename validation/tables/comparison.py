"""What rows are made from: the records of all stages of one comparison, and what several tables share."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import pandas as pd

from model.errors import ModelError
from validation.events.definitions import Event
from validation.events.key_lift import mark_lifted_samples
from validation.events.session_events import SessionEvents
from validation.findings.find_faults import SessionFindings
from validation.findings.finding import LeftOut, select_counted_events, select_sound_trials
from validation.measurement.measure_session import select_representative
from validation.options import ComparisonOptions
from validation.prediction.model_under_test import ModelUnderTest
from validation.prediction.motion_driven import motion_driven, motion_row
from validation.prediction.predict_session import PredictedSession
from validation.scores.perfect_model import Ceiling, score_perfect_model
from validation.scores.score_session import ScoredSession
from validation.statistics.rivals import Rivals
from validation.tables.catalogue import all_tables
from validation.verdict.verdict import Verdict


@dataclass(frozen=True)
class Comparison:
    """One session and one model after all stages; a table is made once, when first asked for."""

    predicted: PredictedSession
    events: SessionEvents
    scored: ScoredSession
    findings: SessionFindings
    verdict: Verdict
    rivals: Rivals
    tested: ModelUnderTest
    options: ComparisonOptions
    changes: Sequence[Mapping[str, Any]] = ()
    """What explains the model's difference, one row a change."""
    made: dict[str, pd.DataFrame] = field(default_factory=dict)

    def table(self, name: str) -> pd.DataFrame:
        """A table by its name."""
        if name not in self.made:
            self.made[name] = all_tables()[name].make(self)
        return self.made[name]

    @property
    def tables(self) -> dict[str, pd.DataFrame]:
        """All tables of one comparison by name; those of a report where one is written."""
        wanted = ("comparison", "report") if self.options.further else ("comparison",)
        return {name: self.table(name) for name, table in all_tables().items() if table.of in wanted}

    @property
    def without(self) -> LeftOut:
        """Trials and channels that figures of several trials do not count."""
        return self.findings.left_out

    @cached_property
    def sound(self) -> PredictedSession:
        """The session's trials without faults; all of them where each has one."""
        trials = tuple(select_sound_trials(self.predicted.trials, self.findings.faults))
        return replace(self.predicted, trials=trials or self.predicted.trials)

    @cached_property
    def counting(self) -> dict[int, dict[str, Event]]:
        """Events of the trials that count."""
        return select_counted_events(self.events.trial, self.without)

    @cached_property
    def ceiling(self) -> Ceiling:
        """Scores of a perfect model by channel and score, one value a draw; empty where no uncertainties are to be
        drawn. Computed once, with simulations unless stored."""
        if not self.options.budget:
            return Ceiling()
        self.options.say("scores of a perfect model")
        return score_perfect_model(
            self.predicted.trials, self.scored.traces, self.tested, self.without, paired=self.options.paired
        )

    @cached_property
    def motion(self) -> tuple[list[dict[str, Any]], pd.DataFrame | None, list[str]]:
        """Comparison driven by the key's motion, of the sound trial of median peak force: rows (one or none), its trace
        (None without one), and why the model cannot run, as a warning in a list. Computed once."""
        sound = select_sound_trials(self.predicted.trials, self.findings.faults)
        asked = self.options.by_motion or self.options.further
        if not (sound and asked and all(m.has_force for m in sound)):
            return [], None, []
        m = select_representative(sound)
        at = m.time_s[self.events.window.mask(m.time_s)]
        try:
            trace = motion_driven(self.tested, m, at, mark_lifted_samples(at, self.events.lifts[m.number]))
        except ModelError as error:
            return [], None, [f"trial {m.number}: not driven by its motion: {error}"]
        return [motion_row(m.number, trace, m.force.channel.gain_relative_u)], trace, []
