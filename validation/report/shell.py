"""The shell of every page: style, scripts and what may run; a template fills its blocks."""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

HERE = Path(__file__).parent
SCRIPTS = ("zoom.js", "curves.js", "tables.js")


def fill_page(template: str, /, **fields: Any) -> str:
    """HTML text of the page ``template`` filled with ``fields``, which are escaped unless the template marks them as
    drawn; no outside addresses, and only the report's own scripts may run. A field that is missing raises."""
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
    environment.filters["drawn"] = Markup
    return environment.get_template(template).render(
        style=Markup((HERE / "report.css").read_text(encoding="utf-8")),
        script=Markup(script),
        script_sha256=base64.b64encode(digest).decode(),
        **fields,
    )


def flatten_provenance(value: Mapping[str, Any], prefix: str = "") -> list[tuple[str, str]]:
    """Pairs of dotted name, led by ``prefix``, and text of all values of nested provenance; event definitions are left
    out, missing values read ``unknown``."""
    rows: list[tuple[str, str]] = []
    for key, item in value.items():
        name = f"{prefix}{key}"
        if isinstance(item, Mapping):
            rows += flatten_provenance(item, f"{name}.") if key != "event_definitions" else []
        elif isinstance(item, list | tuple):
            rows.append((name, json.dumps(item, ensure_ascii=False)))
        else:
            rows.append((name, "unknown" if item in ("", None) else str(item)))
    return rows
