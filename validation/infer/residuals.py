"""Residual and Jacobian for users' own optimisers: whitened, with the prior as rows and everything linear taken out.

The sum of squares is twice the negative log posterior of `fit`, with sizes of noise as learnt at one point and columns
of force and encoders as they are there.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Unpack

import numpy as np
from scipy.linalg import cholesky, solve_triangular

import model
from model.keywords import make_options
from rig.session import Session
from validation.conventions import Array
from validation.errors import ValidationInputError
from validation.infer.blocks import residuals, rows
from validation.infer.noise import Marginal, Sizes, learn
from validation.infer.observations import add_drive_errors
from validation.infer.problem import Columns, Problem, linear_residuals
from validation.infer.response import ModelResponse
from validation.infer.sources import IdentifyKeywords, IdentifyOptions, collect
from validation.infer.unknowns import unknowns

ROUNDS = 20  # of learning the sizes at most


class ResidualProblem:
    """A least-squares problem in z, prior standard uncertainties from the action's values.

    Attributes
    ----------
    names : (p,) of all that moves: what was asked for first, then what is uncertain beside it
    start : (p,) zeros
    bounds : lowest and highest z, (p,) each, as `scipy.optimize.least_squares` takes them
    """

    def __init__(self, problem: Problem, marginal: Marginal) -> None:
        self._problem, self._marginal = problem, marginal
        self.names = tuple(p.name for p in problem.unknowns.moved)
        self.start = np.zeros(len(self.names))
        self.bounds = problem.box()
        white = [x[:, marginal.p :] for _, x in marginal.white]
        rest = np.zeros((sum(len(x) for x in white), marginal.q - marginal.p))
        at = 0
        for x, block in zip(white, marginal.blocks, strict=True):
            mine = marginal.columns_of(block.session)[marginal.p :] - marginal.p
            rest[at : at + len(x), mine] = x
            at += len(x)
        inner = np.eye(rest.shape[1]) + rest.T @ rest
        left = np.eye(len(rest)) - rest @ np.linalg.solve(inner, rest.T)
        self._root = cholesky(0.5 * (left + left.T), lower=False)

    def residual(self, z: Array) -> Array:
        """Whitened residuals (n,) of all trials, measured less predicted, then z itself (the prior), (n + p,): their
        sum of squares is twice the negative log posterior, but for a constant. Input error where the model cannot run
        at z (p,).

        Raises
        ------
        ValidationInputError
            The model cannot run at z.
        """
        curves = self._problem.response.curves([z])[0]
        if curves is None:
            raise ValidationInputError("residual: the model cannot run at this point; use narrower bounds")
        parts = [
            solve_triangular(lower, r, lower=True)
            for (lower, _), r in zip(self._marginal.white, residuals(self._problem.trials, curves), strict=True)
        ]
        return np.concatenate([self._root @ np.concatenate(parts), z])

    def jacobian(self, z: Array) -> Array:
        """Derivatives (n + p, p) of `residual` by z at z (p,), in prior standard uncertainties."""
        found = self._problem.response.jacobian(z, range(z.size))
        parts = [
            -solve_triangular(lower, rows(columns), lower=True)
            for (lower, _), columns in zip(self._marginal.white, found, strict=True)
        ]
        return np.vstack([self._root @ np.vstack(parts), np.eye(z.size)])

    def values(self, z: Array) -> dict[str, float]:
        """Values of the action at z, path -> SI."""
        out: dict[str, float] = {}
        for parameter, at in zip(self._problem.unknowns.moved, z, strict=True):
            out |= parameter.values(self._problem.action, float(at))
        return out


def residual_problem(
    sessions: Sequence[Session | str | Path],
    parameters: Sequence[str],
    action: model.Action | str | Path = "hirschkorn2004",
    **keywords: Unpack[IdentifyKeywords],
) -> ResidualProblem:
    """Least-squares problem of an identification for an optimiser of one's own: residual, Jacobian, start and bounds of
    z, in prior standard uncertainties; arguments as of `validation.identify`, sizes of noise learnt once, at the
    action's values.

    Parameters
    ----------
    sessions, parameters, action
        As for `validation.identify`.
    **keywords
        ``fixed``, ``priors``, ``hold_out_trials``, ``phases``, ``tolerance``, ``condition``,
        ``motion_driven``, ``film`` of `validation.identify`.

    Returns
    -------
    ResidualProblem

    Raises
    ------
    ValidationInputError
        As `validation.identify`.

    Notes
    -----
    Sizes of noise are learnt at the action's values. Far from the minimum they are too large: make the problem again
    at the values found, as `validation.identify` does at every step.

    Examples
    --------
    >>> import validation
    >>> from scipy.optimize import least_squares
    >>> problem = validation.residual_problem(["sessions/example_forte"], ["hammer.joint_friction"], fixed=("*",))
    >>> found = least_squares(problem.residual, problem.start, problem.jacobian, bounds=problem.bounds)
    >>> sorted(problem.values(found.x))
    ['hammer.joint_friction.A']
    """
    options = make_options(IdentifyOptions, "validation.residual_problem", keywords)
    start = model.load_action(action) if isinstance(action, str | Path) else action
    asked = unknowns(start, parameters, options.fixed, options.priors)
    trials = collect(sessions, start, options).fitted
    asked = add_drive_errors(asked, trials)
    response = ModelResponse(start, asked.moved, trials, options.tolerance)
    return problem_at_start(Problem(start, asked, trials, response))


def problem_at_start(problem: Problem) -> ResidualProblem:
    """Least-squares problem of a fit, with sizes of noise learnt once, at z = 0; input error where the model cannot run
    there."""
    zero = np.zeros(len(problem.unknowns.moved))
    curves = problem.response.curves([zero])[0]
    if curves is None:
        raise ValidationInputError("residual: the model cannot run at the action's values; use others")
    blocks = Columns(problem).blocks(zero)
    linear = linear_residuals(problem, blocks, curves, zero)
    sizes = Sizes.start(problem.families, problem.seen)
    return ResidualProblem(problem, learn(blocks, linear, sizes, ROUNDS))
