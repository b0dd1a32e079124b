"""The stiff multibody model of a grand-piano action: parameters, statics, simulation, observables.

A leaf of the project: arrays and parameter files in, arrays out; it knows nothing of sessions or films.
Names are loaded on first use, so that reading a parameter file needs no compiler.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

_HOME = {
    "BODIES": "parameters",
    "Action": "parameters",
    "load_action": "parameters",
    "scaled": "changes",
    "InputError": "errors",
    "IntegrationError": "errors",
    "ModelError": "errors",
    "StaticsError": "errors",
    "SCENES": "choice",
    "SceneChoice": "choice",
    "load_scene": "choice",
    "scene_of": "choice",
    "Scene": "scene",
    "build_scene": "scene",
    "RestState": "statics",
    "rest_state": "statics",
    "Simulation": "simulation",
    "State": "simulation",
    "EnergyAudit": "solution",
    "Solution": "solution",
    "read_force_table": "blow",
    "check_force_table": "blow",
    "output_times": "blow",
    "simulate": "blow",
    "simulate_many": "batch",
    "KeyMotion": "motion",
    "MotionDriven": "motion_driven",
    "simulate_motion": "motion_driven",
    "read_motion_table": "motion_table",
    "Press": "press",
    "hand_set_rest": "hand_set",
    "slow_press": "press",
}
_ROOMS = ("batch", "calibration", "inside", "null_model", "observables", "regulation", "touch")

__all__ = [*_HOME, *_ROOMS]  # noqa: PLE0604


def __getattr__(name: str) -> Any:
    """Import the home of a public name when it is first asked for."""
    if name in _HOME:
        return getattr(import_module(f".{_HOME[name]}", __name__), name)
    if name in _ROOMS:
        return import_module(f".{name}", __name__)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
