"""The public functions of the packages, as their stubs list them, and what of them takes arrays."""

from __future__ import annotations

import ast
import functools
import importlib
import inspect
import re
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

ROOT = Path(__file__).parents[1]
PACKAGES = ("model", "vision", "rig", "validation")
ARRAYS = re.compile(
    r"ndarray|\bArray\b|ArrayLike|NDArray|_SupportsArray|(Sequence|list)\[float\]|tuple\[float, \.\.\.\]"
)


@functools.cache
def _public(packages: tuple[str, ...]) -> tuple[dict[str, Any], list[ModuleType]]:
    """What stubs give out, by its shortest dotted name; and the modules among it."""
    found: dict[str, Any] = {}
    seen: set[int] = set()
    modules: list[ModuleType] = []
    for package in packages:
        for stub in sorted((ROOT / package).rglob("__init__.pyi"), key=lambda path: len(path.parts)):
            face = ".".join(stub.parent.relative_to(ROOT).parts)
            for node in ast.parse(stub.read_text(encoding="utf-8")).body:
                if isinstance(node, ast.ImportFrom):
                    for alias in node.names:
                        name = alias.asname or alias.name
                        one = getattr(importlib.import_module(face), name)
                        if inspect.ismodule(one):
                            modules.append(one)
                        elif id(one) not in seen:
                            found[f"{face}.{name}"] = one
                            seen.add(id(one))
    for module in modules:
        for name, one in vars(module).items():
            ours = (inspect.isfunction(one) or inspect.isclass(one)) and one.__module__ == module.__name__
            if ours and not name.startswith("_") and id(one) not in seen:
                found[f"{module.__name__}.{name}"] = one
                seen.add(id(one))
    return found, modules


def public_functions() -> dict[str, Callable[..., Any]]:
    """Every function that a stub or a listed module gives out, by its shortest dotted name."""
    return {name: one for name, one in _public(PACKAGES)[0].items() if inspect.isfunction(one)}


@functools.cache
def public_classes() -> dict[str, type]:
    """Every class that a stub of the five packages or a listed module gives out, but protocols."""
    every = _public((*PACKAGES, "pianorig"))[0]
    return {
        name: one for name, one in every.items() if inspect.isclass(one) and not getattr(one, "_is_protocol", False)
    }


@functools.cache
def with_methods() -> dict[str, Callable[..., Any]]:
    """The public functions of the five packages, and the public methods of their public classes, inherited ones too."""
    every = _public((*PACKAGES, "pianorig"))[0]
    found = {name: one for name, one in every.items() if inspect.isfunction(one)}
    for name, one in public_classes().items():
        for base in one.__mro__:
            if base.__module__.split(".")[0] not in (*PACKAGES, "pianorig"):
                continue
            for own, member in vars(base).items():
                plain = getattr(member, "__func__", member)
                made = own == "__init__" and not hasattr(one, "__dataclass_fields__")
                if not inspect.isfunction(plain) or plain.__name__ != own:  # a former name of another member
                    continue
                if made or not own.startswith("_"):
                    found.setdefault(name if made else f"{name}.{own}", plain)
    return found


def array_parameters(function: Callable[..., Any]) -> list[str]:
    """Parameters of a function whose annotation, aliases of its module resolved, has arrays or rows of numbers."""
    found = []
    for parameter in inspect.signature(function).parameters.values():
        text = str(parameter.annotation)
        names = re.findall(r"[A-Za-z_]\w*", text)
        known = [vars(inspect.getmodule(function)).get(name) for name in names]
        aliases = [repr(one) for one in known if not inspect.isclass(one) and not inspect.ismodule(one)]
        if ARRAYS.search(text) or any(ARRAYS.search(alias) for alias in aliases if not alias.startswith("<")):
            found.append(parameter.name)
    return found
