"""The public functions of the four packages, as their stubs list them."""

from __future__ import annotations

import ast
import importlib
import inspect
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

ROOT = Path(__file__).parents[1]
PACKAGES = ("model", "vision", "rig", "validation")


def public_functions() -> dict[str, Callable[..., Any]]:
    """Every function that a stub or a listed module gives out, by its shortest dotted name."""
    found: dict[str, Callable[..., Any]] = {}
    modules: list[ModuleType] = []
    for package in PACKAGES:
        for stub in sorted((ROOT / package).rglob("__init__.pyi"), key=lambda path: len(path.parts)):
            face = ".".join(stub.parent.relative_to(ROOT).parts)
            for node in ast.parse(stub.read_text(encoding="utf-8")).body:
                if isinstance(node, ast.ImportFrom):
                    for alias in node.names:
                        name = alias.asname or alias.name
                        one = getattr(importlib.import_module(face), name)
                        if inspect.isfunction(one) and one not in found.values():
                            found[f"{face}.{name}"] = one
                        elif inspect.ismodule(one):
                            modules.append(one)
    for module in modules:
        for name, one in vars(module).items():
            ours = inspect.isfunction(one) and one.__module__ == module.__name__
            if ours and not name.startswith("_") and one not in found.values():
                found[f"{module.__name__}.{name}"] = one
    return found
