"""The page of an identification, of the same parts as the report: sentences, forest, tables, figures."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from validation.conventions import Array
from validation.curves.style import BLUE, VERMILION
from validation.infer.estimates import IDENTIFIED
from validation.infer.further import Prospect
from validation.infer.identifiability import CANNOT_TELL
from validation.infer.observations import CHANNEL_NAMES, ObservedTrial
from validation.infer.result import Identification
from validation.infer.scatter import factors
from validation.infer.sentences import group_by_reason, plain_sentences
from validation.infer.unknowns import Parameter
from validation.part_names import name_parts, part_name
from validation.report.figures.layout import WIDTH, ReportFigure
from validation.report.figures.svg import Chart, Pen
from validation.report.overview import Forest, make_forest
from validation.report.shell import fill_page, flatten_provenance
from validation.report.view import as_sentence
from validation.tables.catalogue import every_table
from validation.tables.table import SECTIONS, PageTable, make_page_table, shown_rows

PRIOR_REACH = 1.96


def z_of(parameter: Parameter, prior: float, value: float) -> float:
    """A value in prior standard uncertainties from the prior's."""
    if not parameter.factor:
        return (value - prior) / parameter.u
    return math.log(max(value / prior, 1e-9)) / parameter.u


def forest(found: Identification) -> Forest:
    """Table with a drawing of each estimate's value and 95 % interval, and of the prior's, in prior standard
    uncertainties from the value before."""
    rows = []
    table = _tables(found, "estimates", found)[0]
    for cells, p, e in zip(table.rows, found.details.problem.unknowns.asked, found.estimates, strict=True):
        low, high = (z_of(p, e.prior, end) for end in (e.low, e.high))
        rows.append((cells, e.z, low, high, PRIOR_REACH, e.verdict == IDENTIFIED))
    note = (
        "Line: 95 % interval after the strokes; red dots: before; one scale for all rows, in standard uncertainties "
        "before. Filled square: identified."
    )
    return make_forest(table.caption, (table.head[0], "smaller · before · larger", *table.head[1:]), rows, note)


def residual_rms(trials: Sequence[ObservedTrial], curves: Sequence[Array]) -> dict[int, tuple[Array, Array]]:
    """Session -> times (m,), s, of its first trial and root mean square over its trials (m, c), rad, of measured less
    predicted angles, 0 where lost; ``curves``: predicted angles (m, c), rad, of each trial."""
    found = {}
    for session in sorted({t.session for t in trials}):
        own = [(t, c) for t, c in zip(trials, curves, strict=True) if t.session == session]
        apart = np.array([t.change_rad - c for t, c in own])
        square = np.nansum(apart**2, axis=0) / np.maximum(np.isfinite(apart).sum(axis=0), 1)
        found[session] = own[0][0].time_s, np.sqrt(square)
    return found


BEFORE, AFTER = VERMILION, BLUE
ROW = 150.0  # points
ACROSS = 4  # profiles side by side in a figure
PROFILES = (
    "Profiles: how much twice the negative logarithm of the posterior rises when one parameter is held and all else is "
    "fitted again. Dashed: level of the 95 % interval; shaded: the interval. A flat curve: the strokes do not tell. "
    "Below zero: a better fit than the one reported was found on the way."
)
RESIDUALS = (
    "Residuals of the fitted trials: root mean square of model − trial over time. What stays after the fit is noise, "
    "scatter, or what the model lacks."
)


def residual_figure(
    trials: Sequence[ObservedTrial], before: Sequence[Array], after: Sequence[Array]
) -> list[ReportFigure]:
    """Figure, in a list of one, of the root mean square residual, degrees, over time, by session and channel;
    ``before``, ``after``: predicted angles (m, c), rad, of each trial with the values before and after the fit."""
    one, two = residual_rms(trials, before), residual_rms(trials, after)
    shown = sorted({c for t in trials for c in t.channels})
    chart = Chart(WIDTH, ROW * len(one) + 40, [1.0] * len(one), len(shown), top=18, between=40, is_shared=False)
    for row, session in zip(chart.grid, one, strict=True):
        first = next(t for t in trials if t.session == session)
        label = first.label.rpartition(", trial")[0]
        for panel, channel in zip(row, shown, strict=True):
            panel.title, panel.is_log = f"{CHANNEL_NAMES[channel]}, {label}", True
            if channel not in first.channels:
                panel.note = "not measured"
                continue
            time, c = one[session][0], first.channels.index(channel)
            panel.line(time, np.degrees(one[session][1][:, c]), Pen(BEFORE, 1.1, (3.7, 1.6)), "before")
            panel.line(time, np.degrees(two[session][1][:, c]), Pen(AFTER, 1.3), "after the fit")
            panel.x_label = "time (s)"
        row[0].y_label = "RMS (°)"
    return [_figure(chart, "residuals", RESIDUALS)]


def _figure(chart: Chart, key: str, caption: str) -> ReportFigure:
    title, _, rest = caption.partition(": ")
    return ReportFigure(key, caption, chart.svg(key, title, rest))


def profile_figure(found: Identification) -> list[ReportFigure]:
    """Figure (SVG), in a list of one, of all likelihood profiles with the level and ends of their 95 % intervals; an
    empty list where none was made."""
    profiles = found.details.profiles
    if not profiles:
        return []
    level = dict(zip((e.name for e in found.estimates), factors(found.details.fitted) ** 2, strict=False))
    rows = math.ceil(len(profiles) / ACROSS)
    chart = Chart(WIDTH, ROW * rows + 30, [1.0] * rows, ACROSS, top=18, between=40, beside=36, is_shared=False)
    for panel, p in zip(chart.panels, profiles, strict=False):
        panel.line(p.z, p.rise, Pen(AFTER, 1.2))
        panel.points(p.z, p.rise, AFTER, 3)
        panel.level(level[p.name], Pen(BEFORE, 0.9, (3.7, 1.6)))
        panel.shade(p.low, p.high, look=(AFTER, 0.12))
        panel.y = min(0.0, float(np.min(p.rise))) - 0.5, 3.0 * level[p.name]
        panel.title = part_name(p.name, found.action)
        panel.x_label = "standard uncertainties"
    del chart.grid[-1][len(profiles) - ACROSS * (rows - 1) :]
    for row in chart.grid:
        row[0].y_label = "rise"
    return [_figure(chart, "profiles", PROFILES)]


def _tables(found: Identification, name: str, of: object) -> list[PageTable]:
    """A table as the page shows it; pages without rows are left out."""
    table = every_table()[name]
    made = table.make(of)
    shown = (make_page_table(table, page, [("", row) for row in shown_rows(page, made)]) for page in table.pages)
    return [one for one in shown if one is not None]


def render_identification(found: Identification, ranked: Sequence[Prospect] = (), refused: Sequence[str] = ()) -> str:
    """HTML page of an identification, without outside addresses, as text. ``ranked``: what to record next, the best
    first, ``refused``: lines ``name: reason`` on strokes not considered, both of `prospects`.

    Parameters
    ----------
    found : Identification
    ranked : what could be recorded next; empty where it was not asked for
    refused : what was not considered for it, and why

    Returns
    -------
    str
        HTML.

    Examples
    --------
    >>> import validation
    >>> found = validation.identify(["sessions/example_forte"], ["hammer.joint_friction"], profiles=())
    >>> "hammer.joint_friction" in validation.render_identification(found)
    True
    """
    problem, fitted = found.details.problem, found.details.fitted
    before = problem.response.curves([np.zeros(len(problem.unknowns.moved))])[0] or fitted.curves
    # what the strokes cannot tell stands among the sentences
    warnings = [as_sentence(line) for line in found.warnings if not line.startswith(CANNOT_TELL)]
    lead, *sentences = (name_parts(text, found.action) for text in plain_sentences(found, ranked))
    drawn = profile_figure(found), residual_figure(problem.trials, before, fitted.curves)
    return fill_page(
        "identification.html.j2",
        found=found,
        lead=lead,
        sentences=sentences,
        warnings=[name_parts(text, found.action) for text in warnings],
        forest=forest(found),
        figures=dict(zip(("values", "prediction"), drawn, strict=True)),
        tables={
            "values": [*_tables(found, "estimates", found)[1:], *_tables(found, "correlations", found)],
            "prediction": _tables(found, "fit_scores", found),
            "next": _tables(found, "prospects", ranked),
        },
        titles=SECTIONS,
        explained=[name_parts(text, found.action) for text in found.details.explained],
        refused=group_by_reason(refused),
        provenance=flatten_provenance(found.provenance),
    )
