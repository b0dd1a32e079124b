"""Table *estimates*: each asked parameter before and after an identification."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

from validation.numbers import between, number, with_u
from validation.part_names import part_name
from validation.tables.table import Column, Page, Row, Table


def _unit(row: Row) -> str:
    return "" if row["unit"] == "1" else f" {row['unit'].replace('*', ' ')}"


def _prior(row: Row) -> str:
    """Text of the prior's u: in percent for a factor, else with its unit."""
    relative = f" ± {100 * row['prior_u']:.2g} %"
    return f"{number(row['prior'])}{_unit(row)}{relative}" if row["factor"] else _value(row, "prior", "prior_u")


def _value(row: Row, value: str = "value", u: str = "u") -> str:
    return f"{with_u(float(row[value]), float(row[u]))}{_unit(row)}"


def _verdict(row: Row) -> str:
    return row["verdict"].partition(":")[0] + (
        "" if row["interval"] == "two-sided" else f"; without the prior {row['interval']}"
    )


COLUMNS = (
    Column("name", "", "Parameter, a path or the name of a law", str),
    Column("part", "", "The same in words", str, head="parameter", text=lambda row: f"{row['part']} ({row['name']})"),
    Column("unit", "", "Unit of the value; 1 means a factor", str),
    Column("factor", "", "Whether it is moved by a factor, so that its prior uncertainty is relative", bool),
    Column("prior", "unit of the row", "Value before", head="before", text=_prior),
    Column("prior_u", "1 or unit of the row", "Its standard uncertainty, relative where a factor moves it"),
    Column("basis", "", "Where that uncertainty comes from", str),
    Column("z", "1", "Most probable value, in prior standard uncertainties from the value before"),
    Column("z_u", "1", "Its standard uncertainty", head="uncertainty left", shown=("%", 100.0), digits=2),
    Column("value", "unit of the row", "Most probable value", head="after", text=_value),
    Column("u", "unit of the row", "Its standard uncertainty"),
    Column("low", "unit of the row", "Lower end of the 95 % interval", head="95 % interval",
           text=lambda row: between(number(row["low"], 4), number(row["high"], 4))),
    Column("high", "unit of the row", "Upper end"),
    Column("profiled", "", "Whether the interval is from a profile", bool),
    Column("interval", "", "What the strokes alone, without the prior, say", str,
           values=("two-sided", "open above", "open below", "open")),
    Column("u_jackknife", "1", "Standard uncertainty of z from leaving out one trial after the other",
           head="one trial left out", shown=("%", 100.0), digits=2),
    Column("u_strokes", "1", "The same from leaving out one kind of stroke after the other",
           head="one kind of stroke left out", shown=("%", 100.0), digits=2),
    Column("u_form", "1", "Part of z_u that comes from what the model lacks"),
    Column("verdict", "", "Identified, or why not", str, head="verdict", text=_verdict),
)  # fmt: skip


def rows(found: Any) -> Iterator[dict[str, object]]:
    """One row of each asked parameter of an identification, in the order asked."""
    asked = found.details.problem.unknowns.asked
    for parameter, estimate in zip(asked, found.estimates, strict=True):
        part = part_name(estimate.name, found.action)
        yield asdict(estimate) | {"part": part, "factor": parameter.factor}


TABLE = Table(
    "estimates",
    "parameter that was asked for",
    COLUMNS,
    rows,
    (
        Page("values", "Values before and after the strokes", columns=("part", "prior", "value", "low", "verdict")),
        Page(
            "values",
            "Uncertainty after the strokes, and by leaving some out, of that before",
            columns=("part", "z_u", "u_jackknife", "u_strokes"),
            order=1,
        ),
    ),
    of="identification",
)
