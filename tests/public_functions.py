"""The public functions of the four packages, as their stubs list them."""

from __future__ import annotations

import ast
import importlib
import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
PACKAGES = ("model", "vision", "rig", "validation")


def public_functions() -> dict[str, Callable[..., Any]]:
    """Every function that a stub or a listed module gives out, by its shortest dotted name."""
    found: dict[str, Callable[..., Any]] = {}
    for package in PACKAGES:
        for stub in sorted((ROOT / package).rglob("__init__.pyi"), key=lambda path: len(path.parts)):
            face = ".".join(stub.parent.relative_to(ROOT).parts)
            for node in ast.parse(stub.read_text(encoding="utf-8")).body:
                if isinstance(node, ast.ImportFrom):
                    for alias in node.names:
                        _add(found, face, alias.asname or alias.name)
    return found


def _add(found: dict[str, Callable[..., Any]], face: str, name: str) -> None:
    one = getattr(importlib.import_module(face), name)
    if inspect.isfunction(one):
        if one not in found.values():
            found[f"{face}.{name}"] = one
    elif inspect.ismodule(one) and not (Path(one.__file__ or "").parent / "__init__.pyi").exists():
        for inner, function in vars(one).items():
            ours = inspect.isfunction(function) and function.__module__ == one.__name__
            if ours and not inner.startswith("_") and function not in found.values():
                found[f"{one.__name__}.{inner}"] = function
