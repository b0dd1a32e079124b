"""Table *evidence*: the evidence for each model of a session against its first, and what a blow costs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import pandas as pd

from validation.statistics.model_comparison import evidence_table
from validation.tables.table import Column, Page, Table

if TYPE_CHECKING:
    from validation.result import ValidationResult

COLUMNS = (
    Column("session", "", "Session", str),
    Column("model", "", "Model", str, head="model"),
    Column("against", "", "The session's first model", str),
    Column("log_evidence", "1", "Natural logarithm of the model's evidence"),
    Column("u_log_evidence", "1", "Its standard uncertainty, from the number of draws"),
    Column("log_bayes_factor", "1", "ln evidence less that of the first model", head="ln Bayes factor",
           u="u_log_bayes_factor"),
    Column("u_log_bayes_factor", "1", "Its standard uncertainty"),
    Column("p", "1", "p of the simultaneous test", head="p of the test", digits=2),
    Column("reading", "", "What can be said, after Kass and Raftery (1995)", str, head="evidence"),
    Column("right_hand_sides", "1", "Mean of a blow", head="right-hand sides", digits=4),
    Column("seconds", "s", "Least processor time of a blow", head="processor time of a blow"),
    Column("cost_ratio", "1", "Right-hand sides over those of the first model", head="times the first"),
)  # fmt: skip


def rows(results: Sequence[ValidationResult]) -> pd.DataFrame:
    """One row for each model of a session that has several."""
    sessions: dict[str, list[ValidationResult]] = {}
    for result in results:
        sessions.setdefault(result.session_name, []).append(result)
    return evidence_table(list(sessions.values()))


NOTES = (
    "Evidence (marginal likelihood): density that a model gives to the trials’ mean angles, its parameters, the "
    "force and the sensors drawn from what is declared of them; so what is uncertain in a richer model counts "
    "against it. ln Bayes factor: ln evidence less that of the session’s first model, ± standard uncertainty from "
    "the number of draws, graded after Kass and Raftery (1995) by its end nearest to 0. Right-hand sides: mean of a "
    "blow.",
)
TABLE = Table(
    "evidence",
    "session and model, where there are several models",
    COLUMNS,
    rows,
    (Page("models", "Evidence for each model, and what it costs", NOTES),),
    of="results",
)
