"""The script that makes the Kawai's session runs, and its parameters are those of the shipped action."""

from pathlib import Path

import pytest

import model
from sessions.make_kawai import FREE, action_of, z_of

SHIPPED = Path(__file__).parents[2] / "sessions" / "kawai_kg3c" / "identified.toml"


def test_parameters_of_the_shipped_action_give_its_values_again() -> None:
    shipped = model.load_action(SHIPPED)
    again = action_of(z_of(shipped))
    for path in (path for one in FREE for path in one.paths):
        assert again[path] == pytest.approx(shipped[path], rel=1e-6), path
