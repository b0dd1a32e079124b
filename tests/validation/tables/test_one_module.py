"""A table is one module: what a file of the folder describes is in files, schema and page; nothing else names it."""

from __future__ import annotations

import sys

import pandas as pd
import pytest

import validation.tables
from validation import results_schema
from validation.report.page import render_html
from validation.side_by_side import present_alone
from validation.tables.catalogue import all_tables, every_table
from validation.tables.comparison import Comparison
from validation.tables.table import Column, Page, Table

MODULE = """
from validation.tables.table import TRIAL, Column, Page, Table

COLUMNS = (TRIAL, Column("swing_rad", "rad", "Largest swing of a pendulum", head="swing"))


def rows(comparison):
    return [{"trial": number, "swing_rad": 0.1 * number} for number in (1, 2)]


TABLE = Table("swings", "trial: swing of a pendulum", COLUMNS, rows, (Page("repeatability", "Swings of a pendulum"),))
"""


@pytest.fixture
def added(tmp_path, monkeypatch):
    """A folder with one more table, as if its file lay beside the others."""
    (tmp_path / "swings.py").write_text(MODULE, encoding="utf-8")
    monkeypatch.setattr(validation.tables, "__path__", [*validation.tables.__path__, str(tmp_path)])
    every_table.cache_clear()
    yield all_tables()["swings"]
    every_table.cache_clear()
    sys.modules.pop("validation.tables.swings", None)


def test_one_file_adds_a_table_to_results_schema_and_page(added, compared, without_figures):
    made = Comparison(*[None] * 8)  # its rows ask for nothing
    result = compared.with_tables(swings=made.table("swings"))
    assert result.swings["swing_rad"].tolist() == [0.1, 0.2]
    side = present_alone(result)
    assert list(side.tables["swings"].columns) == ["session", "model", "trial", "swing_rad"]
    columns = results_schema()["properties"]["tables"]["properties"]["swings"]["items"]["properties"]
    assert columns["swing_rad"]["unit"] == "rad"
    page = render_html(side)
    table = page[page.index('<table id="table-repeatability-swings"') :].split("</table>")[0]
    assert "swing (°)" in table and "<td>5.73</td>" in table


def test_a_column_that_is_not_described_is_a_defect():
    table = Table("t", "thing", (Column("a", "1", "A"),), lambda of: pd.DataFrame({"b": [1.0]}), (Page("trials", "T"),))
    with pytest.raises(ValueError, match="table t: a, b found or described, not both"):
        table.make(None)
