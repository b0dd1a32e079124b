"""`results.json` against the schema made from the tables: every field is described, none is missing or added."""

from __future__ import annotations

import json
import math
import runpy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from validation import SideBySide, results_schema
from validation.report.write import results_json
from validation.side_by_side import present_alone
from validation.tables.schema import SCHEMA, SCHEMA_VERSION

ROOT = Path(__file__).parents[3]


@pytest.fixture(scope="module")
def schema():
    return results_schema()


@pytest.fixture(scope="module")
def check(schema):
    jsonschema = pytest.importorskip("jsonschema", reason="jsonschema reads the schema")
    jsonschema.Draft202012Validator.check_schema(schema)
    validator = jsonschema.Draft202012Validator(schema)

    def faults(side: SideBySide) -> list[str]:
        content = json.loads(results_json(side), parse_constant=lambda name: pytest.fail(name))
        return [f"{e.json_path}: {e.message[:200]}" for e in validator.iter_errors(content)]

    return faults


def test_results_of_a_session_and_of_the_planted_faults_keep_to_the_schema(check, compared, planted):
    assert check(present_alone(compared)) == []
    assert len(planted.findings) > 5
    assert check(present_alone(planted)) == []


def test_a_trial_that_is_not_used_and_what_is_not_known_are_null(check, compared):
    refused = {"trial": 9, "used": False, "reason": "rejected: fell off"}
    trials = pd.concat([compared.trials, pd.DataFrame([refused])], ignore_index=True)
    scores = compared.scores.assign(rmse_rad=[math.inf, -math.inf, math.nan] + [0.1] * (len(compared.scores) - 3))
    side = present_alone(compared.with_tables(trials=trials, scores=scores))
    assert check(side) == []
    rows = json.loads(results_json(side))["tables"]
    assert rows["trials"][-1]["peak_force_n"] is None
    assert [row["rmse_rad"] for row in rows["scores"][:4]] == [None, None, None, 0.1]


def test_the_schema_refuses_what_it_does_not_describe(check, compared):
    """A column that is added, or leaves, is found: so the schema stays in step."""
    more = compared.with_tables(channels=compared.channels.assign(new=1.0))
    assert any("'new' was unexpected" in text for text in check(present_alone(more)))
    less = compared.with_tables(scores=compared.scores.drop(columns="n_lost"))
    assert any("'n_lost' is a required property" in text for text in check(present_alone(less)))
    other = replace(compared, provenance={**compared.provenance, "tolerance_rad": np.nan})
    assert any("tolerance_rad" in text for text in check(present_alone(other)))


def fields(schema, name=""):
    """Every described field of a schema, with its name."""
    for key, field in schema.get("properties", {}).items():
        yield f"{name}.{key}", field
        yield from fields(field, f"{name}.{key}")
        yield from fields(field.get("items", {}), f"{name}.{key}[]")
        if isinstance(field.get("additionalProperties"), dict):
            yield from fields(field["additionalProperties"], f"{name}.{key}.*")


def test_every_field_has_a_meaning_and_every_number_a_unit(schema):
    found = dict(fields(schema))
    assert len(found) > 200
    assert (schema["properties"]["schema"]["const"], schema["properties"]["schema_version"]["const"]) == (
        SCHEMA,
        SCHEMA_VERSION,
    )
    endings = {"_rad": "rad", "_hz": "Hz", "_n": "N", "_over_range": "1", "_share": "1"}
    without_unit = {"trial", "limit", "value", "schema_version"}  # a number of a trial; findings say it in their text
    for name, field in found.items():
        assert len(field["description"]) >= 3, name
        kinds = field.get("type", "const")
        if "number" in kinds and name.split(".")[-1] not in without_unit:
            assert field["unit"], name
        if field.get("type") == "object" and "properties" in field:
            assert field["additionalProperties"] is False, name
        for ending, unit in endings.items():
            assert not name.endswith(ending) or field.get("unit", unit) == unit, name


def test_the_page_is_made_from_the_schema(schema):
    page = runpy.run_path(str(ROOT / "docs" / "make_results_page.py"))["page"]
    text = page(schema)
    assert (ROOT / "docs" / "results.md").read_text(encoding="utf-8") == text
    for name in schema["properties"]["tables"]["properties"]:
        assert f"| `{name}` |" in text
