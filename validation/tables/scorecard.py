"""Table *scorecard*: every score of every channel beside what a perfect model and the null model score."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pandas as pd

from validation.conventions import CHANNEL_GROUPS
from validation.findings.finding import LeftOut, select_counted
from validation.numbers import DASH, between, degrees, number
from validation.scores.curve_scores import SCORES, pool_score
from validation.scores.perfect_model import Ceiling
from validation.scores.traces import SessionTraces
from validation.tables.comparison import Comparison
from validation.tables.table import CHANNEL, OF_ROW, UNIT, Column, Page, Row, Table


def _title(row: Row) -> str:
    return f"{row['title']}{' (°)' if row['unit'] == 'rad' else ''}"


def _range(row: Row) -> str:
    if not row["ceiling_draws"]:
        return DASH
    say = degrees if row["unit"] == "rad" else number
    return between(say(row["ceiling_low"]), say(row["ceiling_high"]))


COLUMNS = (
    CHANNEL,
    Column("score", "", "Name of the score, a column of scores", str),
    Column("title", "", "The score in words", str, head="score", text=_title),
    UNIT,
    Column("better", "", "Which is better: lower or higher", str),
    Column("value", OF_ROW, "The model's score over all trials: root mean square of errors in rad, mean of the "
           "magnitudes of the others", head="model"),
    Column("ceiling", OF_ROW, "What a perfect model would score that knows each trial's force as it was measured: "
           "median over draws", head="perfect model"),
    Column("ceiling_low", OF_ROW, "Smallest of the draws", head="its range", text=_range),
    Column("ceiling_high", OF_ROW, "Largest of the draws"),
    Column("ceiling_draws", "1", "Draws the ceiling is made from; 0 without budget", int),
    Column("reading", "", "Whether the model, in the trials the ceiling is made from, scores worse than all perfect "
           "models drawn", str, head="reading"),
    Column("null", OF_ROW, "The same score of the null model", head="null model"),
    Column("raw_force", OF_ROW, "The same score of the model driven by the force as recorded", head="raw force"),
)  # fmt: skip
NO_CEILING = Ceiling()


def rows(comparison: Comparison) -> list[dict[str, Any]]:
    """Scores over all trials that count."""
    c = comparison
    return list(scorecard(c.scored.scores, c.scored.traces, c.ceiling, c.without))


def scorecard(
    scores: pd.DataFrame, traces: SessionTraces, ceiling: Ceiling = NO_CEILING, without: LeftOut = ()
) -> Iterator[dict[str, Any]]:
    """Yield a row by column for each channel and score: the model's value pooled over trials, that of a perfect model,
    of the null model and under the raw force, NaN where not known; pairs (trial, channel) ``without`` do not count.

    Conventions: scores of several trials are pooled without those whose encoder is wired wrong. The *ceiling* is what a
    perfect model would score that knows each trial's force as well as it was measured
    (`validation.scores.perfect_model`).
    """
    for names, source in CHANNEL_GROUPS:
        every = traces.select_source(source)
        for name in names if every else ():
            frames = select_counted(every, name, without)
            part = scores[(scores["channel"] == name) & scores["trial"].isin(frames)]
            same = part[part["trial"].isin(ceiling.trials)]
            for score, kind in SCORES.items():
                yield {
                    "channel": name,
                    "score": score,
                    "title": kind.title,
                    "unit": kind.unit,
                    "better": kind.better,
                    "value": pool_score(score, part[score].to_numpy(dtype=float)),
                    **ceiling.row(name, score, pool_score(score, same[score].to_numpy(dtype=float))),
                    "null": pool_score(score, part[f"null_{score}"].to_numpy(dtype=float)),
                    "raw_force": pool_score(score, part[f"raw_force_{score}"].to_numpy(dtype=float)),
                }


NOTES = (
    "Perfect model: differs from the trials by errors of force and sensors only; median and range over draws, of at "
    "most five trials. Null model: one moving part, nothing fitted. Raw force: the model driven by the force as "
    "recorded, without correction for offset, hum and delay. ISO-style scores are made for forces and accelerations of "
    "vehicle safety (ISO/TS 18571); a curve with lost frames has none.",
)
TABLE = Table(
    "scorecard",
    "channel and score, over all trials",
    COLUMNS,
    rows,
    (
        Page(
            "scores",
            "Every score beside that of a perfect model and of the null model",
            NOTES,
            order=3,
            where=lambda table: table[table["value"].notna()],
        ),
    ),
)
