"""The first lines of the report: what was compared, and what the stated uncertainties allow to say of the difference.

Conventions: degrees for reading. The head is the outcome of `validation.verdict`; an RMSE is set against the RMSE that
a model without error would reach; no model is called valid; what is not known is left out or said to be unknown.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import pandas as pd

import model
from validation.events.definitions import EVENTS
from validation.findings.finding import SessionFinding, summary_line
from validation.findings.unusable import list_unusable_data, name_unusable
from validation.measurement.trial import MeasuredTrial, trials_in_words
from validation.prediction.posterior import list_alterations, posterior_of
from validation.verdict.verdict import MOST_NAMED, Verdict, quantity_words, sort_by_importance


def fitted_trials(action: model.Action, trials: Sequence[MeasuredTrial]) -> list[int]:
    """Numbers of the trials that the action's values were fitted to; empty for an action that was not identified."""
    posterior = posterior_of(action)
    return [m.number for m in trials if posterior is not None and posterior.was_fitted_to(m.seal, m.samples)]


def prediction_lines(action: model.Action, trials: Sequence[MeasuredTrial]) -> list[str]:
    """One sentence, in a list, on which of the trials an identified model was fitted to, by their hashes, and so
    whether this is a prediction; empty list for a model that was not identified."""
    posterior = posterior_of(action)
    if posterior is None:
        return []
    fitted = fitted_trials(action, trials)
    n = len(posterior.trials)
    doubts = list_alterations(action)
    if not fitted:
        none = f"none of these trials is among the {n} that the values of {action.name} were fitted to (by hash)"
        if doubts:
            return [f"Whether this is a prediction is not known: {none}, but {'; '.join(doubts)}."]
        return [f"A prediction: {none}."]
    aside = [m.number for m in trials if m.number not in fitted]
    which = trials_in_words(fitted) if aside else "all of these trials"
    if aside and doubts:  # what the file says of the others may be wrong
        return [f"Not a prediction: the values of {action.name} were fitted to {which} (by hash); {'; '.join(doubts)}."]
    kept = f"; {trials_in_words(aside)} {'was' if len(aside) == 1 else 'were'} kept aside" if aside else ""
    return [
        f"Not a prediction: the values of {action.name} were fitted to {which} (by hash){kept}; how well fitted trials "
        "are met says nothing of other strokes."
    ]


def identified_warnings(action: model.Action) -> list[str]:
    if posterior_of(action) is None:
        return []
    said = [f"{action.name} was identified: {line}" for line in action.identification.get("warnings", [])]
    changed = "; the band still holds its joint uncertainty, about the values now"
    return said + [f"{action.name}: {line}{changed}" for line in list_alterations(action)]


def verdict_lines(
    session: str,
    action: str,
    tables: Mapping[str, pd.DataFrame],
    verdict: Verdict,
    findings: Sequence[SessionFinding] = (),
    nearer: str = "",
    by_key: bool = False,
) -> list[str]:
    """Sentences of the verdict, the most important first, from the names of session and model, their ``tables`` by
    name, the verdict and the findings; ``nearer``: clause on nearer rivals, ``by_key``: whether the key drives.

    Parameters
    ----------
    tables : of the session; ``trials``, ``channels`` and ``event_summary`` are read
    findings : of the session
    nearer : what is to be said where a rival is nearer, see `validation.statistics.skill`
    by_key : whether the measured key drives the model
    """
    scored = tables["channels"][tables["channels"]["rmse_rad"].notna()]
    n_trials = int(tables["trials"]["used"].sum())
    trials = "1 trial" if n_trials == 1 else f"{n_trials} trials"
    drive = "motion of the key" if by_key else "force"
    head = f"Model {action} against {trials} of {session}, each driven by its own measured {drive}: {verdict.sentence}"
    if nearer:
        head += f" {nearer}"
    events = tables["event_summary"]
    differing = int((~events["agree"].astype(bool)).sum())
    if differing:
        head += f" {differing} kind{'s' if differing > 1 else ''} of event happen in one but not in the other."
    left_out = name_unusable(list_unusable_data(findings))
    lines = [text for text in (head, summary_line(findings), left_out and f"Left out: {left_out}.") if text]
    lines += (
        _plain_difference_lines(verdict.quantities)
        + _excluded_alone_lines(verdict.quantities)
        + _describe_draws(verdict.facts)
    )
    if len(scored):
        lines.append("RMSE: " + "; ".join(f"{row['channel']} {_score(row)}" for _, row in scored.iterrows()) + ".")
    return lines + _score_lines(scored) + _describe_events(events)


def _plain_difference_lines(quantities: pd.DataFrame) -> list[str]:
    """The plain differences of the primary quantities that matter most, with measurement and repeatability only."""
    known = sort_by_importance(quantities)[:MOST_NAMED]
    if not len(known):
        return []
    parts = [quantity_words(row, ("plain_low", "plain_high")) for row in known.itertuples()]
    return [f"Plain difference (95 %, measurement and repeatability only): {'; '.join(parts)}."]


def _excluded_alone_lines(quantities: pd.DataFrame) -> list[str]:
    """Quantities whose individual interval alone excludes an error of zero."""
    alone = quantities[quantities["alone"].astype(bool)]
    if not len(alone):
        return []
    parts = "; ".join(map(quantity_words, alone.itertuples()))
    return [f"Alone (excluded by its own 95 % interval, not by the test of all together): {parts}."]


def _describe_draws(facts: Mapping[str, Any]) -> list[str]:
    """One sentence, in a list, on the draws and trials that the intervals rest on, from the ``facts`` of a verdict by
    name; empty list where nothing was judged."""
    if not facts.get("judged", False):
        return []
    least = "at least " if len(facts["drawn_trials"]) > 1 else ""  # of the conditions
    share = f"{least}{100 * facts['branch_share']:.3g} %"
    drawn = trials_in_words(facts["drawn_trials"])
    scatter = trials_in_words(facts["trials"], MOST_TRIALS)
    return [
        f"Intervals: {facts['draws']} draws of force, sensors and parameters on {drawn}, of which {share} move as the "
        f"trials do ({facts['branch']}); scatter of {scatter}. Simultaneous test: "
        f"p {facts['p']:.3f}."
    ]


MOST_TRIALS = 6  # named


def _score(row: Any) -> str:
    text = f"{math.degrees(row['rmse_rad']):.2g}°"
    parts = [f"{100 * row['rmse_over_range']:.2g} % of its range"] if math.isfinite(row["rmse_over_range"]) else []
    if math.isfinite(row["rmse_right_rad"]):
        right, most = math.degrees(row["rmse_right_rad"]), math.degrees(row["rmse_right_95_rad"])
        parts.append(f"expected without an error of the model {right:.2g}°, in 95 % below {most:.2g}°")
    return text + (f" ({'; '.join(parts)})" if parts else "")


def _score_lines(scored: pd.DataFrame) -> list[str]:
    """One sentence, in a list, with the ISO-style score of each channel and that of a perfect model, from rows of the
    channel table; empty list where none has one."""
    shown = [
        f"{row.channel} {row.iso_overall:.2f}" + (f" ({row.iso_ceiling:.2f})" if math.isfinite(row.iso_ceiling) else "")
        for row in scored.itertuples()
        if math.isfinite(row.iso_overall)
    ]
    text = "ISO 18571-style score, 1 at best, in brackets that of a perfect model: "
    return [text + ", ".join(shown) + "."] if shown else []


def _describe_events(events: pd.DataFrame) -> list[str]:
    """Sentences on the events that only trials or only model have, that neither has, that no trial counts and that are
    ambiguous, from the table ``event_summary``; empty if nothing is to be said."""
    differ, doubtful, missing, uncounted = [], [], [], []
    for row in events.itertuples():
        kind = EVENTS[str(row.event)]
        title = kind.title.lower()
        if not row.n_trials:
            uncounted.append(title)
        elif not row.agree:
            differ.append(f"{title} (trials {row.found_trial}, model {row.found_model} of {row.n_trials})")
        elif row.found_trial == 0 and kind.expected:
            missing.append(title)
        if row.ambiguous:
            doubtful.append(title)
    labels = {
        "Events in one but not in the other": differ,
        "Neither in the records nor in the model": missing,
        "Not counted (left out in all trials)": uncounted,
        "Ambiguous": doubtful,
    }
    return [f"{label}: {', '.join(names)}." for label, names in labels.items() if names]
