"""Write `docs/results.md` from the schema of ``results.json``: its top level and its tables.

Run after changing a table:  python docs/make_results_page.py
The page of every field with its meaning and unit is made with the site, by ``docs/make_reference_pages.py``.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from validation import results_schema

PAGE = Path(__file__).with_name("results.md")
HEAD = """# results.json

Beside every `report.html` stand `results.json` and, one file per table, `tables/*.csv` with the same columns. Type,
unit and meaning of every field: JSON Schema `validation.results_schema()`, and the site's page *Fields of
results.json*. SI units and radians; angles are changes since rest, counter-clockwise; times are on the DAQ clock. A
number that does not exist is null in JSON and an empty cell in CSV.

```python
import json
import pandas

results = json.load(open("report/results.json", encoding="utf-8"))
scores = pandas.DataFrame(results["tables"]["scores"])
print(scores.pivot_table("rmse_rad", ["session", "model"], "channel"))
```

Curves stand beside it: `curves.nc` (netCDF-4; `xarray.open_dataset("curves.nc", engine="h5netcdf")`, or
`validation.read_curves("curves.nc")` as a tidy table), and by channel `curves/*.csv`.
"""
FIELDS = """# Fields of results.json

Every field of `results.json` and of `tables/*.csv`, from the schema. "unit of the row": see the row's column `unit`.
"""


def page(schema: dict[str, Any]) -> str:
    """Return the text of the page: what is at the top, and what a row of each table is."""
    properties = schema["properties"]
    rows = "\n".join(
        f"| `{name}` | {table['description'].split('. ')[0].removeprefix('One row per ')} |"
        for name, table in properties["tables"]["properties"].items()
    )
    return "\n".join(
        [
            HEAD,
            "## Top level\n",
            _table(_flat(properties, most=1)),
            f"## Tables\n\n| table | one row per |\n|---|---|\n{rows}\n",
        ]
    )


def fields(schema: dict[str, Any]) -> str:
    """Return the page of every field with its type, unit and meaning."""
    properties = schema["properties"]
    parts = [FIELDS, "## Each of `results`\n", _table(_flat(properties["results"]["items"]["properties"]))]
    parts += [
        "## Each of `event_definitions`\n",
        _table(_flat(properties["event_definitions"]["additionalProperties"]["properties"])),
    ]
    for name, table in properties["tables"]["properties"].items():
        parts += [f"## `tables.{name}`, `tables/{name}.csv`\n", f"{table['description']}.\n"]
        parts += [_table(_flat(table["items"]["properties"]))]
    return "\n".join(parts)


def _flat(properties: dict[str, Any], prefix: str = "", most: int = 9) -> Iterator[tuple[str, str, str, str]]:
    for name, field in properties.items():
        yield f"{prefix}{name}", _type(field), field.get("unit", ""), field["description"]
        if most > 1 and "properties" in field:
            yield from _flat(field["properties"], f"{prefix}{name}.", most - 1)


def _type(field: dict[str, Any]) -> str:
    if "const" in field:
        return json.dumps(field["const"])
    kind = field["type"]
    return " or ".join(kind) if isinstance(kind, list) else kind


def _table(rows: Iterator[tuple[str, str, str, str]]) -> str:
    lines = ["| field | type | unit | meaning |", "| --- | --- | --- | --- |"]
    for name, kind, unit, meaning in rows:
        lines.append(f"| `{name}` | {kind} | {unit} | {meaning.replace('|', chr(92) + '|')} |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    PAGE.write_text(page(results_schema()), encoding="utf-8")
