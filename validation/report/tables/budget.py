"""The uncertainty budget and the area metric of the events; an empty budget says that none was asked for."""

from __future__ import annotations

from validation.events.definitions import EVENTS
from validation.report.tables.formatting import DASH, PageTable, number, percent, with_u
from validation.result import ValidationResult

LEAST_PART = 0.01  # of the whole: adds 5e-5 of it


def budget_table(result: ValidationResult) -> PageTable:
    """E, its uncertainties and what can be said, event by event."""
    rows = []
    for b in result.budget.itertuples():
        kind = EVENTS[str(b.event)]
        k = kind.display_factor
        parts = (b.u_num, b.u_force, b.u_parameters, b.u_assumed, b.u_d, b.u_repeat)
        rows.append(
            [
                kind.label,
                with_u(k * b.difference, k * b.u_val),
                number(b.ratio, 2),
                f"{number(k * b.low, 3)} to {number(k * b.high, 3)}" if b.resolved else "not resolved",
                *(_part(k * u, k * b.u_val) for u in parts),
                percent(b.assumed_share),
            ]
        )
    head = [
        "event",
        "model − trial ± u",
        "|E| / u",
        "error of the model",
        "u_num",
        "u force",
        "u parameters",
        "u assumed",
        "u_D",
        "u scatter",
        "assumed share",
    ]
    notes = [
        "After ASME V&V 20: u is the root of the sum of squares of its parts; an error of the model is resolved when "
        "|E| exceeds 2 u. “Not resolved” does not mean that the model is right. assumed share: part of the input "
        "uncertainty (force and parameters, squared) that rests on values this project had to assume. Parts below a "
        "hundredth of u stand as less than that; all digits are in tables/budget.csv."
    ]
    if len(result.budget):
        first = result.budget.iloc[0]
        notes.append(
            f"From {int(first['runs'])} runs of trial {int(first['trial'])} with changed inputs; "
            f"{int(first['failed'])} could not be run."
        )
    else:
        notes.append("No budget was asked for.")
    return PageTable("budget", "Uncertainty budget of the events", head, rows, notes, "budget")


def _part(u: float, whole: float) -> str:
    """One part of an uncertainty; one that is nothing beside the whole by its bound."""
    bound = LEAST_PART * whole
    return f"< {number(bound, 1)}" if u < bound else number(u, 2)


def area_table(result: ValidationResult) -> PageTable:
    """Area metric of every event beside the floor that few trials put under it."""
    rows = []
    for e in result.event_summary.itertuples():
        kind = EVENTS[str(e.event)]
        k = kind.display_factor
        if number(k * e.area) == DASH:
            continue
        rows.append(
            [
                kind.label,
                number(k * e.area, 3),
                number(k * e.area_floor, 3),
                number(k * e.area_floor_95, 3),
                "above" if e.area > e.area_floor_95 else "within",
            ]
        )
    head = ["event", "area", "floor (mean)", "floor (95 %)", "against the floor"]
    notes = [
        "Area between the distribution functions of predictions and trials; floor: what a model without any error, of "
        "force and parameters neither, would show with as few trials, by chance. “Above” shows no error of the model: "
        "the budget decides that."
    ]
    return PageTable("area", "Area metric of the events", head, rows, notes, "event_summary")
