"""Friction, rebound and pendulum against closed forms and direct integration."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from model import InputError, load_action
from model.calibration import damping_from_rebound, fit_friction, inertia_from_pendulum
from model.calibration.parts import peak_ratio
from model.null_model import restitution


@settings(deadline=None)
@given(st.floats(0.02, 2.0), st.floats(1.0, 3.0))
def test_peak_of_the_friction_curve_is_the_static_coefficient(mu_k: float, ratio: float) -> None:
    fit = fit_friction(mu_k * ratio, mu_k)
    s = np.geomspace(1e-2, 1e4, 40_000)
    curve = fit.a * (np.tanh(s) + fit.b1 * s / (1.0 + fit.b2 * s**4))
    assert curve.max() == pytest.approx(mu_k * ratio, rel=1e-6)
    assert curve[-1] == pytest.approx(mu_k, rel=1e-9)


def test_printed_knuckle_friction_is_found_again() -> None:
    action = load_action()
    a, b1 = action["contact10.friction.A"], action["contact10.friction.B1"]
    fit = fit_friction(a * peak_ratio(b1), a)
    assert (fit.a, fit.b1, fit.b2) == pytest.approx((0.332, 0.73, 1.0), rel=1e-6)


def test_friction_uncertainty_is_that_of_repeated_measurements() -> None:
    rng = np.random.default_rng(8)
    fit = fit_friction(0.45, 0.33, 0.008, 0.005)
    many = np.array([fit_friction(s, k).b1 for s, k in rng.normal([0.45, 0.33], [0.008, 0.005], (150, 2))])
    assert fit.u_a == 0.005
    assert np.std(many) == pytest.approx(fit.u_b1, rel=0.2)


@pytest.mark.parametrize(("mu_s", "mu_k"), [(0.2, 0.3), (0.3, 0.0), (-0.3, 0.1), (math.nan, 0.1), (40.0, 0.1)])
def test_impossible_friction(mu_s: float, mu_k: float) -> None:
    with pytest.raises(InputError, match="friction: "):
        fit_friction(mu_s, mu_k)


@pytest.mark.parametrize(("damping", "v_in", "mass"), [(0.175, 2.35, 0.0117), (2.9, 0.4, 0.05), (1e-5, 3.0, 0.01)])
def test_rebound_against_integration_of_the_contact(damping: float, v_in: float, mass: float) -> None:
    a, b, c = 1.81e10, 8.19e7, 1.16e4

    def motion(_: float, y: np.ndarray) -> list[float]:
        x, v = y
        return [v, -(a * x**3 + b * x**2 + c * x) * (1.0 + damping * v) / mass]

    def parted(t: float, y: np.ndarray) -> float:
        return float(y[0]) if t > 1e-5 else 1.0

    parted.terminal = True  # type: ignore[attr-defined]
    ran = solve_ivp(motion, (0.0, 0.05), [0.0, v_in], method="DOP853", rtol=1e-12, atol=1e-14, events=parted)
    v_out = -float(ran.y_events[0][0][1])
    assert v_in * restitution(v_in, damping) == pytest.approx(v_out, rel=1e-9)
    assert damping_from_rebound(v_in, v_out)[0] == pytest.approx(damping, rel=1e-5)


def test_rebound_uncertainty_is_that_of_repeated_measurements() -> None:
    rng = np.random.default_rng(4)
    d, u = damping_from_rebound(2.35, 1.85, 0.01, 0.02)
    many = [damping_from_rebound(*pair)[0] for pair in rng.normal([2.35, 1.85], [0.01, 0.02], (2000, 2))]
    assert np.std(many) == pytest.approx(u, rel=0.06)
    assert d == pytest.approx(0.175, rel=0.03)  # Table A.8, with the rebound of the reference forte


@pytest.mark.parametrize(("v_in", "v_out"), [(1.0, 1.0), (1.0, 1.2), (0.0, 0.0), (-1.0, 0.5), (1.0, math.nan)])
def test_impossible_rebound(v_in: float, v_out: float) -> None:
    with pytest.raises(InputError, match="rebound: "):
        damping_from_rebound(v_in, v_out)


def test_pendulum_of_a_uniform_rod() -> None:
    mass, length, g = 0.12, 0.3, 9.81
    period = 2.0 * math.pi * math.sqrt(2.0 * length / (3.0 * g))
    found = inertia_from_pendulum(mass, 0.5 * length, period, g=g)
    assert found.about_pivot == pytest.approx(mass * length**2 / 3.0, rel=1e-12)
    assert found.about_center == pytest.approx(mass * length**2 / 12.0, rel=1e-12)


def test_pendulum_uncertainty_is_that_of_repeated_measurements() -> None:
    rng = np.random.default_rng(6)
    mean, u = [0.12, 0.15, 0.9], [2e-4, 1e-3, 2e-3]
    found = inertia_from_pendulum(*mean, u_mass_kg=u[0], u_arm_m=u[1], u_period_s=u[2])
    many = [inertia_from_pendulum(*row) for row in rng.normal(mean, u, (4000, 3))]
    assert np.std([m.about_pivot for m in many]) == pytest.approx(found.u_about_pivot, rel=0.05)
    assert np.std([m.about_center for m in many]) == pytest.approx(found.u_about_center, rel=0.05)


@pytest.mark.parametrize(("mass", "arm", "period"), [(0.1, 0.2, 0.5), (0.0, 0.2, 1.0), (0.1, -0.2, 1.0)])
def test_impossible_pendulum(mass: float, arm: float, period: float) -> None:
    with pytest.raises(InputError, match="pendulum: "):
        inertia_from_pendulum(mass, arm, period)
