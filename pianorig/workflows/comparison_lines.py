"""What a comparison prints: its most important quantities as a table, what to do, and the verdict last."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pianorig.console.output import MOST_COLUMNS, table_lines, wrap_text

if TYPE_CHECKING:
    from validation import SideBySide, ValidationResult

MOST_ROWS = 14  # of a comparison in the terminal: half a screen
READINGS = {
    "differs, by less than matters": "differs, small",
    "differs, whether by enough to matter cannot be told": "differs, size unclear",
}
"""Outcomes that are too long for a column."""
HEAD = ("quantity", "model error, 95 %", "limit", "reading")


def comparison_lines(side: SideBySide) -> list[str]:
    """Lines to print of a comparison, at most 80 columns wide: a table of quantities, then findings, advice, what was
    not compared, and a verdict for each result."""
    # start-up: 1 s of pandas, which an unchanged report does not need
    from validation.report.overview import quantity_rows, verdict_parts

    lines: list[str] = []
    each = max(3, MOST_ROWS // len(side.results))
    rows: list[tuple[str, ...]] = []
    titles: dict[int, str] = {}  # lines of the table that are no row of it, but name the results below
    for result in side.results:
        if len(side.results) > 1:
            titles[len(rows) + 1] = f"{_name(result)}:"
            rows.append(("", "", "", ""))
        rows += [(*row[:-1], READINGS.get(row[-1], row[-1])) for row in quantity_rows(result)[:each]]
    if rows:
        lines += [titles.get(i, line)[:MOST_COLUMNS] for i, line in enumerate(table_lines(HEAD, rows))]
    for result in side.results:
        named = f"{_name(result)}: " if len(side.results) > 1 else ""
        kinds = list(dict.fromkeys(result.findings["kind"]))
        if kinds:
            lines += wrap_text(", ".join(kinds), f"{named}findings: ")
        if result.advice:
            lines += wrap_text(" ".join(result.advice), f"{named}what to do: ")
    for line in (*side.compared_lines, *(f"Not compared: {text}" for text in side.refused), *side.notes):
        lines += wrap_text(line)
    for result in side.results:
        lead, rest = verdict_parts(result)
        begin = f"verdict, {_name(result)}: " if len(side.results) > 1 else "verdict: "
        rest = rest.removeprefix(f"{result.outcome[:1].upper()}{result.outcome[1:]}.").strip()
        lines += wrap_text(f"{result.outcome}. {lead} {rest}".strip(), begin)
    return lines


def _name(result: ValidationResult) -> str:
    return f"{result.session_name}, {result.action_name}"
