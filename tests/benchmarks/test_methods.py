"""The comparison methods of the benchmarks: their coefficients, and their step loops on the model's equations."""

from __future__ import annotations

import numpy as np
import pytest

import model
from benchmarks.methods import COMPARISON
from model.integrators.methods import METHODS
from model.motion_driven.prescribed_key import run_prescribed
from tests.model.conftest import read_table
from tests.model.integrators.observed_order import PRESCRIBED_STEPS, STEPS, free_orders, free_scene, prescribed_order
from tests.model.key_blows import blow

NAMES = ("esdirk4", "radau5")


@pytest.fixture
def comparison(monkeypatch):
    """The comparison methods by name, known to `model.simulate` during a test."""
    for name, method in COMPARISON.items():
        monkeypatch.setitem(METHODS, name, method)
    return COMPARISON


def test_order_and_stability_of_the_diagonal_method(comparison) -> None:
    """Order conditions of both weights, row sums, stiff accuracy and L-stability of the full matrix."""
    tableau = comparison["esdirk4"]
    a = tableau.a + tableau.gamma * np.diag([0.0] + [1.0] * (tableau.stages - 1))
    one = np.ones(tableau.stages)
    np.testing.assert_allclose(a @ one, tableau.c, atol=1e-14)
    np.testing.assert_allclose(a[-1], tableau.b, atol=1e-15)
    for b, order in ((tableau.b, tableau.order), (tableau.b_embedded, tableau.embedded_order)):
        c = tableau.c
        conditions = [
            [(b @ one, 1.0)],
            [(b @ c, 1 / 2)],
            [(b @ c**2, 1 / 3), (b @ a @ c, 1 / 6)],
            [(b @ c**3, 1 / 4), (b @ (c * (a @ c)), 1 / 8), (b @ a @ c**2, 1 / 12), (b @ a @ a @ c, 1 / 24)],
        ]
        for number, rows in enumerate(conditions[:order], start=1):
            for found, wanted in rows:
                assert found == pytest.approx(wanted, abs=2e-14), number

    def amplification(z: complex) -> complex:
        return 1 + z * tableau.b @ np.linalg.solve(np.eye(tableau.stages) - z * a, one)

    assert abs(amplification(-1e9)) < 1e-6
    assert max(abs(amplification(1j * y)) for y in np.logspace(-3, 4, 400)) <= 1 + 1e-9


def test_order_and_stability_of_the_coupled_method(comparison) -> None:
    """Simplifying conditions B(5), C(3) and D(2) give order 5 (Butcher); L-stable; transformation and estimate."""
    tableau = comparison["radau5"]
    a, b, c = tableau.a, tableau.b, tableau.c
    for k in range(1, tableau.order + 1):
        assert b @ c ** (k - 1) == pytest.approx(1 / k, abs=1e-14)
    for k in range(1, 4):
        np.testing.assert_allclose(a @ c ** (k - 1), c**k / k, atol=1e-14)
    for k in range(1, 3):
        np.testing.assert_allclose((b * c ** (k - 1)) @ a, b * (1 - c**k) / k, atol=1e-14)

    def amplification(z: complex) -> complex:
        return 1 + z * b @ np.linalg.solve(np.eye(3) - z * a, np.ones(3))

    assert abs(amplification(-1e9)) < 1e-6
    assert max(abs(amplification(1j * y)) for y in np.logspace(-3, 4, 400)) <= 1 + 1e-9

    gamma, pair, t = tableau.transformation
    block = np.array([[gamma, 0, 0], [0, pair.real, -pair.imag], [0, pair.imag, pair.real]])
    np.testing.assert_allclose(a @ t @ block, t, atol=1e-13)
    assert gamma == pytest.approx(3 - 3 ** (1 / 3) + 3 ** (2 / 3), abs=1e-13)
    # F(y) + sum_i estimate_i Z_i / h vanishes for F of degree 2: what is left is of fourth order in h
    weights = a.T @ tableau.estimate
    for k in range(1, tableau.embedded_order + 1):
        assert weights @ c ** (k - 1) + (k == 1) == pytest.approx(0.0, abs=1e-13)


def test_polynomial_of_the_coupled_method_passes_through_the_stages(comparison) -> None:
    tableau = comparison["radau5"]
    stages = np.array([0.3, -1.1, 2.0])
    coefficients = tableau.dense[6:9] @ stages
    at = tableau.c[:, None] ** np.arange(1, 4)
    np.testing.assert_allclose(at @ coefficients, stages, atol=1e-12)


@pytest.mark.slow  # compiles the step loop
@pytest.mark.parametrize("name", NAMES)
def test_order_on_a_free_swing(comparison, name: str) -> None:
    # an iteration stops by the tolerance, so it must be tight enough for its rest not to show
    steps, tolerances = np.array(STEPS), np.full(4, 1e-5)
    if name == "radau5":
        # order 5 from an estimate of order 3: the iteration must leave less than the tolerance that the estimate needs,
        # so that falls with the step's fourth power; longer steps keep rounding out of sight
        steps, tolerances = 2.0 * steps, 3e-4 * (steps / steps[0]) ** 4
    end, inside = free_orders(free_scene(), name, steps, tolerances)
    assert comparison[name].order - 0.3 < end < comparison[name].order + 1.2
    assert inside > comparison[name].dense_order - 0.2


@pytest.mark.slow  # compiles the step loop
@pytest.mark.parametrize("name", NAMES)
def test_order_under_a_prescribed_motion(comparison, name: str) -> None:
    steps = np.array(PRESCRIBED_STEPS) * (2.0 if name == "radau5" else 1.0)  # at the smallest, the error of the truth
    order = prescribed_order(model.load_action(), name, steps)
    assert comparison[name].order - 0.4 < order < comparison[name].order + 1.2


@pytest.mark.slow  # compiles the step loop
@pytest.mark.parametrize("name", NAMES)
def test_a_blow_reaches_the_reference(comparison, name: str) -> None:
    action = model.load_action()
    for table in ("forte", "piano", "noisy"):
        force, rows = read_table(f"{table}_force.csv"), read_table(f"{table}_reference.csv")
        time, newton = force[:, 0], force[:, 1]
        solution = model.simulate(action, time, newton, output_time_s=rows[:, 0], tolerance=1e-9, method=name)
        assert np.abs(solution.angle_rad - rows[:, 1:6]).max() < 2e-8, table
        assert np.abs(solution.speed_rad_per_s - rows[:, 6:]).max() < 1e-4, table
        if table == "forte":
            usual = model.simulate(action, time, newton, output_time_s=rows[:, 0], method=name)
            assert np.abs(usual.angle_rad - rows[:, 1:6]).max() < 1e-5


@pytest.mark.slow  # compiles the step loop
@pytest.mark.parametrize("name", NAMES)
def test_the_force_under_a_prescribed_motion_is_that_of_the_default_method(comparison, name: str) -> None:
    action = model.load_action()
    time, _, forward = blow("forte")
    motion = model.simulate_motion(action, time[:700], forward.angle_rad[:700, 0], members=0).fit.motion()
    usual, other = run_prescribed(action, motion, time[:700]), run_prescribed(action, motion, time[:700], method=name)
    assert np.max(np.abs(other.force_n - usual.force_n)) < 0.05
    assert np.max(np.abs(other.angle_rad - usual.angle_rad)) < 1e-6
