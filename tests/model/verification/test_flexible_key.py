"""A key and a whippen that bend, left out of the model, stay below the bounds of docs/explanation/effects.md.

A key that bends hands the force on through its own bending: a spring and the mass that swings on it, between the front
and the rest of the action. The blow is simulated with the force as that filter passes it on.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

import model
from model.study import measure_blow

ELASTIC = 1.0e10  # Pa, spruce along the grain; 0.7e10 to 1.4e10
KEY_SECTION = 0.022, 0.025  # m, width and height over the balance rail
KEY_LENGTH = 0.42  # m
WHIPPEN_SECTION, WHIPPEN_OVERHANG, WHIPPEN_SWINGING = (0.010, 0.010), 0.03, 5e-3  # m, m, kg: from heel to jack


def key_bending(action: model.Action, elastic: float) -> tuple[float, float]:
    """Frequency (Hz) of the front's bending and how far the front sinks by it, m/N."""
    width, height = KEY_SECTION
    beam = elastic * width * height**3 / 12.0
    front, rear = action["drive.point.x"], abs(action["contact01.first.x"])
    give = (front**3 + rear**3 * (front / rear) ** 2) / (3.0 * beam)
    swinging = 0.25 * action["key.mass"] * front / KEY_LENGTH  # of a cantilever, at its end
    return math.sqrt(1.0 / (give * swinging)) / (2.0 * math.pi), give


def passed_on(time_s: np.ndarray, force_n: np.ndarray, frequency_hz: float, damping: float = 0.02) -> np.ndarray:
    """The force behind a spring with a mass before it, exact for a force that runs straight between samples."""
    from scipy.linalg import expm

    turn, h = 2.0 * math.pi * frequency_hz, float(time_s[1] - time_s[0])
    a = np.zeros((4, 4))  # deflection in N, its rate, force, its slope
    a[0, 1] = a[2, 3] = 1.0
    a[1, :3] = -(turn**2), -2.0 * damping * turn, turn**2
    step = expm(a * h)
    out = np.empty_like(force_n)
    x, v = float(force_n[0]), 0.0
    for k, f in enumerate(force_n):
        out[k] = x
        slope = (force_n[k + 1] - f) / h if k + 1 < len(force_n) else 0.0
        x, v = (step @ np.array([x, v, f, slope]))[:2]
    return out


@pytest.mark.parametrize("name", ["piano", "forte", "fortissimo"])
def test_a_key_that_bends_changes_the_hammer_by_less_than_its_bound(name: str) -> None:
    """Until the key lands: from then on the front's felt takes the force, and the check is not bounded by this."""
    action = model.load_action("hirschkorn2004-regulated")
    time_s, force_n = model.force_table(name)
    blow = model.simulate(action, time_s, force_n, contact_forces=True)
    stiff = measure_blow(action, blow, force_n)
    assert blow.contact_normal_n is not None
    landed = int(np.argmax(blow.contact_normal_n[:, blow.contacts.index("contact02")] > 0.0))
    for elastic in (0.7 * ELASTIC, ELASTIC):
        frequency, give = key_bending(action, elastic)
        assert 200.0 < frequency < 300.0 and 1.5e-5 < give < 4e-5
        bent = passed_on(time_s, force_n, frequency)
        bent[landed:] = force_n[landed:]
        found = measure_blow(action, model.simulate(action, time_s, bent, contact_forces=True), bent)
        assert abs(found.strike_m_per_s / stiff.strike_m_per_s - 1.0) < 0.005
        assert abs(found.hold_m - stiff.hold_m) < 2e-4


def test_a_whippen_that_bends_matters_less_than_a_fiftieth_of_that() -> None:
    """What a filter does to a slow force falls with the square of its frequency."""
    width, height = WHIPPEN_SECTION
    stiffness = 3.0 * ELASTIC * width * height**3 / 12.0 / WHIPPEN_OVERHANG**3
    frequency = math.sqrt(stiffness / WHIPPEN_SWINGING) / (2.0 * math.pi)
    assert (key_bending(model.load_action(), ELASTIC)[0] / frequency) ** 2 < 0.02
