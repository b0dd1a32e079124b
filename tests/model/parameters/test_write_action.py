"""Written parameter sets read back to the same numbers and texts; nothing half-written."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import model
from model.parameters.action import action_text
from model.regulation import write_action


def test_round_trip(action: model.Action, tmp_path: Path) -> None:
    write_action(action, tmp_path / "a.toml", ["first line", "second"])
    back = model.load_action(tmp_path / "a.toml")
    assert back.quantities == action.quantities and dict(back.structure) == dict(action.structure)
    assert (back.name, back.description) == (action.name, action.description)
    assert (tmp_path / "a.toml").read_text().startswith("# first line\n# second\n")
    assert [p.name for p in tmp_path.iterdir()] == ["a.toml"]


@settings(max_examples=30)  # each reads a whole set
@given(st.text(st.characters(exclude_categories=["Cs"]), max_size=40))
def test_any_text_reads_back(text: str) -> None:
    action = model.load_action()
    table = tomllib.loads(action_text(replace(action, name=text)))
    assert table["name"] == text


def test_refusals(action: model.Action, tmp_path: Path) -> None:
    with pytest.raises(model.InputError, match=r"ending found '\.csv'"):
        write_action(action, tmp_path / "a.csv")
    with pytest.raises(model.InputError, match="cannot be written"):
        write_action(action, tmp_path / "no" / "a.toml")
    assert not list(tmp_path.iterdir())
