"""The page: tables, figures and text filled into ``report.html.j2``.

Text that comes from a session is escaped by the template engine; only our own SVG is passed through as it is.
"""

from __future__ import annotations

import base64
import json
import math
from typing import Any

import numpy as np

from validation.conventions import BODIES, ENCODER_CHANNELS, Array
from validation.curves.display_signs import TITLE, degrees
from validation.curves.style import uneven_samples
from validation.curves.table import force_on_base, interpolate_to_base_times
from validation.events.definitions import EVENTS
from validation.events.key_lift import EXCESS_M
from validation.measurement.trial import trials_in_words
from validation.numbers import number
from validation.report.figures.five_angles import band_words, five_angles, left_out_trials, limit_of
from validation.report.figures.layout import MOST_LINES, traces_of
from validation.report.figures.measured import all_figures
from validation.report.figures.overlays import NOTE, limit_of_trial, trial_words
from validation.report.overview import forest, verdict_parts
from validation.report.shell import fill_page, flatten_provenance
from validation.report.view import SessionView, as_sentence, netcdf_names
from validation.result import ValidationResult
from validation.side_by_side import SideBySide
from validation.tables.catalogue import pages_of
from validation.tables.table import SECTIONS, PageTable, make_page_table, page_table

GLOSSARY: tuple[tuple[str, str], ...] = (
    ("trial", "one recorded blow. All trials of a session are meant to be the same blow."),
    ("model", "the simulated action. It is neither fitted nor aligned to the trials."),
    ("difference", "model minus trial, at the same instant, of the same trial."),
    (
        "model error",
        "what is wrong with the model beyond force, sensors, parameters as declared and scatter of the trials (ASME "
        "V&V 20). Plain difference: what would be seen again, with measurement and repeatability only.",
    ),
    ("u", "standard uncertainty: about one error in three is larger."),
    (
        "shown",
        "found by the one test of all primary quantities together, which a model without error fails in one session of "
        "twenty. Alone: excluded by the quantity's own interval, not by that test.",
    ),
    ("limit of relevance", "from which a difference matters; it can be chosen."),
    ("sᵣ", "repeatability standard deviation: how much the trials differ from each other."),
    ("RMSE", "root mean square of the difference over the evaluation window."),
    ("perfect model", "a model that differs from the trials only by errors of force and sensors."),
    ("null model", "one moving part, nothing fitted: the least that a model of many bodies should beat."),
    ("skill", "0.6 is an error 60 % smaller than that of the best rival, below 0 it is larger."),
    ("A, B, C", "positions of the thesis: the key reaches its bottom; the force is released; the key is back."),
    ("attack, check, release", "phases of a blow: to the string impact, to the key's release, to the end."),
    ("–", "does not exist or cannot be stated."),
)
"""Term and meaning."""
GISTS = {
    "trials": "curves of each trial, zoom, events, correction of the force",
    "causes": "what was compared, and what explains the difference",
    "repeatability": "how much the trials differ among themselves",
    "inside": "forces, felt and energies in the predicted blow",
    "scores": "the verdict in full, every quantity, every score, rivals",
    "provenance": "hashes, versions, tolerance, uncertainty of the sensors",
}
"""What a folded section holds."""


LARGEST_BYTES = 1_200_000  # of the curves: choice, a page opens at once
BYTES_PER_VALUE = 8 / 3  # two bytes, in base 64
FEWEST_SAMPLES, MOST_SAMPLES = 150, 1000  # of a curve: choice, a screen has some thousand columns
LOST, LARGEST = -(2**15), 2**15 - 1


def page_data(view: SessionView) -> str:
    """JSON text of a session's curves for the page's scripts: times, s, and for each channel measured and predicted
    curves (degrees, N) thinned and packed, marks of the trials and sentences on them.

    Conventions: degrees with the thesis's signs and N; all curves at the same, unevenly spaced times; a curve is base
    64 (the alphabet for addresses, without slashes) of 16-bit integers (little-endian) times its channel's scale,
    `LOST` where there is no value. All of a session's curves together take about `LARGEST_BYTES` at most, so that a
    page of many trials stays small; its files have every sample.
    """
    first, base = view.first, view.first.base_s
    trials = list(first.traces)
    per_sample = len(trials) * (1 + len(ENCODER_CHANNELS) * (1 + len(view.results)))
    n = int(np.clip(LARGEST_BYTES / BYTES_PER_VALUE / per_sample, FEWEST_SAMPLES, MOST_SAMPLES))
    shown = first.traces[view.shown_trial()]
    leading = [
        interpolate_to_base_times(base, shown["time_s"].to_numpy(), shown[f"{c}_measured_rad"]) for c in view.measured
    ]
    leading += [force_on_base(base, shown)] if view.has_force else []
    at = base[uneven_samples(base, np.column_stack(leading), n)]
    channels: dict[str, Any] = {}
    if view.has_force:
        channels["force"] = {"m": [force_on_base(at, frame) for frame in first.traces.values()], "p": []}
    shown_bodies = [c for c in BODIES if c in view.measured or c in view.compared]
    for channel in shown_bodies:
        measured = [_rotation(first, t, channel, "measured", at) for t in trials]
        predicted = [[_rotation(r, t, channel, "predicted", at) for t in trials] for r in view.results]
        channels[channel] = {"m": measured, "p": predicted, "limit": [limit_of_trial(first, channel, at)]}
    content = {
        "t": base64.urlsafe_b64encode(np.asarray(at, dtype="<f8").tobytes()).decode("ascii"),
        "trials": trials,
        "shown": view.shown_trial(),
        "models": view.names,
        "channels": {name: _pack_curves(curves) for name, curves in channels.items()},
        "marks": {t: [[m.label, round(m.time_s, 6), m.meaning] for m in first.marks(t)] for t in trials},
        "words": {c: {t: trial_words(view, c, t) for t in trials} for c in shown_bodies},
    }
    return json.dumps(content, separators=(",", ":"), ensure_ascii=False)


def _rotation(result: ValidationResult, trial: int, channel: str, kind: str, at: Array) -> Array:
    frame = traces_of(result, channel).get(trial)
    if frame is None:
        return np.full(at.size, np.nan)
    return degrees(
        channel, interpolate_to_base_times(at, frame["time_s"].to_numpy(), frame[f"{channel}_{kind}_rad"].to_numpy())
    )


def _pack_curves(curves: dict[str, Any]) -> dict[str, Any]:
    """Curves of one channel (``m``: measured, ``p``: predicted by model, ``limit``: repeatability limit, if any) as
    base-64 text of 16-bit integers, by the same names, with their common ``scale``."""
    every = np.concatenate([np.ravel(np.asarray(part, dtype=float)) for part in curves.values() if len(part)])
    known = np.abs(every[np.isfinite(every)])
    scale = float(known.max()) / LARGEST if known.size and known.max() > 0 else 1.0

    def text(values: Any) -> str:
        whole = np.asarray(values, dtype=float)
        steps = np.where(np.isfinite(whole), np.round(np.nan_to_num(whole) / scale), LOST)
        return base64.urlsafe_b64encode(steps.astype("<i2").tobytes()).decode("ascii")

    out: dict[str, Any] = {"scale": scale, "m": text(curves["m"]), "p": [text(part) for part in curves["p"]]}
    if "limit" in curves and np.isfinite(curves["limit"]).any():
        out["limit"] = text(curves["limit"])
    return out


DASH_WORDS = ("dashed", "dotted", "dash-dotted", "long dashes", "short dashes and dots")


ELSEWHERE = ("What to do: ", "Plain difference", "Alone", "RMSE: ", "ISO 18571", "Skill, ", "Nearest: ")


def session_section(view: SessionView, is_first: bool = True) -> dict[str, Any]:
    """Values, by the names of the page's template, of one session: figures, tables, curves and texts; ``is_first``:
    whether it is the first on the page, whose caption explains what is drawn.

    Tables that depend on the model are made for each, their caption names it; ids lead with the session's prefix.
    """
    first = view.first
    tables = {section: section_tables(view, section) for section in SECTIONS}
    return dict(
        prefix=view.prefix,
        result=first,
        simulated=is_simulated(first),
        impact_s=_impact_s(first),
        curves=page_data(view),
        angles=five_angles(view),
        caption=angles_caption(view, is_first),
        forest=forest(view.results),
        verdicts=[_lines_left(r) for r in view.results],
        warnings=_warnings(view),
        differing=section_tables(view, "differing"),
        figures=dict.fromkeys(SECTIONS, []) | all_figures(view),
        tables=tables,
        provenance=[(f"{r.session_name}, {r.action_name}", flatten_provenance(r.provenance)) for r in view.results],
    )


def _lines_left(result: ValidationResult) -> list[str]:
    """Verdict lines that are neither on the first screen nor in the score tables."""
    return [line for line in result.verdict_lines[1:] if not line.startswith(ELSEWHERE)]


def angles_caption(view: SessionView, is_first: bool = True) -> str:
    """Caption of the five angles: trials left out, widths of the intervals and limits; for the first session on a page
    (``is_first``) also how measured and predicted curves are drawn."""
    n = len(view.first.traces)
    trials = "the trial" if n == 1 else f"all {n} trials"
    if n > MOST_LINES:
        trials += ", as median, quartiles and 5 % to 95 %"
    if len(view.results) == 1:
        predicted, drawn = "black dashes; mean", "each trial and the mean" if n <= MOST_LINES else "alike, and the mean"
    else:
        predicted = "black: " + ", ".join(map(" ".join, zip(view.names, DASH_WORDS, strict=False))) + "; means"
        drawn = "means"
    text = f"Measured in {trials}."
    if is_first:
        text = f"Rotation since rest, measured in {trials} (colour of the body) and predicted ({predicted}). Below: "
        text += (
            f"model − trial, {drawn}; grey: 95 % interval of the mean difference at each instant; red dots: limit of "
        )
        text += "relevance."
    left_out = left_out_trials(view)
    if left_out:
        text += f" Light grey: curves left out of means and differences ({trials_in_words(left_out)})."
    band = band_words(view)
    if band:
        text += f" Half width of the interval at its widest: {band}."
    limits = [(TITLE[c], limit_of(view.first, c)) for c in BODIES]
    known = ", ".join(f"{name} {number(limit, 2)}°" for name, limit in limits if math.isfinite(limit))
    return text + (f" Limit: ± {known}." if known else "")


def section_tables(view: SessionView, section: str) -> list[PageTable]:
    """Tables of a section that have rows, of all models of the session."""
    made = (page_table(table, page, view.results, view.prefix) for table, page in pages_of(section))
    return [table for table in made if table is not None]


def compared_tables(side: SideBySide) -> list[PageTable]:
    """Tables of all results together that have rows."""
    made = (
        make_page_table(table, page, [("", row) for row in side.compared[table.name].to_dict("records")])
        for table, page in pages_of("models")
    )
    return [table for table in made if table is not None]


def is_simulated(result: ValidationResult) -> bool:
    """Whether the session was recorded on the virtual bench."""
    return bool(result.provenance.get("session", {}).get("simulated", False))


def _warnings(view: SessionView) -> list[str]:
    """Warnings of a session's results that are not findings, each once, as sentences; one that not every model raises
    is led by the names of those that do."""
    said: dict[str, list[str]] = {}
    for r in view.results:
        shown = set(r.findings["text"])
        for text in r.warnings:
            if text not in shown:
                said.setdefault(as_sentence(text), []).append(r.action_name)
    every = len(view.results)
    return [text if len(names) == every else f"{', '.join(names)}: {text}" for text, names in said.items()]


def _impact_s(result: ValidationResult) -> float | None:
    """String impact of the first trial that has one."""
    e = result.events
    times = e[(e["source"] == "trial") & (e["event"] == "string_impact")]["value"].dropna()
    return float(times.iloc[0]) if len(times) else None


ANIMATION = "animation.html"


def render_html(side: SideBySide, *, animation: bool = False) -> str:
    """The report as the text of one HTML page without outside addresses, in which only its own scripts may run;
    ``animation``: whether to link the file ``animation.html`` in the page's folder."""
    several = len(side.sessions) > 1
    sections = [
        session_section(SessionView(tuple(results), f"s{i}-" if several else ""), i == 1)
        for i, results in enumerate(side.sessions.values(), start=1)
    ]
    shared = [text for text in sections[0]["warnings"] if several and all(text in s["warnings"] for s in sections)]
    for section in sections:
        section["warnings"] = [text for text in section["warnings"] if text not in shared]
    return fill_page(
        "report.html.j2",
        side=side,
        sections=sections,
        parts=[verdict_parts(result) for result in side.results],
        lines=[*(f"Not compared: {text}" for text in side.refused), *side.notes, *shared],
        said=side.compared_lines,
        driven=_driven_words(side),
        glossary=GLOSSARY,
        gists=GISTS,
        figures_note=NOTE,
        netcdf=netcdf_names(side),
        animation=ANIMATION if animation else "",
        compared=compared_tables(side),
        titles=SECTIONS,
        window=_window_words(side),
        definitions=[(kind.title, kind.definition) for kind in EVENTS.values()],
        limits=cannot_claim(side),
    )


def _driven_words(side: SideBySide) -> str:
    """What drives the model."""
    found = {r.provenance.get("driven_by", "force") for r in side.results}
    if found == {"force"}:
        return "each driving the model with its own measured force"
    return "each driving the model with its measured key" + (", or its measured force" if len(found) > 1 else "")


def _window_words(side: SideBySide) -> str:
    """Text with begin and end of the evaluation window, s, and their rules, of each session."""
    parts = []
    for name, results in side.sessions.items():
        w = results[0].window
        where = f"{name}: " if len(side.sessions) > 1 else ""
        parts.append(f"{where}{w.start_s:.4f} s ({w.start_rule}) to {w.end_s:.4f} s ({w.end_rule})")
    return (
        f"Evaluation window, fixed before scoring: {'; '.join(parts)}. Angles are changes since rest. Model and trial "
        "share one clock and are not aligned."
    )


def cannot_claim(side: SideBySide) -> list[str]:
    """Sentences on what the report does not show."""
    limits = [
        "The trials were played in one session on one action: this is repeatability. Other days, remounting, other "
        "actions and other benches are reproducibility, which is not measured here.",
        "An encoder reads a rotation only while its body turns about its pivot. A key that lifts off the balance rail "
        "gives false readings; where the gap at the loaded capstan, by key and whippen encoder, is larger than the "
        f"model's by {1e3 * EXCESS_M:g} mm, they are marked and left out of the scores. Lifts with a smaller "
        "gap, or with none because the capstan is free, stay in.",
        "Whole-window scores mix a phase that is predicted well (until the string is struck) with one in which small "
        "differences grow; the score before the impact is listed beside them.",
        "Hammer height and key dip at rest are taken from the model's rest position; how well the bench agrees with it "
        "is part of the stated uncertainty of events, not measured here.",
    ]
    named: dict[str, list[str]] = {}
    for results in side.sessions.values():
        for text in _limits_of(results[0]):
            named.setdefault(text, []).append(results[0].session_name)
    every = len(side.sessions)
    limits += [text if len(names) == every else f"{'; '.join(names)}: {text}" for text, names in named.items()]
    if len(side.models) > 1:
        limits.append(
            "The model that is closer is closer to these trials of this action. A model may be closer for a wrong "
            "reason, and parameters fitted to these trials must be judged on others."
        )
    if len(side.sessions) > 1:
        limits.append(
            "Sessions stand side by side and are not compared with each other: their blows, windows and repeatability "
            "differ."
        )
    return limits


BY_FORCE = (
    "The model is driven by the measured force, and that force depends on the action that was played; the motor is not "
    "part of the comparison."
)
BY_KEY = (
    "The model is driven by the measured motion of the key: the key itself is no answer, and nothing is said of the "
    "force that it needs. Causes of a difference are not looked for."
)


def _limits_of(result: ValidationResult) -> list[str]:
    """Sentences on what the trials of one session cannot show: by what drives the model, films, number of trials,
    simulation."""
    limits = [BY_KEY if result.provenance.get("driven_by") == "key" else BY_FORCE]
    filmed = len(result.film_traces)
    if filmed == 0:
        limits.append("Jack and repetition lever were not filmed: nothing is said about them.")
    elif filmed == 1:
        limits.append("Jack and repetition lever were filmed in one trial only: their repeatability is not known.")
    if len(result.traces) < 2:
        limits.append("With one trial no difference can be judged against repeatability.")
    if is_simulated(result):
        limits.append("The session is simulated: it shows that the method works, not how a real action behaves.")
    return limits
