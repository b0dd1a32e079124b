"""Table *fit_scores*: how far values before and after an identification are from trials, fitted and held out."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

from validation.conventions import BODIES
from validation.curves.display_signs import TITLE
from validation.events.definitions import EVENTS
from validation.numbers import DASH, number
from validation.tables.table import OF_ROW, UNIT, UNIT_SHOWN, Column, Page, Row, Table

SETS = {"before": "before", "identified": "identified", "null model": "null", "scatter of trials": "scatter"}
"""Set of values → its column."""


def _score(column: str) -> Callable[[Row], str]:
    """Formatter of a cell for one set of values, ``column`` (before, identified, null, scatter): a row's
    ``<column>_rms`` in the unit shown, with the trials that have the row's event where not all do; a dash where NaN."""

    def cell(row: Row) -> str:
        value, both = row[f"{column}_rms"], row[f"{column}_both"]
        if not math.isfinite(value):
            return DASH
        seen = f" in {both} of {row['n_trials']} trials" if 0 <= both < row["n_trials"] else ""
        return f"{number(UNIT_SHOWN[row['unit']][1] * value, 2)}{seen}"

    return cell


def _rms_columns(name: str, words: str, head: str) -> tuple[Column, Column]:
    return (
        Column(f"{name}_rms", OF_ROW, f"Root mean square of {words}", head=head, text=_score(name)),
        Column(f"{name}_both", "1", "Trials in which trial and model have the event; null of an angle", int, True),
    )


COLUMNS = (
    Column("set", "", "Fitted trials, or a session of which trials were held out", str, head="trials"),
    Column(
        "what", "", "Body, or event", str, head="what", text=lambda row: f"{row['what']} ({UNIT_SHOWN[row['unit']][0]})"
    ),
    UNIT,
    Column("n_trials", "1", "Trials that have the event; of an angle 0", int),
    *_rms_columns("before", "model − trial with the values before", "values before"),
    *_rms_columns("identified", "model − trial with the identified values", "identified"),
    *_rms_columns("null", "null model − trial", "null model"),
    *_rms_columns("scatter", "the trials about their mean", "scatter of the trials"),
)  # fmt: skip


def rows(found: Any) -> Iterator[dict[str, object]]:
    """Yield rows by column of the errors of events and angles, of each set of trials of an identification ``found``: of
    values before, identified, null model and scatter."""
    for name, curves in found.scores.items():
        events = found.events.get(name, {})
        for event in next(iter(events.values()), {}):
            row = {"set": name, "what": EVENTS[event].title.lower(), "unit": EVENTS[event].unit}
            row["n_trials"] = events["identified"][event].trials
            for who, column in SETS.items():
                row |= {f"{column}_rms": events[who][event].rms, f"{column}_both": events[who][event].both}
            yield row
        for channel in BODIES:
            of = {column: (curves.get(who) or {}).get(channel, math.nan) for who, column in SETS.items()}
            if any(map(math.isfinite, of.values())):
                row = {"set": name, "what": TITLE[channel], "unit": "rad", "n_trials": 0}
                yield row | {f"{c}_rms": v for c, v in of.items()} | {f"{c}_both": math.nan for c in of}


NOTES = (
    "Root mean square of model − trial. Fitted trials: no prediction, the values were chosen to make these small. Held "
    "out: trials whose samples are not among those fitted. Scatter: standard deviation of the trials among themselves; "
    "a model driven by each trial’s own force can come closer.",
)
TABLE = Table(
    "fit_scores",
    "set of trials and event or angle",
    COLUMNS,
    rows,
    (Page("prediction", "Differences from fitted and held-out trials", NOTES),),
    of="identification",
)
