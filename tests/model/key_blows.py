"""Blows whose key is measured as on the bench: motion from a force, the key's true derivatives, encoder counts."""

from __future__ import annotations

import tomllib
from functools import cache
from pathlib import Path

import numpy as np

import model
from model.codegen.load import load_kernels
from model.kernels import workspace as W
from tests.model.conftest import read_table

COUNT = 2.0 * np.pi / 327680
PROFILES = ("forte", "piano", "double")
_DOUBLE = Path(__file__).parents[2] / "rig" / "profiles" / "double.toml"


@cache
def blow(name: str) -> tuple[np.ndarray, np.ndarray, model.Solution]:
    """Times, force and motion of a blow, 5 kHz."""
    if name == "double":
        points = tomllib.loads(_DOUBLE.read_text())["points"]
        time = np.arange(3201) / 5000.0
        force = np.interp(time, [p["time_s"] for p in points], [p["force_n"] for p in points])
    else:
        time, force = read_table(f"{name}_force.csv").T.copy()
    return time, force, model.simulate(model.load_action(), time, force, tolerance=1e-9)


@cache
def key_truth(name: str) -> tuple[np.ndarray, np.ndarray]:
    """Times (m,) and angle, speed, acceleration (m, 3) of the key; the acceleration from the equations of motion."""
    time, force, forward = blow(name)
    scene = model.build_scene(model.load_action())
    kernels, w, acceleration = load_kernels(scene.tables), np.zeros(W.SIZE), []
    for q, v, f in zip(forward.angle_rad, forward.speed_rad_per_s, force, strict=True):
        w[W.Q : W.Q + 5], w[W.V : W.V + 5] = q, v
        kernels.linearise(w, scene.vector, f)
        acceleration.append(w[W.ACC])
    return time, np.column_stack([forward.angle_rad[:, 0], forward.speed_rad_per_s[:, 0], acceleration])


def counted(truth: np.ndarray, seed: int, jitter: float = 0.5, clock_s: float = 0.0) -> np.ndarray:
    """What an encoder gives: whole counts from a known, random zero; ``jitter`` in counts, ``clock_s`` of the times."""
    random = np.random.default_rng(seed)
    phase, n = random.uniform(), len(truth)
    angle = truth[:, 0] + truth[:, 1] * random.normal(0.0, 1.0, n) * clock_s
    return (np.floor(angle / COUNT + random.normal(0.0, 1.0, n) * jitter + phase) - phase + 0.5) * COUNT
