"""From one trial on the difference from the model is another one."""

from __future__ import annotations

from collections.abc import Mapping

from validation.findings.finding import CHANGED_CONDITION, SessionFinding, register_kinds
from validation.verdict.conditions import find_change
from validation.verdict.error_draws import TrialErrors


@register_kinds(
    {CHANGED_CONDITION: "Look for what changed between the two parts of the session, and validate them apart."}
)
def find_changed_condition(found: Mapping[int, TrialErrors], limits: Mapping[str, float]) -> list[SessionFinding]:
    """One finding of the first trial from which on the error (model − trial) of a primary quantity has stepped beyond
    the trials' scatter, or an empty list; ``found``: errors by trial number, ``limits``: limits of relevance in SI by
    name."""
    change = find_change(found, limits) if found else None
    if change is None:
        return []
    q = change.quantity
    size = f"{abs(q.factor * change.size):.2g}{'' if q.unit_shown == '°' else ' '}{q.unit_shown}"
    text = (
        f"from trial {change.first} on the difference from the model in {q.title} is another one than up to trial "
        f"{change.last}, by {size}, {change.deviations:.0f} standard deviations of the trials' scatter (limit "
        f"{change.limit:.0f})"
    )
    return [SessionFinding(CHANGED_CONDITION, float(change.first), q.channel, change.deviations, change.limit, text)]
