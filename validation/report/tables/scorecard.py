"""The scorecard: every score of a channel beside its ceiling, the null model and the raw force."""

from __future__ import annotations

import math
from typing import Any

from validation.report.tables.formatting import DASH, PageTable, between, degrees, number
from validation.result import ValidationResult


def scorecard_table(result: ValidationResult) -> PageTable:
    """Every score beside what a perfect model and the null model score."""
    rows = []
    for s in result.scorecard.itertuples():
        cells = [_cell(s.unit, value) for value in (s.value, s.ceiling, s.null, s.raw_force)]
        better = "smaller" if s.better == "lower" else "larger"
        unit = "°" if s.unit == "rad" else ""
        rows.append([f"{s.channel}: {s.title}{f' ({unit})' if unit else ''}", *cells, _between(s), s.reading, better])
    head = [
        "score",
        "model",
        "perfect model",
        "null model",
        "raw force",
        "range of perfect models",
        "reading",
        "better",
    ]
    notes = [
        "perfect model (the ceiling): median and range over draws of the errors of force and sensors, the prediction "
        "taken for the truth, scored at the same samples of the same trials (at most five); a score inside the range "
        "cannot be told from a perfect model’s. null model: the key's turn alone, all else balanced "
        "along it, no fit to trials; a model of many bodies should do better. raw force: the model driven by the "
        "force as recorded, without correction for offset, hum and delay."
    ]
    guards = [
        f"Trial {row.trial}, {row.channel}: {row.iso_guards}." for row in result.scores.itertuples() if row.iso_guards
    ]
    if guards:
        notes.append("Guards raised (the scores themselves are left as they are): " + " ".join(guards))
    return PageTable("scorecard", "Every score beside its ceiling and the null model", head, rows, notes, "scorecard")


def _between(s: Any) -> str:
    if not s.ceiling_draws:
        return DASH
    return between(_cell(s.unit, s.ceiling_low), _cell(s.unit, s.ceiling_high))


def _cell(unit: str, value: float) -> str:
    if not math.isfinite(value):
        return DASH
    return degrees(value) if unit == "rad" else number(value, 3)
