"""Coefficients satisfy the order conditions of Rosenbrock methods and show their order on a known problem."""

from __future__ import annotations

import numpy as np
import pytest

from model.integrators.methods import METHODS, RosenbrockTableau

ROSENBROCK = list(METHODS.values())


def classical(tableau: RosenbrockTableau) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """alpha, gamma matrix and weights from the transformed form (Hairer and Wanner II, IV.7)."""
    s = tableau.stages
    gamma = np.linalg.inv(np.eye(s) / tableau.gamma - tableau.c_coupling)
    return tableau.a @ gamma, gamma, tableau.b @ gamma


@pytest.mark.parametrize("tableau", ROSENBROCK, ids=lambda m: m.name)
def test_order_conditions(tableau: RosenbrockTableau) -> None:
    alpha, gamma, b = classical(tableau)
    beta = alpha + gamma
    one = np.ones(tableau.stages)
    node = alpha @ one
    conditions = {
        1: [(b @ one, 1.0)],
        2: [(b @ beta @ one, 1 / 2)],
        3: [(b @ node**2, 1 / 3), (b @ beta @ beta @ one, 1 / 6)],
        4: [
            (b @ node**3, 1 / 4),
            (b @ (node * (alpha @ (beta @ one))), 1 / 8),
            (b @ beta @ node**2, 1 / 12),
            (b @ beta @ beta @ beta @ one, 1 / 24),
        ],
    }
    for order in range(1, min(tableau.order, 4) + 1):
        for found, wanted in conditions[order]:
            assert found == pytest.approx(wanted, abs=2e-13), order
    np.testing.assert_allclose(node, tableau.c, atol=1e-12)
    np.testing.assert_allclose(gamma @ one, tableau.d, atol=1e-11)


@pytest.mark.parametrize("tableau", ROSENBROCK, ids=lambda m: m.name)
def test_stiffly_accurate_and_l_stable(tableau: RosenbrockTableau) -> None:
    alpha, gamma, b = classical(tableau)
    beta = alpha + gamma

    def amplification(z: complex) -> complex:
        return 1 + z * b @ np.linalg.solve(np.eye(tableau.stages) - z * beta, np.ones(tableau.stages))

    assert abs(amplification(-1e12)) < 1e-6
    assert max(abs(amplification(1j * y)) for y in np.logspace(-3, 4, 400)) <= 1 + 1e-9


def step(
    tableau: RosenbrockTableau, y: np.ndarray, t: float, h: float, inside: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """One step on y0' = y1, y1' = -sin(y0) - y1/5 + cos(3 t), and its dense output at the fractions ``inside``."""

    def f(t: float, y: np.ndarray) -> np.ndarray:
        return np.array([y[1], -np.sin(y[0]) - y[1] / 5 + np.cos(3 * t)])

    j = np.array([[0, 1], [-np.cos(y[0]), -0.2]])
    f_t = np.array([0, -3 * np.sin(3 * t)])
    u: list[np.ndarray] = []
    for i in range(tableau.stages):
        argument = y + sum((tableau.a[i, k] * u[k] for k in range(i)), np.zeros(2))
        right = f(t + tableau.c[i] * h, argument) + h * tableau.d[i] * f_t
        right = right + sum((tableau.c_coupling[i, k] / h * u[k] for k in range(i)), np.zeros(2))
        u.append(np.linalg.solve(np.eye(2) / (h * tableau.gamma) - j, right))
    stages = np.array(u)
    y1 = y + tableau.b @ stages
    rows = []
    for x in inside:
        polynomial = np.zeros(2)
        for row in tableau.dense[::-1]:
            polynomial = row @ stages + x * polynomial
        rows.append((1 - x) * y + x * (y1 + (1 - x) * polynomial))
    return y1, np.array(rows)


@pytest.mark.parametrize("tableau", ROSENBROCK, ids=lambda m: m.name)
def test_observed_order_of_step_and_dense_output(tableau: RosenbrockTableau) -> None:
    from scipy.integrate import solve_ivp

    inside = np.array([0.2, 0.5, 0.8])
    counts = np.array([20, 40, 80])
    times = np.unique(np.concatenate([[2.0], *[(k + x) * 2 / n for n in counts for k in range(n) for x in [inside]]]))
    truth = solve_ivp(
        lambda t, y: [y[1], -np.sin(y[0]) - y[1] / 5 + np.cos(3 * t)],
        (0, 2), [0.5, 0.2], t_eval=times, method="DOP853", rtol=1e-13, atol=1e-14,
    ).y.T  # fmt: skip
    at = {round(t, 12): row for t, row in zip(times, truth, strict=True)}
    ends, insides = [], []
    for n in counts:
        y, h, worst = np.array([0.5, 0.2]), 2 / n, 0.0
        for k in range(n):
            y, rows = step(tableau, y, k * h, h, inside)
            worst = max(
                worst, *(np.abs(r - at[round((k + x) * h, 12)]).max() for x, r in zip(inside, rows, strict=True))
            )
        ends.append(np.abs(y - truth[-1]).max())
        insides.append(worst)
    order = np.polyfit(np.log(1 / counts), np.log(ends), 1)[0]
    dense = np.polyfit(np.log(1 / counts), np.log(insides), 1)[0]
    assert tableau.order - 0.35 < order < tableau.order + 1.0
    assert dense > tableau.dense_order - 0.1
