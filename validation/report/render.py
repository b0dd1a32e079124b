"""The page: tables, figures and text filled into ``report.html.j2``.

Text that comes from a session is escaped by the template engine; only our own SVG is passed through as it is.
"""

from __future__ import annotations

import base64
import hashlib
import json
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from validation.events.definitions import EVENTS
from validation.report.curve_files import netcdf_names
from validation.report.glossary import GLOSSARY
from validation.report.sections import is_simulated, session_section
from validation.report.tables.forest import forest
from validation.report.tables.heat_map import heat_map
from validation.report.tables.models import matrix, pair_tables
from validation.report.view import SessionView
from validation.result import ValidationResult
from validation.side_by_side import SideBySide
from validation.tables.phases import PHASES

HERE = Path(__file__).parent
ANIMATION = "animation.html"
SCRIPTS = ("zoom.js", "curves.js", "pointed.js", "tables.js")


def render_html(side: SideBySide, *, animation: bool = False) -> str:
    """The report as one HTML page without outside addresses; no script but its own may run.

    ``animation``: the folder of the page has an `ANIMATION` to link.
    """
    script = "\n".join((HERE / name).read_text(encoding="utf-8").strip() for name in SCRIPTS)
    # the text between the tags, with the line end that the template puts on each side
    digest = hashlib.sha256(f"\n{script}\n".encode()).digest()
    environment = Environment(
        loader=FileSystemLoader(HERE),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
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
        style=Markup((HERE / "report.css").read_text(encoding="utf-8")),
        script=Markup(script),
        script_sha256=base64.b64encode(digest).decode(),
        heat=heat_map(side),
        forest=forest(side),
        phases=PHASES,
        faults=", ".join(dict.fromkeys(side.results[0].findings["kind"])),
        glossary=GLOSSARY,
        netcdf=netcdf_names(side),
        animation=ANIMATION if animation else "",
        matrix=matrix(side) if len(side.results) > 1 else None,
        pairs=pair_tables(side) if len(side.model_pairs) else None,
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
        "gives false readings; where key and whippen encoders disagree they are marked and left out of the scores. "
        "Lifts below about 0.1 mm, and lifts while the capstan is free, stay in.",
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
