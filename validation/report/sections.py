"""What the page shows of one session: tables and figures, ready for the template.

Tables that depend on the model are made for each, their caption names it; ids lead with the session's prefix.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from validation.report.figures.layout import ReportFigure
from validation.report.figures.measured import all_figures
from validation.report.page_data import page_data
from validation.report.tables import scores as present
from validation.report.tables.budget import area_table, budget_table
from validation.report.tables.formatting import PageTable
from validation.report.tables.models import event_table
from validation.report.tables.scorecard import scorecard_table
from validation.report.view import SessionView
from validation.result import ValidationResult


@dataclass(frozen=True)
class SessionSection:
    """One session's part of the page."""

    prefix: str
    result: ValidationResult
    simulated: bool
    impact_s: float | None
    curves: str
    verdicts: list[list[str]]
    warnings: list[str]
    figures: dict[str, list[ReportFigure]]
    scores: list[PageTable]
    differences: list[PageTable]
    scorecards: list[PageTable]
    iso: list[PageTable]
    events: list[PageTable]
    budgets: list[PageTable]
    areas: list[PageTable]
    events_by_trial: list[PageTable]
    repeatability: list[PageTable]
    trials: list[PageTable]


def session_section(view: SessionView) -> SessionSection:
    """Everything the page shows of one session."""
    first = view.first

    def each(make: Callable[[ValidationResult], PageTable]) -> list[PageTable]:
        """A table of every model, told apart by caption and id."""
        tables = [_called(make(r), view, "" if i == 0 else f"-m{i + 1}") for i, r in enumerate(view.results)]
        if len(tables) == 1:
            return tables
        return [replace(t, caption=f"{t.caption}: {r.action_name}") for t, r in zip(tables, view.results, strict=True)]

    return SessionSection(
        prefix=view.prefix,
        result=first,
        simulated=is_simulated(first),
        impact_s=_impact_s(first),
        curves=page_data(view),
        verdicts=[r.verdict_lines for r in view.results],
        warnings=_warnings(view),
        figures=all_figures(view),
        scores=each(present.score_matrix),
        differences=each(present.resolution_table),
        scorecards=each(scorecard_table),
        iso=each(present.iso_table),
        events=[_called(event_table(view), view)],
        budgets=each(budget_table),
        areas=each(area_table),
        events_by_trial=each(present.event_by_trial_table),
        repeatability=[_called(t, view) for t in present.repeatability_tables(first)],
        trials=[_called(present.trial_page_table(first), view)],
    )


def is_simulated(result: ValidationResult) -> bool:
    """Whether the session was recorded on the virtual bench."""
    return bool(result.provenance.get("session", {}).get("simulated", False))


def _called(table: PageTable, view: SessionView, suffix: str = "") -> PageTable:
    return replace(table, key=f"{view.prefix}{table.key}{suffix}")


def _warnings(view: SessionView) -> list[str]:
    """Warnings of the session; one that not every model raises names its model."""
    said: dict[str, list[str]] = {}
    for r in view.results:
        for text in r.warnings:
            said.setdefault(text, []).append(r.action_name)
    every = len(view.results)
    return [text if len(names) == every else f"{', '.join(names)}: {text}" for text, names in said.items()]


def _impact_s(result: ValidationResult) -> float | None:
    """String impact of the first trial that has one."""
    e = result.events
    times = e[(e["source"] == "trial") & (e["event"] == "string_impact")]["value"].dropna()
    return float(times.iloc[0]) if len(times) else None
