"""Observed differences of trials from the model: what is known before any uncertainty is drawn."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from validation.conventions import Array
from validation.curves.display_signs import SIGN
from validation.verdict.error_draws import TrialErrors
from validation.verdict.quantities import QUANTITIES, Quantity
from validation.verdict.verdict import format_interval


@dataclass(frozen=True)
class ObservedDifference:
    """One quantity, model − trial, in SI; the standard deviation over trials is NaN of a single one."""

    quantity: Quantity
    value: float
    scatter: float
    n_trials: int

    def __str__(self) -> str:
        q = self.quantity
        value = (float(SIGN[q.channel]) if q.channel else 1.0) * q.factor * self.value
        if not self.scatter > 0:
            return f"{value:+.2g}".replace("-", "−")
        return format_interval(value, q.factor * self.scatter, "")


def observed_differences(errors: Array, row_index: int | None = None) -> list[ObservedDifference]:
    """Mean over trials (or the value of the trial in row ``row_index``), standard deviation over trials, and number of
    trials, of each primary quantity with a value; ``errors`` (n, V): model − trial, SI, in the order of `QUANTITIES`.
    """
    out = []
    for q, column in zip(QUANTITIES, np.asarray(errors, dtype=float).T, strict=True):
        known = column[np.isfinite(column)]
        value = float(
            known.mean() if row_index is None and known.size else np.nan if row_index is None else column[row_index]
        )
        if q.is_primary and np.isfinite(value):
            scatter = float(known.std(ddof=1)) if known.size > 1 else float("nan")
            out.append(ObservedDifference(q, value, scatter, known.size))
    return out


def observed_text(found: Mapping[int, TrialErrors]) -> str:
    """Lines of text with mean and standard deviation of each primary quantity, model − trial, over the trials ``found``
    (errors by trial number), for a user who waits for the draws; empty where none is measured."""
    rows = observed_differences(np.array([one.errors for one in found.values()])) if found else []
    if not rows:
        return ""
    titles = [f"{row.quantity.title} ({row.quantity.unit_shown})" for row in rows]
    wide = max(map(len, titles))
    lines = [f"  {title:<{wide}}  {row!s:>15}" for title, row in zip(titles, rows, strict=True)]
    n = len(found)
    scatter = f"mean ± standard deviation of {n} trials" if n > 1 else "one trial"
    return "\n".join([f"observed, model − trial, {scatter}:", *lines])
