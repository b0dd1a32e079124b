"""Table *quantities*: error of the model, quantity by quantity, with its interval and its limit of relevance."""

from __future__ import annotations

import math
from collections.abc import Callable
from types import SimpleNamespace

import pandas as pd

from validation.numbers import DASH, number
from validation.tables.comparison import Comparison
from validation.tables.table import UNIT, Column, Page, Row, Table
from validation.verdict.quantities import INDEX, QUANTITIES
from validation.verdict.verdict import detectable_words, format_interval, reading_of, shown_interval, title_of


def _title(row: Row) -> str:
    return f"{title_of(SimpleNamespace(**row))} ({QUANTITIES[INDEX[row['quantity']]].unit_shown})"


def _interval(low: str, high: str) -> Callable[[Row], str]:
    def cell(row: Row) -> str:
        if row[low] != row[low]:
            return DASH
        return format_interval(*shown_interval(SimpleNamespace(**row), (low, high)), "")

    return cell


def _detectable_text(row: Row) -> str:
    known = row["primary"] and math.isfinite(row["detectable_low"])
    return detectable_words(SimpleNamespace(**row)) if known else DASH


def _size(column: str) -> Callable[[Row], str]:
    return lambda row: number(QUANTITIES[INDEX[row["quantity"]]].factor * float(row[column]), 2)


COLUMNS = (
    Column("quantity", "", "Name of the quantity", str),
    Column("title", "", "The same in words", str, head="quantity", text=_title),
    Column("trials", "", "Trials that it is of, where the session holds several conditions; else empty", str),
    Column("channel", "", "Body whose angle it is; empty for an event", str),
    Column("phase", "", "Part of the blow over which the angle is a mean; empty for an event", str,
           values=("attack", "check", "release", "")),
    UNIT,
    Column("primary", "", "Whether the claim rests on it", bool),
    Column("travel", "rad", "Measured travel of the channel in the window, mean over trials"),
    Column("n_trials", "1", "Trials in which trial and model have it", int, head="trials"),
    Column("difference", "SI", "Mean difference, model − trial"),
    Column("plain_low", "SI", "Lower end of the 95 % interval of the plain difference: measurement and repeatability "
           "only", head="plain difference, 95 %", text=_interval("plain_low", "plain_high")),
    Column("plain_high", "SI", "Upper end"),
    Column("low", "SI", "Lower end of the individual 95 % interval of the model error: force, sensors, parameters as "
           "declared, repeatability", head="model error, 95 %", text=_interval("low", "high")),
    Column("high", "SI", "Upper end"),
    Column("low_90", "SI", "Lower end of the 90 % interval, which decides whether the model agrees"),
    Column("high_90", "SI", "Upper end"),
    Column("limit", "SI", "Limit of relevance; null where it is not in the claim", head="limit", text=_size("limit")),
    Column("ratio", "1", "|difference| in units of the scale of the draws on its side"),
    Column("ratio_limit", "1", "What the largest ratio of a model without error exceeds in 5 % of sessions"),
    Column("resolved", "", "Whether the simultaneous test resolves it", bool, head="reading",
           text=lambda row: reading_of(SimpleNamespace(**row))),
    Column("alone", "", "Whether only its own interval excludes zero", bool),
    Column("detectable_low", "SI", "Least negative error that the test resolves in 80 % of sessions (Y)",
           head="detectable", text=_detectable_text),
    Column("detectable_high", "SI", "Least positive one"),
    Column("u", "SI", "Standard uncertainty of the difference, robust", head="standard uncertainty", text=_size("u")),
    Column("u_force", "SI", "Part of the force: gain, level, delay"),
    Column("u_sensors", "SI", "Part of encoders, film and levels of rest"),
    Column("u_parameters", "SI", "Part of the parameters as declared"),
    Column("u_repeat", "SI", "Part of the scatter of the trials"),
    Column("main_input", "", "Input that makes most of u; empty where it is not known", str, head="mostly from"),
    Column("state", "", "Why there is no interval; empty when there is one", str),
)  # fmt: skip


def rows(comparison: Comparison) -> pd.DataFrame:
    """What the verdict rests on."""
    return comparison.verdict.quantities


NOTES = (
    "Model − trial after ASME V&V 20. Model error: interval with force, sensors, parameters as declared and the "
    "scatter of the trials; plain difference: without the parameters, what would be seen again. Angles are means "
    "over a phase. “differs”: shown by the test of all quantities of the claim together (5 %); “alone”: excluded by "
    "its own interval only. Detectable: would be shown in 80 % of such sessions. Quantities that no trial "
    "shows are left out.",
)
TABLE = Table(
    "quantities",
    "quantity of the verdict",
    COLUMNS,
    rows,
    (
        Page(
            "scores",
            "Error of the model, quantity by quantity",
            NOTES,
            order=1,
            where=lambda table: table[table["n_trials"] > 0],
        ),
    ),
)
