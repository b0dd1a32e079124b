"""Table *model_pairs*: two models on the same trials, paired by trial: which is closer, and what may be said of it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import pandas as pd

from validation.numbers import DASH, between, number
from validation.scores.curve_scores import SCORES
from validation.statistics.model_comparison import compare_pairs
from validation.tables.table import CHANNEL, OF_ROW, UNIT, Column, Page, Row, Table

if TYPE_CHECKING:
    from validation.result import ValidationResult


def _format_if_several(column: str) -> Callable[[Row], str]:
    return lambda row: number(row[column], 3) if row["n_trials"] > 1 else DASH


def _interval(row: Row) -> str:
    k = math.degrees(1.0) if row["unit"] == "rad" else 1.0
    return between(number(k * row["low"]), number(k * row["high"])) if row["n_trials"] > 1 else DASH


def _score(row: Row) -> str:
    return SCORES[row["score"]].title + (" (°)" if row["unit"] == "rad" else "")


COLUMNS = (
    Column("session", "", "Name of the session", str),
    CHANNEL,
    Column("score", "", "Name of the score, a column of scores", str, head="score", text=_score),
    UNIT,
    Column("better", "", "Which is better: lower or higher", str),
    Column("first", "", "Name of the first model", str),
    Column("second", "", "Name of the second model", str, head="difference",
           text=lambda row: f"{row['second']} − {row['first']}"),
    Column("n_trials", "1", "Trials that both models have", int),
    Column("first_mean", OF_ROW, "Mean score of the first model over these trials"),
    Column("second_mean", OF_ROW, "Mean score of the second"),
    Column("difference", OF_ROW, "Mean of second − first, paired by trial", head="mean", u="u_difference"),
    Column("u_difference", OF_ROW, "Its standard uncertainty; null with one trial"),
    Column("u_nuisance", OF_ROW, "Part of it from errors of force and sensors common to the trials"),
    Column("low", OF_ROW, "Lower end of its 95 % interval (Student's t)", head="95 % interval", text=_interval),
    Column("high", OF_ROW, "Upper end of it"),
    Column("first_closer", "1", "Trials in which the first model scores better", int, head="closer",
           text=lambda row: f"{row['first_closer']} : {row['second_closer']} of {row['n_trials']}"),
    Column("second_closer", "1", "Trials in which the second does", int),
    Column("p", "1", "Two-sided sign-flip test; 1 with one trial", head="p", text=_format_if_several("p")),
    Column("p_least", "1", "Smallest p that so many trials allow, 2^(1−n)", head="least p",
           text=_format_if_several("p_least")),
    Column("p_joint", "1", "p with the signs of all channels flipped together, for all channels at once",
           head="p, all channels", text=_format_if_several("p_joint")),
    Column("claim", "", "What may be said, in words", str, head="what can be said"),
)  # fmt: skip


def rows(results: Sequence[ValidationResult]) -> pd.DataFrame:
    """Every pair of models of each session."""
    return compare_pairs(results)


NOTES = (
    "Every trial is predicted by both models; the difference of their scores is taken trial by trial. ±: standard "
    "uncertainty of the mean; interval by Student’s t, with what errors of force and sensors common to the trials make "
    "of the difference. p: exact sign-flip test, two-sided; least p: the smallest that so many trials allow; all "
    "channels: signs flipped in all channels together. Closer to these trials does not mean right.",
)
TABLE = Table(
    "model_pairs",
    "session, channel, score and pair of models, paired by trial",
    COLUMNS,
    rows,
    (Page("models", "Models paired by trial", NOTES, order=1),),
    of="results",
)
