"""The scorecard: every score of a channel beside its ceiling, the null model and the raw force."""

from __future__ import annotations

import math

from validation.report.tables.formatting import DASH, PageTable, degrees, number
from validation.result import ValidationResult


def scorecard_table(result: ValidationResult) -> PageTable:
    """Every score beside what trials score against each other and what the null model scores."""
    rows = []
    for s in result.scorecard.itertuples():
        cells = [_cell(s.unit, value) for value in (s.value, s.ceiling, s.null, s.raw_force)]
        better = "smaller is better" if s.better == "lower" else "larger is better"
        unit = "°" if s.unit == "rad" else ""
        rows.append([f"{s.channel}: {s.title}{f' ({unit})' if unit else ''}", *cells, str(s.pairs), better])
    head = ["score", "model", "trial–trial", "null model", "raw force", "pairs", ""]
    notes = [
        "trial–trial (the ceiling): the same score of one trial against another, over the pairs counted; no model can "
        "be asked for better. null model: the key's turn alone, all else balanced "
        "along it, no fit to trials; a model of many bodies should do better. raw force: the model driven by the "
        "force as recorded, without correction for offset, hum and delay."
    ]
    guards = [
        f"Trial {row.trial}, {row.channel}: {row.iso_guards}." for row in result.scores.itertuples() if row.iso_guards
    ]
    if guards:
        notes.append("Guards raised (the scores themselves are left as they are): " + " ".join(guards))
    return PageTable("scorecard", "Every score beside its ceiling and the null model", head, rows, notes)


def _cell(unit: str, value: float) -> str:
    if not math.isfinite(value):
        return DASH
    return degrees(value) if unit == "rad" else number(value, 3)
