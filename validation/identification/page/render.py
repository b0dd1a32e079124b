"""The page as HTML: sentences, tables and figures filled into ``page.html.j2``, with the report's style and parts."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup, escape

from validation.identification.further.shrink import Prospect
from validation.identification.identifiability import CANNOT_TELL
from validation.identification.outcome.result import Identification
from validation.identification.page.figures import profile_figure, residual_figure
from validation.identification.page.sentences import as_sentence, plain_sentences, together
from validation.identification.page.tables import (
    correlations,
    forest,
    held_out_tables,
    next_table,
    residuals_table,
)

HERE = Path(__file__).parent
REPORT = HERE.parents[1] / "report"


def render_identification(
    found: Identification, ranked: Sequence[Prospect] = (), refused: Sequence[str] = (), drawn: Sequence[str] = ()
) -> str:
    """The page of an identification, without scripts or outside addresses.

    Parameters
    ----------
    found : Identification
    ranked : what could be recorded next; empty where it was not asked for
    refused : what was not considered for it, and why
    drawn : lines of `validation.draw_lines`, where draws were made

    Returns
    -------
    str
        HTML.

    Examples
    --------
    >>> import validation
    >>> found = validation.identify(["sessions/example_forte"], ["hammer.joint_friction"], fixed=("*",), profiles=())
    >>> "hammer.joint_friction" in validation.render_identification(found)
    True
    """
    environment = Environment(
        loader=FileSystemLoader([HERE, REPORT]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["breakable"] = breakable
    problem, fitted = found.details.problem, found.details.fitted
    before = problem.response.curves([np.zeros(len(problem.unknowns.moved))])[0] or fitted.curves
    names = [e.name for e in found.estimates]
    return environment.get_template("page.html.j2").render(
        found=found,
        made=found.provenance["created_utc"],
        style=Markup((REPORT / "report.css").read_text(encoding="utf-8")),
        # what the strokes cannot tell is said in a section of its own
        warnings=[as_sentence(line) for line in found.warnings if not line.startswith(CANNOT_TELL)],
        sentences=plain_sentences(found, ranked),
        forest=forest(found),
        names=names,
        correlations=correlations(found),
        profiles=Markup(profile_figure(found.details.profiles, fitted, names)),
        residuals=Markup(residual_figure(problem.trials, before, fitted.curves)),
        residuals_table=residuals_table(problem.trials, before, fitted.curves),
        held_out=held_out_tables(found),
        next=next_table(ranked),
        refused=together(refused),
        drawn=list(drawn),
        provenance=_flat(found.provenance),
    )


def breakable(name: str) -> Markup:
    """A name that a narrow column may break after a dot or an underscore, and is copied without it."""
    return Markup(escape(name).replace(".", Markup(".<wbr>")).replace("_", Markup("_<wbr>")))


def _flat(value: Mapping[str, Any], prefix: str = "") -> list[tuple[str, str]]:
    rows: list[tuple[str, str]] = []
    for key, item in value.items():
        if isinstance(item, Mapping):
            rows += _flat(item, f"{prefix}{key}: ")
        else:
            rows.append((f"{prefix}{key}", item if isinstance(item, str) else json.dumps(item, ensure_ascii=False)))
    return rows
