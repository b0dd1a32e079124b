"""Air drag of the hammer, left out of the model, stays below the bounds of docs/explanation/effects.md."""

from __future__ import annotations

import math

import numpy as np
import pytest

import model

DENSITY = 1.2  # kg/m^3
DRAG_AREA = 6e-4  # m^2, drag coefficient times area: head 10 mm x 25 mm, shank 6 mm x 130 mm, all at the head's radius


@pytest.mark.parametrize(("name", "factor"), [("piano", 1.0), ("forte", 1.0), ("forte", 2.5)])
def test_drag_is_below_its_bounds(name: str, factor: float) -> None:
    action = model.load_action()
    time_s, force_n = model.force_table(name)
    blow = model.simulate(action, time_s, factor * force_n)
    speed = blow.speed_rad_per_s[:, model.BODIES.index("hammer")]
    top = int(np.argmax(speed))
    x, y = action["hammer.center_of_mass.x"], action["hammer.center_of_mass.y"]
    inertia = action["hammer.inertia"] + action["hammer.mass"] * (x * x + y * y)
    radius = math.hypot(action["contact12.first.x"], action["contact12.first.y"])
    power = 0.5 * DENSITY * DRAG_AREA * np.abs(radius * speed[: top + 1]) ** 3
    energy = float(np.sum(0.5 * (power[1:] + power[:-1]) * np.diff(blow.time_s[: top + 1])))
    of_swing = 0.5 * energy / (0.5 * inertia * speed[top] ** 2)
    of_flight = 0.5 * DENSITY * DRAG_AREA * radius**3 * 0.003 / radius / inertia  # 3 mm, the earliest let-off
    assert of_swing < 0.003
    assert of_flight < 2e-4
