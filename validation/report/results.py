"""``results.json`` and the CSV tables: every number of the report for programs.

Conventions: SI units and radians. One of ``results`` for each session and model; ``tables`` hold the rows of all,
led by ``session`` and ``model``. Every field, its meaning and unit: ``results.schema.json`` beside this file (JSON
Schema 2020-12), as a page ``docs/results.md``. NaN and infinities become null, so that every JSON reader accepts it.
"""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
import pandas as pd

from validation.events.definitions import EVENTS
from validation.side_by_side import SideBySide

SCHEMA = "piano-action-rig results"
SCHEMA_VERSION = 5


def results_json(side: SideBySide) -> str:
    """The results as JSON text."""
    content = {
        "schema": SCHEMA,
        "schema_version": SCHEMA_VERSION,
        "verdict_lines": side.verdict_lines,
        "refused": list(side.refused),
        "results": [
            {
                "session": r.session_name,
                "model": r.action_name,
                "outcome": r.outcome,
                "sentence": r.sentence,
                "verdict_lines": r.verdict_lines,
                "warnings": r.warnings,
                "provenance": _plain(r.provenance),
            }
            for r in side.results
        ],
        "tables": {name: records(table) for name, table in side.tables.items()},
        "event_definitions": {
            name: {"title": kind.title, "unit": kind.unit, "definition": kind.definition}
            for name, kind in EVENTS.items()
        },
    }
    return json.dumps(content, indent=1, allow_nan=False, ensure_ascii=False) + "\n"


def records(table: pd.DataFrame) -> list[dict[str, Any]]:
    """Rows of a table as plain values, null for what does not exist."""
    names = [str(name) for name in table.columns]
    return [
        {name: _plain(value) for name, value in zip(names, row, strict=True)}
        for row in table.itertuples(index=False, name=None)
    ]


def table_csv(table: pd.DataFrame) -> str:
    """A table as CSV with a header; empty cells for what does not exist."""
    return table.to_csv(index=False, lineterminator="\n")


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if value is pd.NA or value is pd.NaT:
        return None
    return value
