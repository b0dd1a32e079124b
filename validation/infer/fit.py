"""The most probable values: Gauss–Newton in a box, everything linear taken out, sizes of noise learnt on the way.

Conventions: z in prior standard uncertainties, see `priors`. Each step minimises the linear model in the box; it is
damped (Marquardt) until it lowers the objective and the model can run there. `minima` fits from several starts;
`each_trial` goes on from the best, each trial where its own laws and force were.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from model.errors import ModelError
from validation.conventions import Array
from validation.errors import ValidationInputError
from validation.infer.blocks import bend, residuals
from validation.infer.force_runs import Own
from validation.infer.noise import (
    FLOOR,
    LEAST_DAMPING,
    Marginal,
    OwnModes,
    Sizes,
    box_step,
    dampings,
    largest_step,
    learn,
    likeliest,
)
from validation.infer.problem import Columns, Problem, curves_at, linear_residuals

MOST_STEPS = 30
MOST_TIGHT = 12
TIGHT_STEPS, HOPELESS = 3, 20.0  # a fit as if nothing were lacking ends where it is so far off, per datum, by then
FIRST_FLOOR = 0.1  # of the discrepancy in the first step; then what the last step showed the linear model to be worth
MOST_LEARNINGS = 6  # of the sizes, near the minimum
CLOSE = 0.1  # of a posterior standard uncertainty: a step below it is the last
STALLED = 0.5  # of a posterior standard uncertainty: how far the linear model may still want to go from a kink
LEAST_GAIN = 0.05  # of twice the log posterior: a step that gains less has come to a kink, or to the runs' error
NEAR = 2.0
SLIGHT = 0.05  # of the response: a discrepancy that is no reason to look for another minimum
NEAR_FLOOR = 0.01  # a linear model that is off by no more is near enough to the minimum
ROUNDS, LAST_ROUNDS = 4, 30


@dataclass(frozen=True)
class Fitted:
    """Where a fit ended."""

    z: Array  # (p,) most probable values of all moved parameters
    curves: list[Array]  # of each trial there, (m, 3), as if it had nothing of its own
    marginal: Marginal  # the linear model there, with its covariance
    linear: list[Array]  # residuals at z = 0 of the linear model, of each trial
    objective: float  # twice the negative log posterior, but for a constant of the sizes
    steps: int  # how many were taken
    converged: bool  # whether the last was small
    tight: bool = False  # whether it took the model to lack nothing until it had settled
    left: bool = False  # whether it was left near the minimum, to go on otherwise
    # what each trial has of its own where the linear model was made; None: made where all trials are alike
    own: Sequence[Own] | None = None
    before: float | None = None  # badness of the fit that this went on from, if it is the end of one
    # (p,) what a last step that gained nothing would still have changed z by; part of the uncertainty
    wanted: Array | None = None
    # trials at a fork of their motion, with the first phase that was left out
    forks: Mapping[int, int] = field(default_factory=dict)

    def own_at(self, z: Array) -> list[Own] | None:
        """What each trial most probably has of its own at other values."""
        return None if self.own is None else OwnModes(self.marginal, self.linear, z).most

    @property
    def badness(self) -> float:
        """Twice the negative log marginal likelihood, sizes included, so that fits of the same trials compare."""
        return -2.0 * self.marginal.log_evidence(self.linear)

    @property
    def alike(self) -> float:
        """Badness of the fit that this went on from, in which all trials were where all are; its own if it is that."""
        return self.badness if self.before is None else self.before

    @property
    def slight(self) -> bool:
        """Whether the model lacks next to nothing."""
        return float(self.marginal.sizes.discrepancy.max()) <= SLIGHT

    @property
    def settled(self) -> bool:
        """Whether it has converged where the model lacks next to nothing."""
        return self.converged and self.slight

    @property
    def covariance(self) -> Array:
        """Of z, (p, p)."""
        p = self.marginal.p
        return self.marginal.covariance[:p, :p]


def fit(
    problem: Problem,
    start: Array | None = None,
    say: Callable[[str], None] | None = None,
    columns: Columns | None = None,
    tight: bool = False,
    leave: bool = False,
) -> Fitted:
    """Fit from one start.

    Parameters
    ----------
    start : (p,) z to start from; by default the action's own values
    say : called with a line after each step
    columns : derivatives found already
    tight : take the model to lack nothing until the values have settled; sizes are learnt only then
    leave : end where the linear model is near enough, and either the values are, or the discrepancy explains more than
        a slight part

    Raises
    ------
    ValidationInputError
        The model cannot run at the start.
    """
    low, high = problem.box()
    z = np.clip(np.zeros(len(problem.unknowns.moved)) if start is None else start, low, high)
    curves = curves_at(problem, z)
    if curves is None:
        raise ValidationInputError("identify: the model cannot run at the start; use other values with --set")
    columns = Columns(problem) if columns is None else columns
    first = Sizes.tight if tight else Sizes.start
    sizes, steps, converged = first(problem.families, problem.seen), 0, False
    floor, largest, most = (FLOOR, 0.0, MOST_TIGHT) if tight else (FIRST_FLOOR, np.inf, MOST_STEPS)
    watched, damping, learnings, stalled = problem.watched, 0.0, 0, -1
    asked = np.arange(len(problem.unknowns.asked))
    while True:
        try:
            near = floor <= NEAR_FLOOR
            blocks = columns.blocks(z, near=near)
        except ModelError as error:
            raise ValidationInputError(f"identify: {error}") from None
        linear = linear_residuals(problem, blocks, curves, z)
        here = residuals(problem.trials, curves)
        # near the minimum sizes are kept until the values have settled, so that there is one function to minimise
        rounds = LAST_ROUNDS if near else ROUNDS
        kept = near and largest < NEAR or (tight and learnings == 0)
        marginal = Marginal(blocks, sizes) if kept else learn(blocks, linear, sizes, rounds, floor)
        largest = largest_step(marginal, here, z, (low, high), watched)
        lacks = not tight and float(marginal.sizes.discrepancy.max()) > SLIGHT
        left = leave and near and (largest < NEAR or lacks)
        if left:
            marginal = learn(blocks, linear, marginal.sizes, rounds) if tight else marginal
            break
        anew = learnings == 0 and not tight  # a tight fit begins with the sizes that would be tried anew
        if near and largest < CLOSE:
            marginal, learnings = likeliest(blocks, linear, marginal.sizes, rounds, anew), learnings + 1
            largest = largest_step(marginal, here, z, (low, high), watched)
            converged = largest < (CLOSE if learnings < MOST_LEARNINGS else STALLED)
        sizes = marginal.sizes
        hopeless = tight and steps == TIGHT_STEPS and marginal.objective(here, z) > HOPELESS * sum(r.size for r in here)
        if converged or hopeless or steps == most or learnings >= MOST_LEARNINGS:
            break
        steps += 1
        attempt = _attempt(problem, marginal, here, z, damping)
        taken, damping, worth = attempt.curves is not None, attempt.damping, attempt.bent
        if say is not None:
            said = f"step {steps}: largest change {largest:.2g} u, damped by {damping:g}; linear to {worth:.2g}"
            say(said if taken else f"step {steps}: no step from here lowers the objective")
        if near and largest < NEAR and attempt.gain < LEAST_GAIN:
            marginal, learnings = likeliest(blocks, linear, sizes, rounds, anew), learnings + 1
            converged = largest_step(marginal, here, z, (low, high), asked) < STALLED
            if converged or learnings >= MOST_LEARNINGS or stalled == steps - 1:  # twice in turn: no way on
                break
            sizes, stalled = marginal.sizes, steps
            continue
        if attempt.curves is not None:
            z, curves = z + attempt.step, attempt.curves
        elif near:
            break
        floor = max(FLOOR, 0.5 * (worth if taken else min(worth, floor)))
        damping = damping / 10.0 if damping > LEAST_DAMPING and worth > FLOOR else 0.0
    wanted = box_step(marginal, here, z, (low, high), 0.0) if converged and largest >= CLOSE else None
    objective = marginal.objective(here, z)
    return Fitted(z, curves, marginal, linear, objective, steps, converged, tight, left, wanted=wanted)


@dataclass(frozen=True)
class _Attempt:
    """A step, its curves (None: not taken), damping, how far from linear the longest tried was, and its gain."""

    step: Array
    curves: list[Array] | None
    damping: float
    bent: float
    gain: float


def _attempt(problem: Problem, marginal: Marginal, here: Sequence[Array], z: Array, damping: float) -> _Attempt:
    """The least damped step that lowers the objective."""
    before, bent = marginal.objective(here, z), 0.0
    for more in dampings(damping):
        step = box_step(marginal, here, z, problem.box(), more)
        moved = curves_at(problem, z + step)
        if moved is None:
            continue
        there = residuals(problem.trials, moved)
        bent = max(bent, bend(marginal.blocks, here, there, step))  # a short step looks linear anywhere
        after = marginal.objective(there, z + step)
        if after < before:
            return _Attempt(step, moved, more, bent, before - after)
    return _Attempt(np.zeros_like(z), None, damping, bent if bent > 0.0 else np.inf, 0.0)
