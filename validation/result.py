"""`ValidationResult`: everything the report shows, as data frames, for use in a notebook.

Conventions: SI and rad; degrees and millimetres appear only in the report.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import pandas as pd

from validation.events.evaluation_window import Window


@dataclass(frozen=True, repr=False)
class ValidationResult:
    """Result of comparing one session with one model.

    Attributes
    ----------
    session_name, action_name : str
    verdict_lines : list of str
        What was compared, how many trials, RMSE against repeatability, worst channel, events that disagree.
    warnings : list of str
        What a reader must know before using the numbers.
    window : Window
        The evaluation window of every score.
    trials : DataFrame
        One row per trial: trial, used, reason, quiet_s, onset_s, offset_n, u_offset_n, hum_hz, hum_1_n …
        hum_3_n, hum_accepted, noise_n, preload_n, group_delay_s, peak_force_n, filmed, reused, notes.
    scores : DataFrame
        One row per trial and channel: trial, channel, source, rmse_over_s_r, the scores of
        `validation.scores.curve_scores.SCORES`, iso_shift_s, bias_rad, scatter_rad, largest_rad, largest_at_s, n,
        n_lost, iso_guards (what makes the ISO-style score doubtful), the same scores of the null model (null_…) and
        of the model driven by the raw force (raw_force_…), u_rms_rad.
    scorecard : DataFrame
        One row per channel and score: channel, score, title, unit, better (lower or higher), value (of the model,
        over all trials), ceiling (the same score of trial against trial), pairs (how many of them), null (of the null
        model), raw_force.
    marked : DataFrame
        Samples left out of the scores: trial, channel, start_s, end_s, largest_at_s, gap_m, lift_m, rail_pull_n,
        reason.
    findings : DataFrame
        Faults of the session that were recognised: kind, trial, channel, value, limit, text.
    channels : DataFrame
        One row per channel: channel, source, n_trials, rmse_rad (root mean square over trials), range_rad,
        rmse_over_range, s_r_rad, s_r_low_rad, s_r_high_rad, s_r_largest_rad, limit_rad, rmse_over_s_r,
        band_factor (of the simultaneous 95 % band), trial_to_trial_rmse_rad, pairs, null_rmse_rad, iso_overall,
        iso_ceiling (trial against trial), iso_null, mean_difference_rad, resolved_share (of the window in which the
        mean paired difference leaves its simultaneous 95 % band), resolved_pointwise_share (instant by instant), state.
    events : DataFrame
        One row per trial, source (trial or model) and event: trial, source, event, value, u, unit, status,
        note.
    event_summary : DataFrame
        One row per event: event, unit, n_trials, found_trial, found_model, agree, trial_mean, trial_s,
        model_mean, difference, difference_s, u_difference, n_both, u_trial (stated, of one trial), area (area metric),
        area_floor and area_floor_95 (its mean and 95th percentile for a perfect model and so many trials).
    event_repeatability : DataFrame
        See `validation.statistics.repeatability.event_repeatability`.
    budget : DataFrame
        See `validation.statistics.event_budget.event_budget`; empty when it was not asked for.
    uncertainty : DataFrame
        One row per trial and channel: trial, channel, source, quantisation_rad, u_rad (one sample), scale_relative_u.
    spread : DataFrame
        On the common time base inside the window: time_s, then <channel>_mean_rad, _s_r_rad, _band95_rad (half width
        of the simultaneous 95 % band of the mean), _difference_rad (mean paired difference), its _difference_u95_rad
        (pointwise) and _difference_band95_rad (simultaneous).
    traces : dict
        Trial → DataFrame of time_s, raw_force_n, force_time_s, force_n, u_force_n, <channel>_measured_rad, key_marked,
        <body>_predicted_rad, <channel>_null_rad (null model), <channel>_raw_rad (driven by the raw force),
        <channel>_rad_per_s and <channel>_u_rad_per_s (measured speed, split at contacts, see
        `validation.events.angular_speed`).
    film_traces : dict
        Trial → DataFrame of time_s, <channel>_measured_rad, <channel>_u_rad, <channel>_predicted_rad.
    motion_driven : DataFrame
        Force predicted from the key's measured motion: see `validation.prediction.motion_driven.COLUMNS`; empty when
        not asked for.
    motion_trace : DataFrame or None
        See `validation.prediction.motion_driven.motion_driven`.
    provenance : dict
        Hashes, versions, tolerance and rules.
    files : dict
        What was written: name → path.
    """

    session_name: str
    action_name: str
    verdict_lines: list[str]
    warnings: list[str]
    window: Window
    trials: pd.DataFrame
    scores: pd.DataFrame
    scorecard: pd.DataFrame
    marked: pd.DataFrame
    findings: pd.DataFrame
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
    provenance: dict[str, Any]
    files: dict[str, Path] = field(default_factory=dict)

    def __repr__(self) -> str:
        return f"ValidationResult({self.session_name!r}, {self.action_name!r}, {len(self.traces)} trials)"

    @property
    def verdict(self) -> str:
        """The verdict as one paragraph."""
        return " ".join(self.verdict_lines)

    @property
    def tables(self) -> dict[str, pd.DataFrame]:
        """The tables that are also written as CSV files, by name."""
        return {
            "trials": self.trials,
            "scores": self.scores,
            "scorecard": self.scorecard,
            "marked": self.marked,
            "findings": self.findings,
            "motion_driven": self.motion_driven,
            "channels": self.channels,
            "events": self.events,
            "event_summary": self.event_summary,
            "event_repeatability": self.event_repeatability,
            "budget": self.budget,
            "uncertainty": self.uncertainty,
        }

    def with_files(self, files: dict[str, Path]) -> ValidationResult:
        """A copy that names the files it was written to."""
        return replace(self, files=files)
