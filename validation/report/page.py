"""The page: tables, figures and text filled into ``report.html.j2``.

Text that comes from a session is escaped by the template engine; only our own SVG is passed through as it is.
"""

from __future__ import annotations

import base64
import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from validation.conventions import ENCODER_CHANNELS, Array
from validation.curves.display_signs import degrees
from validation.curves.style import uneven_samples
from validation.curves.table import force_on_base, on_base
from validation.events.definitions import EVENTS
from validation.events.key_lift import EXCESS_M
from validation.report.figures.measured import all_figures
from validation.report.figures.overlays import limit_of_trial, trial_words
from validation.report.overview import forest, heat_map
from validation.report.view import SessionView, netcdf_names
from validation.result import ValidationResult
from validation.side_by_side import SideBySide
from validation.tables.catalogue import pages_of
from validation.tables.table import SECTIONS, PageTable, made_table, page_table
from validation.verdict.quantities import PHASES

GLOSSARY: tuple[tuple[str, str], ...] = (
    ("trial", "one recorded blow. All trials of a session are meant to be the same blow."),
    (
        "model",
        "the simulated action. Each trial’s own measured force drives it; it is not fitted or aligned to the trials.",
    ),
    ("difference", "model minus trial, at the same instant, of the same trial."),
    (
        "u",
        "standard uncertainty: about one error in three is larger.",
    ),
    (
        "model error",
        "what is wrong with the model beyond force, sensors, parameters as declared and scatter of the trials, with "
        "its 95 % interval (ASME V&V 20). Plain difference: an interval of measurement and repeatability only.",
    ),
    (
        "resolved",
        "found by the one test of all primary quantities together, which a right model fails in one session of twenty.",
    ),
    ("alone", "the quantity's own interval excludes zero, but the test of all together does not resolve it."),
    ("limit", "from which a difference matters (--relevant)."),
    (
        "Y, shown in 80 %",
        "the error that the test would resolve in 80 % of such sessions.",
    ),
    ("sᵣ", "repeatability standard deviation: how much the trials differ from each other."),
    ("RMSE", "root mean square of the difference over the evaluation window."),
    ("right model", "what the RMSE of a model would be that is right within the declared uncertainties."),
    ("perfect model, ceiling", "a model that differs from the trials only by errors of force and sensors."),
    ("null model", "one moving part, nothing fitted: the least that a model of many bodies should beat."),
    (
        "rivals, skill",
        "what a model should beat: the null model, the values before a fit, and three black boxes fitted to the same "
        "strokes; skill 0.6 is an error 60 % smaller than that of the best of them, below 0 it is larger.",
    ),
    (
        "outside",
        "a stroke faster, softer, briefer … than those the set was fitted to, or with a phase that none of them has.",
    ),
    ("ISO-style score", "a score from 0 to 1 in the style of ISO/TS 18571; 1 is best."),
    ("95 % band", "a band that holds the whole curve, not each instant alone, in 19 sessions of 20."),
    (
        "A, B, C",
        "positions of the thesis: at A the key reaches its bottom, at B the force is released completely, at C the key "
        "is back at its lowest point and begins to bounce.",
    ),
    ("let-off", "the jack leaves the hammer, which flies on freely."),
    ("check", "the back check catches the hammer after its rebound and holds it."),
    ("drop", "the hammer falls when the key comes up."),
    ("attack, check, release", "phases of a blow: to the string impact, to the key's release, to the end."),
    ("null, dash", "a dash stands for what does not exist or cannot be stated."),
)
"""Term and meaning."""


LARGEST_BYTES = 1_200_000
BYTES_PER_VALUE = 8 / 3
FEWEST_SAMPLES, MOST_SAMPLES = 150, 1000
LOST, LARGEST = -32768, 32767


def page_data(view: SessionView) -> str:
    """JSON of a session's curves for the page.

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
    leading = [on_base(base, shown["time_s"].to_numpy(), shown[f"{c}_measured_rad"]) for c in ENCODER_CHANNELS]
    at = base[uneven_samples(base, np.column_stack([*leading, force_on_base(base, shown)]), n)]
    channels: dict[str, Any] = {"force": {"m": [force_on_base(at, frame) for frame in first.traces.values()], "p": []}}
    for channel in ENCODER_CHANNELS:
        measured = [_rotation(frame, channel, "measured", at) for frame in first.traces.values()]
        predicted = [
            [_rotation(r.traces[t], channel, "predicted", at) if t in r.traces else np.full(at.size, np.nan)
             for t in trials]
            for r in view.results
        ]  # fmt: skip
        channels[channel] = {"m": measured, "p": predicted, "limit": [limit_of_trial(first, channel, at)]}
    content = {
        "t": base64.urlsafe_b64encode(np.asarray(at, dtype="<f8").tobytes()).decode("ascii"),
        "trials": trials,
        "shown": view.shown_trial(),
        "models": view.names,
        "channels": {name: _packed(curves) for name, curves in channels.items()},
        "marks": {t: [[m.label, round(m.time_s, 6), m.meaning] for m in first.marks(t)] for t in trials},
        "words": {c: {t: trial_words(view, c, t) for t in trials} for c in ENCODER_CHANNELS},
    }
    return json.dumps(content, separators=(",", ":"), ensure_ascii=False)


def _rotation(frame: Any, channel: str, kind: str, at: Array) -> Array:
    return degrees(channel, on_base(at, frame["time_s"].to_numpy(), frame[f"{channel}_{kind}_rad"].to_numpy()))


def _packed(curves: dict[str, Any]) -> dict[str, Any]:
    """Curves of one channel as text, with their common scale."""
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


def session_section(view: SessionView) -> dict[str, Any]:
    """Everything the page shows of one session, by the names that the template knows.

    Tables that depend on the model are made for each, their caption names it; ids lead with the session's prefix.
    """
    first = view.first
    return dict(
        prefix=view.prefix,
        result=first,
        simulated=is_simulated(first),
        impact_s=_impact_s(first),
        curves=page_data(view),
        verdicts=[r.verdict_lines for r in view.results],
        warnings=_warnings(view),
        figures=all_figures(view),
        tables={section: section_tables(view, section) for section in SECTIONS},
    )


def section_tables(view: SessionView, section: str) -> list[PageTable]:
    """Tables of a section that have rows, of all models of the session."""
    made = (page_table(table, page, view.results, view.prefix) for table, page in pages_of(section))
    return [table for table in made if table is not None]


def compared_tables(side: SideBySide) -> list[PageTable]:
    """Tables of all results together that have rows."""
    made = (
        made_table(table, page, [("", row) for row in side.compared[table.name].to_dict("records")])
        for table, page in pages_of("models")
    )
    return [table for table in made if table is not None]


def is_simulated(result: ValidationResult) -> bool:
    """Whether the session was recorded on the virtual bench."""
    return bool(result.provenance.get("session", {}).get("simulated", False))


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


HERE = Path(__file__).parent
ANIMATION = "animation.html"
SCRIPTS = ("zoom.js", "curves.js", "pointed.js", "tables.js")


def templates(*homes: Path) -> Environment:
    """Templates of a page: what comes from a session is escaped, and nothing may be undefined."""
    return Environment(
        loader=FileSystemLoader(list(homes)),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


def style_text() -> Markup:
    """The style sheet of every page."""
    return Markup((HERE / "report.css").read_text(encoding="utf-8"))


def render_html(side: SideBySide, *, animation: bool = False) -> str:
    """The report as one HTML page without outside addresses; no script but its own may run.

    ``animation``: the folder of the page has an `ANIMATION` to link.
    """
    script = "\n".join((HERE / name).read_text(encoding="utf-8").strip() for name in SCRIPTS)
    # the text between the tags, with the line end that the template puts on each side
    digest = hashlib.sha256(f"\n{script}\n".encode()).digest()
    environment = templates(HERE)
    environment.filters["drawn"] = Markup  # our own SVG; everything else is escaped
    template = environment.get_template("report.html.j2")
    several = len(side.sessions) > 1
    sections = [
        session_section(SessionView(tuple(results), f"s{i}-" if several else ""))
        for i, results in enumerate(side.sessions.values(), start=1)
    ]
    return template.render(
        side=side,
        sections=sections,
        style=style_text(),
        script=Markup(script),
        script_sha256=base64.b64encode(digest).decode(),
        heat=heat_map(side),
        forest=forest(side),
        phases=PHASES,
        faults=", ".join(dict.fromkeys(side.results[0].findings["kind"])),
        glossary=GLOSSARY,
        netcdf=netcdf_names(side),
        animation=ANIMATION if animation else "",
        compared=compared_tables(side),
        titles=SECTIONS,
        definitions=[(kind.title, kind.definition) for kind in EVENTS.values()],
        limits=cannot_claim(side),
        provenance=[(f"{r.session_name}, {r.action_name}", _flat(r.provenance)) for r in side.results],
    )


def cannot_claim(side: SideBySide) -> list[str]:
    """What a reader must not take from this report."""
    limits = [
        "The trials were played in one session on one action: this is repeatability. Other days, remounting, other "
        "actions and other benches are reproducibility, which is not measured here.",
        "The model is driven by the measured force, and that force depends on the action that was played; the motor is "
        "not part of the comparison.",
        "An encoder reads a rotation only while its body turns about its pivot. A key that lifts off the balance rail "
        "gives false readings; where the gap at the loaded capstan, by key and whippen encoder, is larger than the "
        f"model's by {1e3 * EXCESS_M:g} mm, they are marked and left out of the scores. Lifts with a smaller "
        "gap, or with none because the capstan is free, stay in.",
        "Whole-window scores mix a phase that is predicted well (until the string is struck) with one in which small "
        "differences grow; the score before the impact is listed beside them.",
        "Hammer height and key dip at rest are taken from the model's rest position; how well the bench agrees with it "
        "is part of the stated uncertainty of events, not measured here.",
    ]
    for results in side.sessions.values():
        where = f"{results[0].session_name}: " if len(side.sessions) > 1 else ""
        limits += [where + text for text in _limits_of(results[0])]
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


def _limits_of(result: ValidationResult) -> list[str]:
    """What is not known of one session."""
    limits = []
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


def _flat(value: object, prefix: str = "") -> list[tuple[str, str]]:
    """Nested provenance as pairs of dotted name and text."""
    if isinstance(value, dict):
        rows: list[tuple[str, str]] = []
        for key, item in value.items():
            if key == "event_definitions":
                continue
            rows += _flat(item, f"{prefix}.{key}" if prefix else str(key))
        return rows
    if isinstance(value, list | tuple):
        return [(prefix, json.dumps(value, ensure_ascii=False))]
    return [(prefix, str(value) if value not in ("", None) else "unknown")]
