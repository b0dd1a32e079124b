"""What the bending of a landed key does to the check, front and action computed together (docs/explanation/effects.md).

The front is a mass on the key's bending; force and front felt act on it, and what its spring passes on acts on the
rest of the action, block by block: ``python -m pytest -m slow tests/model/verification/test_landed_flexible_key.py``.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

import model
from model.simulation.run import Simulation, State
from model.simulation.solution import Solution
from model.simulation.statics import solve_rest
from model.study import BlowMeasures, measure_blow
from tests.model.verification.test_flexible_key import ELASTIC, key_bending

STEP_S, EVERY = 1e-5, 10
DAMPING = 0.02


class Front:
    """The front of a key: its mass, the spring of the key's bending, and the felt it lands on."""

    def __init__(self, action: model.Action, elastic: float, stiffer: float) -> None:
        frequency, give = key_bending(action, elastic)
        self.x, self.y = action["drive.point.x"], action["drive.point.y"]
        self.mass = 1.0 / (give * (2.0 * math.pi * frequency) ** 2)
        self.k = stiffer / give
        self.c = 2.0 * DAMPING * math.sqrt(self.k * self.mass)
        self.weight = self.mass * action["gravity.g"]
        names = ("first.x", "first.y", "first.radius", "second.x", "second.y")
        self.place = [action[f"contact02.{name}"] for name in names]
        self.law = [action[f"contact02.normal.{name}"] for name in "abcD"]

    def rest_of(self, action: model.Action) -> model.Action:
        """The action without the front's mass and without its felt: all of it together weighs and turns as before."""
        m, inertia = action["key.mass"], action["key.inertia"]
        cx, cy = action["key.center_of_mass.x"], action["key.center_of_mass.y"]
        left = m - self.mass
        x, y = (m * cx - self.mass * self.x) / left, (m * cy - self.mass * self.y) / left
        inertia += m * (cx * cx + cy * cy) - self.mass * (self.x**2 + self.y**2) - left * (x * x + y * y)
        values = {"key.mass": left, "key.inertia": inertia, "key.center_of_mass.x": x, "key.center_of_mass.y": y}
        return action.with_values({**values, "contact02.first.y": -0.1})

    def straight(self, angle: float, speed: float) -> tuple[float, float]:
        """Where the front of an unbent key is, downwards (m), and how fast it goes."""
        s, c = math.sin(angle), math.cos(angle)
        return -(self.x * s + self.y * c), -(self.x * c - self.y * s) * speed

    def felt(self, angle: float, speed: float, sag: float, sags: float) -> float:
        """Force of the felt under the front."""
        fx, fy, radius, x, y = self.place
        s, c = math.sin(angle), math.cos(angle)
        depth = radius - ((fx - (x * c - y * s)) * s - (fy - (x * s + y * c)) * c) + sag
        if depth <= 0.0:
            return 0.0
        a, b, k, d = self.law
        return max(0.0, ((a * depth + b) * depth + k) * depth) * max(0.0, 1.0 + d * (sags - x * c * speed))


def bent_blow(action: model.Action, blow: tuple[np.ndarray, np.ndarray], elastic: float, stiffer: float) -> Solution:
    """The blow on an action whose key bends."""
    front, (times, force) = Front(action, elastic, stiffer), blow
    scene = model.build_scene(front.rest_of(action))
    run = Simulation(scene, State(float(times[0]), solve_rest(scene, front.weight), np.zeros(scene.size)), 1e-6)
    place, speed = front.straight(float(run.state.angle_rad[0]), 0.0)[0] + front.weight / front.k, 0.0
    push, one = np.zeros(1), np.zeros(1)
    rows: list[State] = []
    count = round((times[-1] - times[0]) / STEP_S)
    pressed = np.interp(times[0] + STEP_S * (np.arange(count) + 0.5), times, force)
    for k in range(count):
        if k % EVERY == 0:
            rows.append(run.state.copy())
        angle, turning = float(run.state.angle_rad[0]), float(run.state.speed_rad_per_s[0])
        z, w = front.straight(angle, turning)
        given = front.k * (place - z) + front.c * (speed - w)
        push[0] = given + 0.5 * STEP_S * front.k * (speed - w)  # in the middle of the block
        landed = front.felt(angle, turning, place - z, speed - w)
        speed += STEP_S * (pressed[k] + front.weight - given - landed) / front.mass
        place += STEP_S * speed
        run.advance(float(times[0]) + (k + 1) * STEP_S, one, push, held=True)
    angles, speeds = np.array([r.angle_rad for r in rows]), np.array([r.speed_rad_per_s for r in rows])
    at = np.array([r.time_s for r in rows])
    return Solution(
        scene.bodies, at, angles, speeds, scene.contacts, run.contact_forces(angles, speeds)[0], None, {}, 1e-6
    )


def compared(name: str, elastic: float, stiffer: float = 1.0) -> tuple[BlowMeasures, BlowMeasures]:
    """Measures of the blow with the key that bends, and with the model's."""
    action, (times, force) = model.load_action("hirschkorn2004-regulated"), model.force_table(name)
    bent = bent_blow(action, (times, force), elastic, stiffer)
    stiff = model.simulate(action, times, force, contact_forces=True, tolerance=1e-6, output_time_s=bent.time_s)
    there = np.interp(bent.time_s, times, force)
    return measure_blow(action, bent, there), measure_blow(action, stiff, there)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["piano", "forte", "fortissimo"])
def test_a_landed_key_that_bends_moves_the_check_by_millimetres(name: str) -> None:
    """The hammer's speed hardly; a key sixteen times as stiff is the model's."""
    for elastic in (0.7 * ELASTIC, ELASTIC, 1.4 * ELASTIC):
        bent, stiff = compared(name, elastic)
        assert bent.held and stiff.held
        assert abs(bent.strike_m_per_s / stiff.strike_m_per_s - 1.0) < 0.004
        assert 1e-3 < bent.hold_m - stiff.hold_m < 6e-3  # farther from the string
    bent, stiff = compared(name, ELASTIC, 16.0)
    assert abs(bent.strike_m_per_s / stiff.strike_m_per_s - 1.0) < 0.001
    assert abs(bent.hold_m - stiff.hold_m) < 2e-4
