"""The most probable values: Gauss–Newton in a box, everything linear taken out, sizes of noise learnt on the way.

Conventions: z in prior standard uncertainties, see `priors`. Each step minimises the linear model in the box; it is
damped (Marquardt) until it lowers the objective and the model can run there. Once values are near, each trial is
computed where its own laws and force most probably were (`runs.own`). `minima` fits from several starts.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.errors import ModelError
from validation.conventions import Array
from validation.errors import ValidationInputError
from validation.identification.blocks import bend
from validation.identification.noise import (
    FLOOR,
    LEAST_DAMPING,
    Marginal,
    Sizes,
    box_step,
    dampings,
    largest_step,
    learn,
    likeliest,
)
from validation.identification.problem import Columns, Problem, curves_at, linear_residuals, residuals_there
from validation.identification.runs.own import Own, nothing_own

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
SHARES = (1.0, 0.5, 0.25)  # of what trials have of their own, tried in turn
OWN_CLOSE = 0.1  # standard deviations, RMS: what trials have of their own is known where it is that well
ROUNDS, LAST_ROUNDS = 4, 30


@dataclass(frozen=True)
class Fitted:
    """Where a fit ended.

    Attributes
    ----------
    z : (p,) most probable values of all moved parameters
    curves : of each trial there, (m, 3), as if it had nothing of its own
    marginal : the linear model there, with its covariance
    linear : residuals at z = 0 of the linear model, of each trial
    objective : twice the negative log posterior, but for a constant of the sizes
    steps : how many were taken
    converged : whether the last was small
    own : what each trial has of its own where the linear model was made; None of a model as it is
    tight : whether it took the model to lack nothing until it had settled
    left : whether it was left near the minimum, for what the discrepancy explained there
    """

    z: Array
    curves: list[Array]
    marginal: Marginal
    linear: list[Array]
    objective: float
    steps: int
    converged: bool
    own: Sequence[Own] | None = None
    tight: bool = False
    left: bool = False

    def own_at(self, z: Array) -> list[Own] | None:
        """What each trial most probably has of its own at other values."""
        return None if self.own is None else self.marginal.own(self.linear, z)

    @property
    def badness(self) -> float:
        """Twice the negative log marginal likelihood, sizes included, so that fits of the same trials compare."""
        return -2.0 * self.marginal.log_evidence(self.linear)

    @property
    def settled(self) -> bool:
        """Whether it has converged where the model lacks next to nothing."""
        return self.converged and float(self.marginal.sizes.discrepancy.max()) <= SLIGHT

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
    problem : Problem
    start : (p,) z to start from; by default the action's own values
    say : callable, optional
        Called with a line after each step.
    columns : Columns, optional
        Derivatives found already.
    tight : bool
        Take the model to lack nothing until the values have settled; sizes are learnt only then.
    leave : bool
        End where the linear model is near enough and the discrepancy explains more than a slight part.

    Raises
    ------
    ValidationInputError
        The model cannot run at the start.
    """
    walk = _Walk(problem, start, columns, tight)
    while not (walk.ended() or (leave and walk.left())):
        walk.on(say)
    return walk.fitted()


class _Walk:
    """A fit on its way."""

    def __init__(self, problem: Problem, start: Array | None, columns: Columns | None, tight: bool) -> None:
        self.problem, self.tight, self.box = problem, tight, problem.box()
        self.z = np.clip(np.zeros(len(problem.unknowns.moved)) if start is None else start, *self.box)
        curves = curves_at(problem, self.z)
        if curves is None:
            raise ValidationInputError("identify: the model cannot run at the start; use other values with --set")
        self.curves: list[Array] = curves
        self.columns = Columns(problem) if columns is None else columns
        self.sizes = (Sizes.tight if tight else Sizes.start)(problem.families, problem.seen)
        self.floor, self.largest, self.most = (FLOOR, 0.0, MOST_TIGHT) if tight else (FIRST_FLOOR, np.inf, MOST_STEPS)
        self.own: list[Own] | None = None
        self.afresh = False
        self.steps, self.learnings, self.stalled = 0, 0, -1
        self.damping, self.converged, self.over = 0.0, False, False

    @property
    def near(self) -> bool:
        """Whether the linear model is good enough to be near the minimum."""
        return self.floor <= NEAR_FLOOR

    def ended(self) -> bool:
        """Look from where the walk stands: the linear model, sizes of noise, and whether this is the end."""
        try:
            blocks = self.columns.blocks(self.z, self.own, self.near and self.largest < NEAR)
        except ModelError as error:
            raise ValidationInputError(f"identify: {error}") from None
        self.linear = linear_residuals(self.problem, blocks, self.curves, self.z, self.own)
        self.here = residuals_there(self.problem, blocks, self.curves, self.own)
        # near the minimum sizes are kept until the values have settled, so that there is one function to minimise
        self.rounds = LAST_ROUNDS if self.near else ROUNDS
        kept = self.near and self.largest < NEAR or (self.tight and self.learnings == 0)
        if kept and not self.afresh:
            self.marginal = Marginal(blocks, self.sizes)
        else:
            self.marginal = learn(blocks, self.linear, self.sizes, self.rounds, self.floor)
        self.afresh, self.largest = False, self.wanted(self.problem.watched)
        if self.near and self.own is None and self.largest < NEAR:
            self.look_at_each()
            return self.ended()
        if self.near and self.largest < CLOSE and self.own_known():
            self.learn_again()
            self.largest = self.wanted(self.problem.watched)
            self.converged = self.largest < (CLOSE if self.learnings < MOST_LEARNINGS else STALLED)
        self.sizes = self.marginal.sizes
        return self.over or self.converged or self.hopeless() or self.steps == self.most or self.spent()

    def left(self) -> bool:
        """Whether the linear model is near enough and the discrepancy explains more than a slight part."""
        return self.near and float(self.marginal.sizes.discrepancy.max()) > SLIGHT

    def wanted(self, watched: NDArray[np.intp]) -> float:
        """Largest change of what is watched that the linear model still wants, in posterior standard uncertainties."""
        return largest_step(self.marginal, self.here, self.z, self.box, watched)

    def spent(self) -> bool:
        """Whether sizes were learnt as often as they may be."""
        return self.learnings >= MOST_LEARNINGS

    def hopeless(self) -> bool:
        """Whether a fit as if nothing were lacking is still far off."""
        if not (self.tight and self.steps == TIGHT_STEPS):
            return False
        return self.marginal.objective(self.here, self.z) > HOPELESS * sum(r.size for r in self.here)

    def own_known(self) -> bool:
        """Whether each trial is computed where what it has of its own most probably is."""
        if self.own is None:
            return True
        scatter = self.marginal.sizes.scatter
        most = self.marginal.own(self.linear, self.z)
        return max(a.apart(b, scatter) for a, b in zip(self.own, most, strict=True)) < OWN_CLOSE

    def learn_again(self) -> None:
        """Sizes of noise, where the values have settled."""
        blocks, sizes = self.marginal.blocks, self.marginal.sizes
        anew = self.learnings == 0 and not self.tight  # a tight fit begins with the sizes that would be tried anew
        self.marginal = likeliest(blocks, self.linear, sizes, self.rounds, anew)
        self.learnings += 1

    def look_at_each(self) -> None:
        """From here on compute each trial with what it has of its own; with less of it where it cannot run."""
        most = self.marginal.own(self.linear, self.z)
        nothing = nothing_own(self.marginal.blocks)
        for share in SHARES:
            own = [a.towards(b, share) for a, b in zip(nothing, most, strict=True)]
            curves = curves_at(self.problem, self.z, own)
            if curves is not None:
                self.own, self.curves, self.afresh = own, curves, True
                break

    def on(self, say: Callable[[str], None] | None) -> None:
        """A step."""
        self.steps += 1
        attempt = _attempt(self, self.damping)
        taken, self.damping, worth = attempt.curves is not None, attempt.damping, attempt.bent
        if say is not None:
            said = f"step {self.steps}: largest change {self.largest:.2g} u, damped by {self.damping:g}"
            said += f"; linear to {worth:.2g}"
            say(said if taken else f"step {self.steps}: no step from here lowers the objective")
        if self.near and self.largest < NEAR and attempt.gain < LEAST_GAIN and self.own_known():
            self.learn_again()
            self.converged = self.wanted(np.arange(len(self.problem.unknowns.asked))) < STALLED
            self.over = self.converged or self.stalled == self.steps - 1  # twice in turn: no way on
            self.sizes, self.stalled = self.marginal.sizes, self.steps
            return
        if attempt.curves is not None:
            self.z, self.own, self.curves = self.z + attempt.step, attempt.own, attempt.curves
        elif self.near and self.own is None:
            self.look_at_each()
        elif self.near:
            self.over = True
        self.floor = max(FLOOR, 0.5 * (worth if taken else min(worth, self.floor)))
        self.damping = self.damping / 10.0 if self.damping > LEAST_DAMPING and worth > FLOOR else 0.0

    def fitted(self) -> Fitted:
        """Where the walk ended."""
        plain = curves_at(self.problem, self.z) if self.own is not None else self.curves
        objective = self.marginal.objective(self.here, self.z)
        curves = self.curves if plain is None else plain
        return Fitted(
            z=self.z,
            curves=curves,
            marginal=self.marginal,
            linear=self.linear,
            objective=objective,
            steps=self.steps,
            converged=self.converged,
            own=self.own,
            tight=self.tight,
            left=not self.converged and self.left(),
        )


@dataclass(frozen=True)
class _Attempt:
    """A step, its curves (None: not taken), damping, how far from linear the longest tried was, and its gain."""

    step: Array
    own: list[Own] | None
    curves: list[Array] | None
    damping: float
    bent: float
    gain: float


def _attempt(walk: _Walk, damping: float) -> _Attempt:
    """The least damped step that lowers the objective."""
    problem, marginal, z = walk.problem, walk.marginal, walk.z
    before, bent = marginal.objective(walk.here, z), 0.0
    for more in dampings(damping):
        step = box_step(marginal, walk.here, z, walk.box, more)
        own = walk.own
        if own is not None:
            most = marginal.own(walk.linear, z + step)
            own = [a.towards(b, 1.0 / (1.0 + more)) for a, b in zip(own, most, strict=True)]
        moved = curves_at(problem, z + step, own)
        if moved is None:
            continue
        there = residuals_there(problem, marginal.blocks, moved, own)
        bent = max(bent, bend(marginal.blocks, walk.here, there, step))  # a short step looks linear anywhere
        after = marginal.objective(there, z + step)
        if after < before:
            return _Attempt(step, own, moved, more, bent, before - after)
    return _Attempt(np.zeros_like(z), walk.own, None, damping, bent if bent > 0.0 else np.inf, 0.0)
