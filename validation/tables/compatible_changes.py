"""Table *compatible_changes*: sets of changes of model or session that explain the difference."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from validation.numbers import with_u
from validation.tables.comparison import Comparison
from validation.tables.table import Column, Page, Row, Table


def _change(row: Row) -> str:
    if row["unit"] == "1":
        return f"× {with_u(row['change'], row['change'] * row['u'])}"
    return f"{with_u(row['change'], row['u'])} {row['unit']}"


COLUMNS = (
    Column("set", "", "Number of the set, the most probable first; each set by itself explains the difference", int,
           head="set"),
    Column("changes", "", "How many changes the set has; fewer are listed where the trials do not tell what the others "
           "are", int),
    Column("cause", "", "What is changed: a parameter path, a felt, or an error of the session: gain, level or delay "
           "of the force, the clock's rate, an encoder's scale, delay or zero (a gain of 0.9 reads 0.9 of what "
           "acted)", str),
    Column("part", "", "The same with the name of the part", str, head="cause"),
    Column("change", "factor or unit of the row", "Factor, or what is added, in the row's unit; of an effect with a "
           "unit its value", head="change", text=_change),
    Column("u", "1 or unit of the row", "Standard uncertainty of the change; relative where it is a factor"),
    Column("unit", "", "Unit of the change; 1 means a factor", str),
    Column("log_odds", "1", "Natural logarithm of the set's evidence over that of the most probable one"),
    Column("left", "1", "Share of the difference, squared in standard uncertainties, that is left with the set: of the "
           "trials' mean, or of all trials where not all have the change", head="difference left", shown=("%", 100.0)),
    Column("left_by_noise", "1", "The same share that noise and declared uncertainties alone leave, exceeded in one "
           "session of a hundred (chi-squared)", head="left by noise", shown=("%", 100.0)),
    Column("profile", "", "Which trials have the change: all, one, a trend that grows evenly from the first to the "
           "last, all from one on", str, values=("all", "one", "trend", "step"), head="trials"),
    Column("first", "", "Number of the first trial that has the change; of a trend the last one before it", int),
    Column("last", "", "Number of the last trial that has the change", int),
)  # fmt: skip


def rows(comparison: Comparison) -> Sequence[Mapping[str, Any]]:
    """What the search for causes found."""
    return comparison.changes


NOTES = (
    "Each set by itself explains the difference until the key is let go; sets that the trials do not tell apart stand "
    "below each other. What more than three sets have in common stands alone: it is a part of them. Difference left: "
    "share of the difference, squared in standard uncertainties, that remains with the set; left by noise: what noise "
    "and declared uncertainties leave at most, in 99 of 100 sessions.",
)
TABLE = Table(
    "compatible_changes",
    "change of each cause, or pair of causes, of session or model that explains what model and trials differ by until "
    "the key is let go: at most three, the most probable first, each at one or more sizes, which trials do not tell "
    "apart, or what more than three have in common. Empty where nothing need have changed, where no cause that was "
    "compared explains it, where more do that have nothing in common, or where nothing was looked for",
    COLUMNS,
    rows,
    (Page("causes", "Sets of changes that explain the difference", NOTES),),
)
