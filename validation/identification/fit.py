"""The most probable values: Gauss–Newton in a box, everything linear taken out, sizes of noise learnt on the way.

Conventions: z in prior standard uncertainties, see `priors`. Each step is taken whole, halved or quartered, whichever
first lowers the objective; where the model cannot run the step is shortened likewise. Several starts, drawn by a Latin
hypercube within one prior standard uncertainty, show whether there is one minimum.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import norm, qmc

import model
from model.errors import ModelError
from validation.conventions import Array
from validation.errors import ValidationInputError
from validation.identification.blocks import Block, make_blocks, residuals
from validation.identification.model_runs import Response
from validation.identification.noise import FLOOR, Marginal, Sizes, likeliest
from validation.identification.observations import ObservedTrial
from validation.identification.unknowns.priors import Unknowns

MOST_STEPS = 30
FIRST_FLOOR = 0.1  # of the discrepancy in the first step; then what the last step showed the linear model to be worth
SHARES = (1.0, 0.5, 0.25, 0.1)
CLOSE = 0.2  # of a posterior standard uncertainty: a step below it is the last
NEAR = 2.0
AFAR = 0.2  # how far z may move before columns of small parameters are found again
ROUNDS, LAST_ROUNDS = 6, 40
START_SEED = 125


@dataclass(frozen=True)
class Problem:
    """What is fitted to what.

    Attributes
    ----------
    action : model.Action
    unknowns : Unknowns
    trials : tuple of ObservedTrial
    response : Response
    held : columns (m, 3, h) of each trial, of laws that are fixed
    """

    action: model.Action
    unknowns: Unknowns
    trials: tuple[ObservedTrial, ...]
    response: Response
    held: tuple[Array, ...] = ()

    @property
    def laws(self) -> Array:
        """Which of the moved parameters are laws, (p,) bool."""
        return np.array([p.factor for p in self.unknowns.moved])

    @property
    def sessions(self) -> int:
        """Number of sessions."""
        return 1 + max(t.session for t in self.trials)

    def box(self) -> tuple[Array, Array]:
        """Smallest and largest z, (p,) each."""
        pairs = [p.box(self.action) for p in self.unknowns.moved]
        return np.array([a for a, _ in pairs]), np.array([b for _, b in pairs])


@dataclass(frozen=True)
class Fitted:
    """Where a fit ended.

    Attributes
    ----------
    z : (p,) most probable values of all moved parameters
    curves : of each trial there, (m, 3)
    marginal : the linear model there, with its covariance
    linear : residuals at z = 0 of the linear model, of each trial
    objective : twice the negative log posterior, but for a constant of the sizes
    steps : how many were taken
    converged : whether the last was small
    """

    z: Array
    curves: list[Array]
    marginal: Marginal
    linear: list[Array]
    objective: float
    steps: int
    converged: bool

    @property
    def badness(self) -> float:
        """Twice the negative log marginal likelihood, sizes included, so that fits of the same trials compare."""
        return -2.0 * self.marginal.log_likelihood(self.linear)

    @property
    def covariance(self) -> Array:
        """Of z, (p, p)."""
        p = self.marginal.p
        return self.marginal.covariance[:p, :p]


class Columns:
    """Derivatives where the fit stands; of what is known well and of the force kept while z moves little."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.often = [j for j, law in enumerate(problem.laws) if law]
        self.seldom = [j for j, law in enumerate(problem.laws) if not law]
        self._at: Array | None = None
        self._seldom: list[Array] = []
        self._force: list[Array] = []
        self._last: tuple[Array, list[Block]] | None = None

    def blocks(self, z: Array) -> list[Block]:
        """The linear model at z."""
        if self._last is not None and np.array_equal(self._last[0], z):
            return self._last[1]
        response = self.problem.response
        if self._at is None or np.max(np.abs(z - self._at)[self.often], initial=0.0) > AFAR:
            self._at, self._force = z, response.force_columns(z)
            self._seldom = response.jacobian(z, self.seldom) if self.seldom else []
        found = response.jacobian(z, self.often)
        jacobian = []
        for k, often in enumerate(found):
            whole = np.zeros((*often.shape[:2], z.size))
            whole[:, :, self.often] = often
            if self._seldom:
                whole[:, :, self.seldom] = self._seldom[k]
            jacobian.append(whole)
        blocks = make_blocks(self.problem.trials, jacobian, self._force, self.problem.laws, self.problem.held)
        self._last = z.copy(), blocks
        return blocks


def linear_residuals(problem: Problem, blocks: Sequence[Block], curves: Sequence[Array], z: Array) -> list[Array]:
    """Residuals that the linear model would have at z = 0."""
    return [r + b.moved @ z for r, b in zip(residuals(problem.trials, curves), blocks, strict=True)]


def fit(
    problem: Problem,
    start: Array | None = None,
    say: Callable[[str], None] | None = None,
    columns: Columns | None = None,
) -> Fitted:
    """Fit from one start.

    Parameters
    ----------
    problem : Problem
    start : (p,) z to start from; by default the action's own values
    say : callable, optional
        Called with a line after each step.
    columns : Columns, optional
        Derivatives found already.

    Raises
    ------
    ValidationInputError
        The model cannot run at the start.
    """
    low, high = problem.box()
    z = np.clip(np.zeros(len(problem.unknowns.moved)) if start is None else start, low, high)
    curves = _one(problem, z)
    if curves is None:
        raise ValidationInputError("identify: the model cannot run at the start; use other values with --set")
    columns = Columns(problem) if columns is None else columns
    sizes, steps, converged, floor = Sizes.start(problem.laws, problem.sessions), 0, False, FIRST_FLOOR
    asked, largest = len(problem.unknowns.asked), np.inf
    while steps < MOST_STEPS and not converged:
        blocks = columns.blocks(z)
        linear = linear_residuals(problem, blocks, curves, z)
        # near the minimum sizes are kept, so that there is one function to minimise
        near = floor <= NEAR * FLOOR and largest < NEAR
        marginal = Marginal(blocks, sizes) if near else likeliest(blocks, linear, sizes, ROUNDS, floor)
        sizes = marginal.sizes
        step = np.clip(marginal.mean(linear)[: marginal.p], low, high) - z
        here = residuals(problem.trials, curves)
        steps += 1
        share, bent = 0.0, floor
        for share in SHARES:
            moved = _one(problem, z + share * step)
            if moved is None:
                continue
            there = residuals(problem.trials, moved)
            bent = _bend(blocks, here, there, share * step)
            if marginal.objective(there, z + share * step) < marginal.objective(here, z):
                z, curves = z + share * step, moved
                break
        else:
            share = 0.0
        width = np.sqrt(np.diag(marginal.covariance)[: marginal.p])
        largest = float(np.max((np.abs(step) / width)[:asked]))
        converged = largest < CLOSE and floor <= NEAR * FLOOR
        if say is not None:
            say(f"step {steps}: largest change {largest:.2g} u, taken {share:g} of it; linear to {bent:.2g}")
        if share == 0.0 and floor <= FLOOR and bent <= FLOOR:
            break
        worth = min(bent, floor) if share == 0.0 else bent  # a step that was not taken says nothing against the floor
        floor = max(FLOOR, worth if 0.0 < share < 1.0 else 0.5 * worth)
    try:
        blocks = Columns(problem).blocks(z)
    except ModelError as error:
        raise ValidationInputError(f"identify: {error}") from None
    linear = linear_residuals(problem, blocks, curves, z)
    marginal = likeliest(blocks, linear, sizes, LAST_ROUNDS)
    objective = marginal.objective(residuals(problem.trials, curves), z)
    return Fitted(z, curves, marginal, linear, objective, steps, converged)


def _one(problem: Problem, z: Array) -> list[Array] | None:
    """Curves at one point."""
    return problem.response.curves([z])[0]


def _bend(blocks: Sequence[Block], here: Sequence[Array], there: Sequence[Array], step: Array) -> float:
    """How far the model is from its linear model after a step: root mean square, of the size of the response."""
    parts = [(t - (h - b.moved @ step)) / b.size.ravel() for b, h, t in zip(blocks, here, there, strict=True)]
    return float(np.sqrt(np.mean(np.concatenate(parts) ** 2)))


def starts(problem: Problem, n: int) -> list[Array]:
    """Points to start from: the action's own values, then a Latin hypercube of the asked ones within the prior."""
    p, asked = len(problem.unknowns.moved), len(problem.unknowns.asked)
    out = [np.zeros(p)]
    if n > 1:
        drawn = qmc.LatinHypercube(asked, seed=START_SEED).random(n - 1)
        for row in drawn:
            z = np.zeros(p)
            z[:asked] = norm.ppf(0.16 + 0.68 * row)
            out.append(z)
    return out
