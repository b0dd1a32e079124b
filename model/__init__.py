"""The stiff multibody model of a grand-piano action: parameters, statics, simulation, observables.

A leaf of the project: arrays and parameter files in, arrays out; it knows nothing of sessions or films.
Names are loaded on first use, so that reading a parameter file needs no compiler.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

_HOME = {
    "BODIES": "parameters.action",
    "Action": "parameters.action",
    "load_action": "parameters.action",
    "scaled": "parameters.scaling",
    "InputError": "errors",
    "IntegrationError": "errors",
    "ModelError": "errors",
    "StaticsError": "errors",
    "SCENES": "scene.selection",
    "SceneChoice": "scene.selection",
    "load_scene": "scene.selection",
    "scene_of": "scene.selection",
    "Scene": "scene.build",
    "build_scene": "scene.build",
    "RestState": "simulation.statics",
    "rest_state": "simulation.statics",
    "Simulation": "simulation.run",
    "State": "simulation.run",
    "EnergyAudit": "simulation.solution",
    "Solution": "simulation.solution",
    "read_force_table": "force_driven",
    "check_force_table": "force_driven",
    "output_times": "force_driven",
    "simulate": "force_driven",
    "simulate_many": "batch",
    "KeyMotion": "scene.key_motion",
    "MotionDriven": "motion_driven.simulate",
    "simulate_motion": "motion_driven.simulate",
    "read_motion_table": "motion_driven.motion_table",
    "Press": "motion_driven.slow_press",
    "hand_set_rest": "simulation.hand_set_rest",
    "slow_press": "motion_driven.slow_press",
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
