"""One module per command, each a thin call of a documented function of the packages below."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any

HOME = {
    "demo": "validation.demo",
    "record": "bench.record",
    "learn": "bench.learn",
    "recover": "bench.recover",
    "import": "bench.import_recording",
    "attach": "film.attach",
    "annotate": "bench.annotate",
    "watch": "bench.watch",
    "track": "film.track",
    "calibrate-camera": "film.calibrate_camera",
    "simulate": "model.simulate",
    "touch": "model.touch",
    "study": "model.study",
    "regulate": "model.regulate",
    "calibrate-felt": "model.calibrate_felt",
    "validate": "validation.validate",
    "serve-sim": "bench.serve_sim",
    "selftest": "bench.selftest",
    "info": "bench.info",
}
"""Module of each command, in the order of ``--help``."""


def load(name: str) -> Callable[..., Any]:
    """The function of a command; its module imports nothing heavy."""
    function: Callable[..., Any] = import_module(f"pianorig.commands.{HOME[name]}").command
    return function
