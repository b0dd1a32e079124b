"""The first lines of the report: what was compared, and what the stated uncertainties allow to say of the difference.

Conventions: degrees for reading. The head is the outcome of the simultaneous test (`simultaneous_test`): *model error
shown in …*, *agrees within the stated uncertainty*, or *cannot be judged, because …*; an RMSE is set against the RMSE
that a right model would reach; no model is called valid; what is not known is left out or said to be unknown.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import pandas as pd

import model
from validation.curves.display_signs import SIGN
from validation.events.definitions import EVENTS
from validation.findings.finding import SessionFinding, summary_line
from validation.findings.unusable import name_unusable, unusable_data
from validation.measurement.trial import MeasuredTrial, trials_in_words
from validation.prediction.posterior import altered, posterior_of
from validation.result import AGREES, ERROR_SHOWN, NOT_JUDGED
from validation.statistics.paired_difference import SHOWN


def fitted_trials(action: model.Action, trials: Sequence[MeasuredTrial]) -> list[int]:
    """Numbers of the trials that the action's values were fitted to; empty for an action that was not identified."""
    posterior = posterior_of(action)
    return [m.number for m in trials if posterior is not None and posterior.was_fitted_to(m.seal, m.samples)]


def prediction_lines(action: model.Action, trials: Sequence[MeasuredTrial]) -> list[str]:
    """What the verdict says of an identified model: prediction or not; nothing of any other model."""
    posterior = posterior_of(action)
    if posterior is None:
        return []
    fitted = fitted_trials(action, trials)
    n = len(posterior.trials)
    doubts = altered(action)
    if not fitted:
        none = f"none of these trials is among the {n} that the values of {action.name} were fitted to (by hash)"
        if doubts:
            return [f"Whether this is a prediction is not known: {none}, but {'; '.join(doubts)}."]
        return [f"A prediction: {none}."]
    aside = [m.number for m in trials if m.number not in fitted]
    which = trials_in_words(fitted) if aside else "all of these trials"
    if aside and doubts:  # what the file says of the others may be wrong
        return [f"Not a prediction: the values of {action.name} were fitted to {which} (by hash); {'; '.join(doubts)}."]
    kept = f"; {trials_in_words(aside)} {'was' if len(aside) == 1 else 'were'} not fitted" if aside else ""
    return [
        f"Not a prediction: the values of {action.name} were fitted to {which} (by hash){kept}; how well fitted trials "
        "are met says nothing of other strokes."
    ]


def identified_warnings(action: model.Action) -> list[str]:
    """Warnings of the identification that an action's values come from."""
    if posterior_of(action) is None:
        return []
    said = [f"{action.name} was identified: {line}" for line in action.identification.get("warnings", [])]
    changed = "; the band still holds its joint uncertainty, about the values now"
    return said + [f"{action.name}: {line}{changed}" for line in altered(action)]


@dataclass(frozen=True)
class Standing:
    """What the head of the verdict is made of beside the tables of channels and events.

    Attributes
    ----------
    judgement : `validation.result.SessionTables.judgement`
    budget : the uncertainty budget of the events
    nearer : what is to be said where a rival is nearer, see `validation.statistics.skill`
    phases : the judged difference by channel and phase
    """

    judgement: Mapping[str, Any] = field(default_factory=dict)
    budget: pd.DataFrame = field(default_factory=pd.DataFrame)
    nearer: str = ""
    phases: pd.DataFrame = field(default_factory=pd.DataFrame)


def verdict_lines(
    session: str,
    action: str,
    channels: pd.DataFrame,
    events: pd.DataFrame,
    n_trials: int,
    findings: Sequence[SessionFinding] = (),
    standing: Standing = Standing(),
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
    standing : Standing
    """
    scored = channels[channels["rmse_rad"].notna()]
    trials = "1 trial" if n_trials == 1 else f"{n_trials} trials"
    head = f"Model {action} against {trials} of {session}, each driven by its own measured force: "
    head += outcome(channels, standing.phases, standing.judgement)[1]
    if standing.nearer:
        head += f" {standing.nearer}"
    differing = int((~events["agree"].astype(bool)).sum())
    if differing:
        head += f" {differing} kind{'s' if differing > 1 else ''} of event happen in one but not in the other."
    left_out = name_unusable(unusable_data(findings))
    lines = [text for text in (head, summary_line(findings), left_out and f"Left out: {left_out}.") if text]
    if len(scored):
        lines.append("RMSE: " + "; ".join(f"{row['channel']} {_score(row)}" for _, row in scored.iterrows()) + ".")
    lines += _beside_ceiling(scored)
    return lines + _shares(scored, standing.judgement) + _resolved(standing.budget) + _events(events)


def outcome(channels: pd.DataFrame, phases: pd.DataFrame, judgement: Mapping[str, Any]) -> tuple[str, str]:
    """One of `validation.result.OUTCOMES`, and the same in one sentence.

    Parameters
    ----------
    channels, phases : DataFrame
        `ValidationResult.channels` and ``phases``.
    judgement : `validation.result.SessionTables.judgement`
    """
    if not judgement.get("judged", False):
        return (
            NOT_JUDGED,
            f"cannot be judged, because {judgement.get('reason', 'the uncertainty budget was not made')}.",
        )
    known = channels[channels["largest_ratio"].notna()]
    if not len(known):
        return NOT_JUDGED, "cannot be judged, because no channel is known in model and trials."
    limit = f"{judgement['factor']:.2g} u allowed for all channels and times together"
    worst = known.sort_values("largest_ratio", ascending=False, kind="stable").iloc[0]
    shown = known[known["judgement"] == SHOWN].sort_values("largest_ratio", ascending=False, kind="stable")
    if not len(shown):
        most = f"{worst['largest_ratio']:.2g} u, in {worst['channel']}{_phase(phases, worst)}"
        return AGREES, f"agrees within the stated uncertainty (largest difference {most}; {limit})."
    degrees = SIGN[str(worst["channel"])] * math.degrees(worst["largest_ratio_difference_rad"])
    return ERROR_SHOWN, (
        f"model error shown in {', '.join(shown['channel'])}, largest in {worst['channel']}{_phase(phases, worst)}: "
        f"{degrees:+.2g}° at {worst['largest_ratio_at_s']:.3f} s, {worst['largest_ratio']:.2g} u ({limit})."
    ).replace("-", "−")


def _phase(phases: pd.DataFrame, channel: Any) -> str:
    """The phase of a channel's largest difference, in brackets; empty where there is none."""
    own = phases[(phases["channel"] == channel["channel"]) & phases["ratio"].notna()] if len(phases) else phases
    return f" ({own.sort_values('ratio', kind='stable')['phase'].iloc[-1]})" if len(own) else ""


def _score(row: Any) -> str:
    text = f"{math.degrees(row['rmse_rad']):.2g}°"
    parts = [f"{100 * row['rmse_over_range']:.2g} % of its range"] if math.isfinite(row["rmse_over_range"]) else []
    if math.isfinite(row["rmse_right_rad"]):
        right, most = math.degrees(row["rmse_right_rad"]), math.degrees(row["rmse_right_95_rad"])
        parts.append(f"a right model {right:.2g}°, in 95 % below {most:.2g}°")
    return text + (f" ({'; '.join(parts)})" if parts else "")


def _beside_ceiling(scored: pd.DataFrame) -> list[str]:
    """The ISO-style score of each channel beside what a perfect model would score."""
    shown = [
        f"{row.channel} {row.iso_overall:.2f}" + (f" ({row.iso_ceiling:.2f})" if math.isfinite(row.iso_ceiling) else "")
        for row in scored.itertuples()
        if math.isfinite(row.iso_overall)
    ]
    text = "ISO 18571-style score, 1 at best, in brackets that of a perfect model: "
    return [text + ", ".join(shown) + "."] if shown else []


def _shares(scored: pd.DataFrame, judgement: Mapping[str, Any]) -> list[str]:
    """Share of the window outside the band, and what the band is made of."""
    judged = scored[scored["resolved_share"].notna()]
    if not len(judged) or not judgement.get("judged", False):
        return []
    shares = ", ".join(f"{row.channel} {100 * row.resolved_share:.0f} %" for row in judged.itertuples())
    made = f"{judgement['draws']} draws of force, sensors and parameters on trials "
    made += ", ".join(map(str, judgement["trials"]))
    scatter = "; scatter of the trials added" if judgement["scatter_of_trials_added"] else ""
    return [
        f"Share of the window in which model and trials differ beyond the simultaneous 95 % band: {shares} ({made}"
        f"{scatter})."
    ]


def _resolved(budget: pd.DataFrame) -> list[str]:
    """Events beyond two standard uncertainties; each is judged for itself."""
    if not len(budget):
        return []
    judged = budget[budget["u_val"].notna()]
    beyond = judged[judged["resolved"].astype(bool)]
    parts = []
    for row in beyond.itertuples():
        kind = EVENTS[str(row.event)]
        k = kind.display_factor
        parts.append(f"{kind.label} {k * row.difference:+.2g} (u {k * row.u_val:.1g})")
    count = f"Events beyond two standard uncertainties (each for itself; one in twenty is by chance): of {len(judged)} "
    return [count + (", ".join(parts) if parts else "none") + "."]


def _events(events: pd.DataFrame) -> list[str]:
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
        "Absent in both": missing,
        "Not counted (encoder left out)": uncounted,
        "Ambiguous": doubtful,
    }
    return [f"{label}: {', '.join(names)}." for label, names in labels.items() if names]
