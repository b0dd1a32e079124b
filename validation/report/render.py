"""The page: tables, figures and text filled into ``report.html.j2``.

Place in the data flow: `ValidationResult` → HTML text, complete in itself.
Conventions: text that comes from a session is escaped by the template engine; only our own SVG is passed
through as it is.
Failure: none of its own.
"""

from __future__ import annotations

import base64
import hashlib
import json
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from validation.event import EVENTS
from validation.report import present
from validation.report.budget_table import area_table, budget_table
from validation.report.figures import all_figures
from validation.report.scorecard_table import scorecard_table
from validation.result import ValidationResult

HERE = Path(__file__).parent


def render_html(result: ValidationResult) -> str:
    """The report as one HTML page without outside addresses; its only script is the zoom, and no other may run."""
    script = (HERE / "zoom.js").read_text(encoding="utf-8")
    # the text between the tags, with the line end that the template puts on each side
    digest = hashlib.sha256(f"\n{script}\n".encode()).digest()
    environment = Environment(
        loader=FileSystemLoader(HERE),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    template = environment.get_template("report.html.j2")
    figures = {
        group: [{"figure": f, "svg": Markup(f.svg)} for f in members] for group, members in all_figures(result).items()
    }
    return template.render(
        result=result,
        style=Markup((HERE / "report.css").read_text(encoding="utf-8")),
        script=Markup(script),
        script_sha256=base64.b64encode(digest).decode(),
        impact_s=_impact_s(result),
        figures=figures,
        score_matrix=present.score_matrix(result),
        scorecard=scorecard_table(result),
        iso=present.iso_table(result),
        differences=present.resolution_table(result),
        events=present.event_page_table(result),
        budget=budget_table(result),
        area=area_table(result),
        events_by_trial=present.event_by_trial_table(result),
        repeatability=present.repeatability_tables(result),
        trials=present.trial_page_table(result),
        definitions=[(kind.title, kind.definition) for kind in EVENTS.values()],
        limits=cannot_claim(result),
        provenance=_flat(result.provenance),
        simulated=bool(result.provenance.get("session", {}).get("simulated", False)),
    )


def _impact_s(result: ValidationResult) -> float | None:
    """String impact of the first trial that has one."""
    e = result.events
    times = e[(e["source"] == "trial") & (e["event"] == "string_impact")]["value"].dropna()
    return float(times.iloc[0]) if len(times) else None


def cannot_claim(result: ValidationResult) -> list[str]:
    """What a reader must not take from this report."""
    n = len(result.traces)
    limits = [
        "The trials were played in one session on one action: this is repeatability. Other days, remounting, other "
        "actions and other benches are reproducibility, which is not measured here.",
        "The model is driven by the measured force, and that force depends on the action that was played; the motor is "
        "not part of the comparison.",
        "An encoder reads a rotation only while its body turns about its pivot. A key that lifts off the balance rail "
        "gives false readings; where key and whippen encoders disagree they are marked and left out of the scores. "
        "Lifts below about 0.1 mm, and lifts while the capstan is free, stay in.",
        "Whole-window scores mix a phase that is predicted well (until the string is struck) with one in which small "
        "differences grow; the score before the impact is listed beside them.",
        "Hammer height and key dip at rest are taken from the model's rest position; how well the bench agrees with it "
        "is part of the stated uncertainty of events, not measured here.",
    ]
    filmed = len(result.film_traces)
    if filmed == 0:
        limits.append("Jack and repetition lever were not filmed: nothing is said about them.")
    elif filmed == 1:
        limits.append("Jack and repetition lever were filmed in one trial only: their repeatability is not known.")
    if n < 2:
        limits.append("With one trial no difference can be judged against repeatability.")
    if bool(result.provenance.get("session", {}).get("simulated", False)):
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
