"""One module per command, each a thin call of a documented function of the packages below."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any

NAMES = (
    "demo",
    "record",
    "learn",
    "recover",
    "import",
    "attach",
    "annotate",
    "watch",
    "track",
    "calibrate-camera",
    "simulate",
    "touch",
    "study",
    "regulate",
    "calibrate-felt",
    "validate",
    "serve-sim",
    "selftest",
    "info",
)


def load(name: str) -> Callable[..., Any]:
    """The function of a command; its module imports nothing heavy."""
    function: Callable[..., Any] = import_module("." + name.replace("-", "_"), __name__).command
    return function
