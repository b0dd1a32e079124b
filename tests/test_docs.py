"""Pages and pictures that are made by a script are as the script makes them today."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

DOCS = Path(__file__).parents[1] / "docs"


def script(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, DOCS / f"{name}.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_architecture_is_drawn_from_todays_imports() -> None:
    made = script("make_architecture")
    assert made.PICTURE.read_text(encoding="utf-8") == made.draw(), "run: python docs/make_architecture.py"
    assert made.PAGE.read_text(encoding="utf-8") == made.page(), "run: python docs/make_architecture.py"


def test_every_decision_is_numbered_and_listed() -> None:
    made = script("make_decision_index")
    assert (DOCS / "decisions" / "README.md").read_text(encoding="utf-8") == made.index()
