"""Public names: each exists once."""

from __future__ import annotations

import importlib
import inspect

import pytest


@pytest.mark.parametrize("face", ["model", "vision", "rig", "validation"])
def test_every_public_name_exists_once(face: str) -> None:
    """No function or class has two names; an error of bad input is ``InputError`` of its package as well."""
    package = importlib.import_module(face)
    names: dict[int, list[str]] = {}
    for name in dir(package):
        found = getattr(package, name)
        if (inspect.isfunction(found) or inspect.isclass(found)) and name != "InputError":
            names.setdefault(id(found), []).append(name)
    assert [twice for twice in names.values() if len(twice) > 1] == []
