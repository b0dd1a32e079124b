"""The first line of the report, in words: what was compared, how far apart, against which repeatability,
which events disagree.

Place in the data flow: channel and event tables → here → top of the report and of `results.json`.
Conventions: degrees for reading; the RMSE is set against the repeatability limit, the paired difference against its own
uncertainty; no model is called valid.
Failure: none; what is not known is said to be unknown.
"""

from __future__ import annotations

import math

import pandas as pd

from validation.event import EVENTS


def verdict(session: str, action: str, channels: pd.DataFrame, events: pd.DataFrame, n_trials: int) -> str:
    """One paragraph of plain text.

    Parameters
    ----------
    session, action : str
    channels, events : DataFrame
        `ValidationResult.channels` and `ValidationResult.event_summary`.
    n_trials : int
        Trials used.
    """
    scored = channels[channels["rmse_rad"].notna()]
    parts = []
    for row in scored.itertuples():
        text = f"{row.channel} {math.degrees(row.rmse_rad):.2g}° ({100 * row.rmse_over_range:.1f} % of its range"
        if row.rmse_over_s_r == row.rmse_over_s_r:
            text += f", {row.rmse_over_s_r:.1f} × s_r"
        parts.append(text + ")")
    word = "trial" if n_trials == 1 else "trials"
    sentences = [
        f"Model {action} against {n_trials} {word} of {session}, each driven by its own measured force.",
        "RMSE: " + ", ".join(parts) + "." if parts else "No channel could be scored.",
    ]
    if len(scored):
        worst = scored.loc[scored["rmse_over_range"].idxmax()]
        sentences.append(f"Worst channel relative to its range: {worst['channel']}.")
    judged = scored[scored["resolved_share"].notna()]
    if len(judged):
        shares = ", ".join(f"{row.channel} {100 * row.resolved_share:.0f} %" for row in judged.itertuples())
        sentences.append(f"Share of the window in which model and trials differ beyond the uncertainty: {shares}.")
        beyond = list(judged.loc[judged["rmse_rad"] > judged["limit_rad"], "channel"])
        sentences.append(
            "RMSE above the repeatability limit: " + ", ".join(beyond) + "."
            if beyond
            else "In no channel is the RMSE above the repeatability limit, by which two trials may differ."
        )
    sentences.append(_events(events))
    return " ".join(sentences)


def _events(events: pd.DataFrame) -> str:
    differ, doubtful, missing = [], [], []
    for row in events.itertuples():
        kind = EVENTS[row.event]
        title = kind.title.lower()
        if not row.agree:
            differ.append(f"{title} (trials {row.found_trial}, model {row.found_model} of {row.n_trials})")
        elif row.found_trial == 0 and kind.expected:
            missing.append(title)
        if row.ambiguous:
            doubtful.append(title)
    sentences = []
    sentences.append(
        "Events that happen in one but not the other: " + ", ".join(differ) + "."
        if differ
        else "Every event happens in the model as often as in the trials."
    )
    if missing:
        sentences.append("Absent in both: " + ", ".join(missing) + ".")
    if doubtful:
        sentences.append("Ambiguous: " + ", ".join(doubtful) + ".")
    return " ".join(sentences)
