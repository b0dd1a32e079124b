"""``results.json`` and the CSV tables: every number of the report for programs.

Place in the data flow: `ValidationResult` → text.

Schema ``piano-action-rig results 1``; SI units and radians; a value that does not exist is null:

- ``schema``, ``session``, ``action``, ``verdict``: text; ``verdict_lines``, ``warnings``: lists of text
- ``window``: start_s, end_s, start_rule, end_rule
- ``tables``: name → list of rows, each a mapping of column → value.  Columns are those of `ValidationResult`:
  ``trials``, ``scores``, ``channels``, ``events``, ``event_summary``, ``event_repeatability``,
  ``budget``, ``scorecard``, ``marked``, ``findings``,
  ``motion_driven``, ``uncertainty``
- ``event_definitions``: event → title, unit, definition
- ``provenance``: hashes, versions, tolerance_rad, rules

Failure: none; NaN and infinities become null, so that every JSON reader accepts the file.
"""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
import pandas as pd

from validation.event import EVENTS
from validation.result import ValidationResult

SCHEMA = "piano-action-rig results 1"


def results_json(result: ValidationResult) -> str:
    """The result as JSON text."""
    content = {
        "schema": SCHEMA,
        "session": result.session_name,
        "action": result.action_name,
        "verdict": result.verdict,
        "verdict_lines": result.verdict_lines,
        "warnings": result.warnings,
        "window": {
            "start_s": result.window.start_s,
            "end_s": result.window.end_s,
            "start_rule": result.window.start_rule,
            "end_rule": result.window.end_rule,
        },
        "tables": {name: records(table) for name, table in result.tables.items()},
        "event_definitions": {
            name: {"title": kind.title, "unit": kind.unit, "definition": kind.definition}
            for name, kind in EVENTS.items()
        },
        "provenance": _plain(result.provenance),
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
