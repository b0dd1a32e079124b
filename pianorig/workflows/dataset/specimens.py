"""The specimens of the data set: actions that differ from the regulated set in ways that only the truth states."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

import model

BASE = "hirschkorn2004-regulated"
SCREWS = {"contact08.second.y": 2e-4, "contact11.first.y": 2e-4, "contact04.second.x": 5e-4}
"""Regulation: standard deviations, m."""
FACTORS = {
    "key.joint_friction.A": 0.3, "whippen.joint_friction.A": 0.3, "hammer.joint_friction.A": 0.3,
    "contact01.friction.A": 0.2, "contact04.friction.A": 0.2, "contact07.friction.A": 0.2, "contact10.friction.A": 0.2,
    "contact01.normal.D": 0.3, "contact02.normal.D": 0.3, "contact03.normal.D": 0.3, "contact12.normal.D": 0.1,
    "hammer.mass": 0.03, "key.inertia": 0.03, "repetition_spring.stiffness": 0.05, "jack_spring.torque": 0.1,
}  # fmt: skip
"""Standard deviations of logarithms."""
SCATTER = {"key.joint_friction.A": 0.03, "contact07.friction.A": 0.02, "contact04.friction.A": 0.02}
"""What changes from trial to trial, relative."""
MOST = 2.0
"""Draws are cut at so many standard deviations."""


@dataclass(frozen=True)
class Specimen:
    """A specimen: its name, changed parameters, the true gain of the motor, the seed of its scatter, and its scene."""

    name: str
    changed: dict[str, float]
    torque_per_volt_nm: float
    seed: int
    scene: str = "whole"

    def action(self) -> model.Action:
        """The action with its parameters, in its scene."""
        return model.load_scene(self.scene).on(model.load_action(BASE)).with_values(self.changed)


def draw_specimen(name: str, random: np.random.Generator, scene: str = "whole") -> Specimen:
    """Draw a specimen that can be played: one whose rest cannot be found is drawn again."""
    base = model.load_scene(scene).on(model.load_action(BASE))
    while True:
        changed = {path: base[path] + sd * _cut(random) for path, sd in SCREWS.items()}
        changed |= {path: base[path] * float(np.exp(sd * _cut(random))) for path, sd in FACTORS.items()}
        gain = 1.2 * float(np.exp(0.01 * _cut(random)))
        seed = int(random.integers(2**31))
        try:
            model.rest_state(base.with_values(changed))
        except model.ModelError:
            continue
        return Specimen(name, changed, gain, seed, scene)


def _cut(random: np.random.Generator) -> float:
    return float(np.clip(random.standard_normal(), -MOST, MOST))
