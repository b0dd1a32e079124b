"""Residual and Jacobian for users' own optimisers."""

from __future__ import annotations

import numpy as np
from scipy.optimize import least_squares

from tests.validation.infer import toy
from validation.infer.residuals import ResidualProblem, problem_at_start

TRUTH = np.array([0.4, -0.3, 0.2])


def made() -> ResidualProblem:
    return problem_at_start(toy.problem(toy.made(TRUTH, 5, np.random.default_rng(8))))


def test_the_jacobian_is_the_derivative_of_the_residual() -> None:
    p = made()
    z = np.array([0.1, 0.2, -0.1])
    jacobian = p.jacobian(z)
    for j in range(3):
        step = 1e-5 * np.eye(3)[j]
        difference = (p.residual(z + step) - p.residual(z - step)) / 2e-5
        assert np.abs(difference - jacobian[:, j]).max() < 1e-5 * np.abs(jacobian[:, j]).max()


def test_an_optimiser_of_scipy_finds_the_truth_with_it() -> None:
    p = made()
    found = least_squares(p.residual, p.start, p.jacobian, bounds=p.bounds)
    width = np.sqrt(np.diag(np.linalg.inv(found.jac.T @ found.jac)))
    assert found.success and np.all(np.abs(found.x - TRUTH) < 4 * width + 0.02)
    assert set(p.values(found.x)) == set(p.names)
