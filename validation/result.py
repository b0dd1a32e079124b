"""`ValidationResult`: everything the report shows, as data frames, for use in a notebook.

Conventions: SI and rad; degrees and millimetres appear only in the report.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import pandas as pd

from validation.events.evaluation_window import Window

TABLES = (
    "trials",
    "scores",
    "scorecard",
    "marked",
    "findings",
    "single_changes",
    "motion_driven",
    "channels",
    "events",
    "event_summary",
    "event_repeatability",
    "budget",
    "uncertainty",
)
"""Tables that are also written as CSV files."""


@dataclass(frozen=True)
class SessionTables:
    """Tables and traces of one session compared with one model.

    Columns of the tables and their units: ``docs/results.md``, made from ``validation/report/results.schema.json``.

    Attributes
    ----------
    warnings : list of str
        What a reader must know before using the numbers.
    window : Window
        The evaluation window of every score.
    trials : DataFrame
        One row per trial: whether it was used or why not, and what was done with its force.
    scores : DataFrame
        One row per trial and channel: every score of the model, of the null model and of the model driven by the raw
        force.
    scorecard : DataFrame
        One row per channel and score: of all trials, beside its ceiling, the score of a perfect model.
    marked : DataFrame
        Samples left out of the scores, because the key lifts.
    findings : DataFrame
        Faults of the session that were recognised.
    single_changes : DataFrame
        Changes of model or force each of which alone would take away most of the difference; no faults, and no trial
        tells them apart.
    channels : DataFrame
        One row per channel: RMSE, repeatability, and the share of the window in which model and trials differ.
    events : DataFrame
        One row per trial, source (trial or model) and event.
    event_summary, event_repeatability : DataFrame
        One row per event: model against trials, and trials among themselves.
    budget : DataFrame
        One row per event: uncertainty budget of the difference; empty when none was requested.
    uncertainty : DataFrame
        One row per trial and channel: stated uncertainty of one sample.
    spread : DataFrame
        On the common time base inside the window: time_s, then <channel>_mean_rad, _s_r_rad, _band95_rad (half width
        of the simultaneous 95 % band of the mean), _difference_rad (mean paired difference), its _difference_u95_rad
        (pointwise, 1.96 u) and _difference_band95_rad (simultaneous), both of all declared uncertainties.
    traces : dict
        Trial → DataFrame of time_s, raw_force_n, force_time_s, force_n, u_force_n, <channel>_measured_rad, key_marked,
        <body>_predicted_rad, <channel>_null_rad (null model), <channel>_raw_rad (driven by the raw force),
        <channel>_rad_per_s and <channel>_u_rad_per_s (measured speed, split at contacts, see
        `validation.events.angular_speed`).
    film_traces : dict
        Trial → DataFrame of time_s, <channel>_measured_rad, <channel>_u_rad, <channel>_predicted_rad.
    motion_driven : DataFrame
        Force predicted from the key's measured motion, in one row; empty when not requested.
    motion_trace : DataFrame or None
        The same over time, see `validation.prediction.motion_driven.motion_driven`.
    judgement : dict
        The simultaneous test of the difference: whether it was judged or why not, rejected, p, factor, draws, trials.
    nuisance : DataFrame
        Scores of each trial under drawn errors of force and sensors: trial, channel, draw, rmse_rad,
        before_impact_rmse_rad, iso_overall; the same draws for every model of a session.
    """

    warnings: list[str]
    window: Window
    trials: pd.DataFrame
    scores: pd.DataFrame
    scorecard: pd.DataFrame
    marked: pd.DataFrame
    findings: pd.DataFrame
    single_changes: pd.DataFrame
    channels: pd.DataFrame
    events: pd.DataFrame
    event_summary: pd.DataFrame
    event_repeatability: pd.DataFrame
    budget: pd.DataFrame
    uncertainty: pd.DataFrame
    spread: pd.DataFrame
    traces: dict[int, pd.DataFrame]
    film_traces: dict[int, pd.DataFrame]
    motion_driven: pd.DataFrame
    motion_trace: pd.DataFrame | None
    judgement: dict[str, Any]
    nuisance: pd.DataFrame

    @property
    def tables(self) -> dict[str, pd.DataFrame]:
        """The tables that are also written as CSV files, by name."""
        return {name: getattr(self, name) for name in TABLES}


@dataclass(frozen=True, repr=False)
class ValidationResult(SessionTables):
    """Result of comparing one session with one model: its tables and traces, and what is said of them.

    Attributes
    ----------
    session_name, action_name : str
    verdict_lines : list of str
        What was compared, how many trials, RMSE against repeatability, worst channel, events that disagree.
    provenance : dict
        Hashes, versions, tolerance and rules.
    files : dict
        What was written: name → path.
    """

    session_name: str
    action_name: str
    verdict_lines: list[str]
    provenance: dict[str, Any]
    files: dict[str, Path] = field(default_factory=dict)

    def __repr__(self) -> str:
        return f"ValidationResult({self.session_name!r}, {self.action_name!r}, {len(self.traces)} trials)"

    @property
    def verdict(self) -> str:
        """The verdict as one paragraph."""
        return " ".join(self.verdict_lines)

    def with_files(self, files: dict[str, Path]) -> ValidationResult:
        """A copy that names the files it was written to."""
        return replace(self, files=files)
