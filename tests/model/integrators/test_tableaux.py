"""Coefficients satisfy the order conditions of Rosenbrock methods and are stiffly accurate."""

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
