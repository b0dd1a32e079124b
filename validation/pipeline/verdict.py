"""The first lines of the report: what was compared, how far apart, against which repeatability, which events differ.

Conventions: degrees for reading; the RMSE is set against the repeatability limit, the paired difference against its own
uncertainty; no model is called valid; what is not known is left out or said to be unknown.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import pandas as pd

from validation.events.definitions import EVENTS
from validation.findings.finding import SessionFinding, distorted_trials, summary_line


def verdict_lines(
    session: str,
    action: str,
    channels: pd.DataFrame,
    events: pd.DataFrame,
    n_trials: int,
    findings: Sequence[SessionFinding] = (),
) -> list[str]:
    """The verdict as sentences, the most important first.

    Parameters
    ----------
    session, action : str
    channels, events : DataFrame
        `ValidationResult.channels` and `ValidationResult.event_summary`.
    n_trials : int
        Trials used.
    findings : sequence of SessionFinding
        Faults of the session.
    """
    scored = channels[channels["rmse_rad"].notna()]
    trials = "1 trial" if n_trials == 1 else f"{n_trials} trials"
    head = f"Model {action} against {trials} of {session}, each driven by its own measured force: "
    ranked = scored[scored["rmse_over_range"].notna()]
    if len(ranked):
        worst = ranked.loc[ranked["rmse_over_range"].astype(float).idxmax()]
        head += f"largest RMSE for its range: {worst['channel']} {_score(worst)}; "
    differing = int((~events["agree"].astype(bool)).sum())
    head += (
        "every event happens in the model as often as in the trials."
        if differing == 0
        else f"{differing} kind{'s' if differing > 1 else ''} of event happen in one but not in the other."
    )
    lines = [text for text in (head, summary_line(findings)) if text]
    if len(scored):
        lines.append("RMSE: " + "; ".join(f"{row['channel']} {_score(row)}" for _, row in scored.iterrows()) + ".")
    lines += _beside_ceiling(scored)
    lines += _against_repeatability(scored, distorted_trials(findings))
    return lines + _events(events)


def _score(row: Any) -> str:
    text = f"{math.degrees(row['rmse_rad']):.2g}°"
    if math.isfinite(row["rmse_over_range"]):
        text += f" ({100 * row['rmse_over_range']:.2g} % of its range"
        ceiling = math.degrees(row["trial_to_trial_rmse_rad"])
        text += f"; one trial against another {ceiling:.2g}°)" if math.isfinite(ceiling) else ")"
    return text


def _beside_ceiling(scored: pd.DataFrame) -> list[str]:
    """The ISO-style score of each channel beside what trials score among themselves."""
    shown = [
        f"{row.channel} {row.iso_overall:.2f}" + (f" ({row.iso_ceiling:.2f})" if math.isfinite(row.iso_ceiling) else "")
        for row in scored.itertuples()
        if math.isfinite(row.iso_overall)
    ]
    text = "ISO 18571-style score, 1 at best, in brackets that of one trial against another: "
    return [text + ", ".join(shown) + "."] if shown else []


def _against_repeatability(scored: pd.DataFrame, distorted: list[int]) -> list[str]:
    if distorted:
        return [
            "Not judged against repeatability: sᵣ, limits and bands hold faulty trials "
            f"({', '.join(map(str, distorted))}) and are too wide, which flatters the model; mend or reject them "
            "(pianorig annotate) and validate again."
        ]
    judged = scored[scored["resolved_share"].notna()]
    if not len(judged):
        return []
    shares = ", ".join(f"{row.channel} {100 * row.resolved_share:.0f} %" for row in judged.itertuples())
    beyond = list(judged.loc[judged["rmse_rad"] > judged["limit_rad"], "channel"])
    return [
        f"Share of the window in which model and trials differ beyond the simultaneous 95 % band: {shares}.",
        f"RMSE above the repeatability limit: {', '.join(beyond)}."
        if beyond
        else "In no channel is the RMSE above the repeatability limit, by which two trials may differ.",
    ]


def _events(events: pd.DataFrame) -> list[str]:
    differ, doubtful, missing = [], [], []
    for row in events.itertuples():
        kind = EVENTS[str(row.event)]
        title = kind.title.lower()
        if not row.agree:
            differ.append(f"{title} (trials {row.found_trial}, model {row.found_model} of {row.n_trials})")
        elif row.found_trial == 0 and kind.expected:
            missing.append(title)
        if row.ambiguous:
            doubtful.append(title)
    labels = (("Events in one but not in the other", differ), ("Absent in both", missing), ("Ambiguous", doubtful))
    return [f"{label}: {', '.join(names)}." for label, names in labels if names]
