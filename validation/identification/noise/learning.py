"""How large the parts of a difference are: the largest marginal likelihood, by Fisher scoring in their logarithms.

The information is taken of each session's discrepancy and of each trial by itself; a step is taken only if the
likelihood, with what is believed beforehand, rises. Source: Searle, Casella and McCulloch (1992), Variance Components.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from validation.conventions import Array
from validation.identification.blocks import Block
from validation.identification.noise.held_out import GROWN, held_out_score
from validation.identification.noise.marginal import Marginal, parts_of, solved
from validation.identification.noise.parts import Columns, law_columns
from validation.identification.noise.sizes import FLOOR, NOT_SEEN, Sizes

LONGEST = 1.5  # step of a logarithm
RISEN = 0.1  # of the log likelihood: less ends the learning
DAMPINGS = (0.0, 0.1, 1.0, 10.0)
SMALLER = 3.0  # of the held-out log score: by so much a smaller discrepancy must predict better to be taken


@dataclass(frozen=True)
class Scores:
    """First and second derivatives of the negative log likelihood with respect to logarithms of sizes.

    Attributes
    ----------
    slope : (k,); 0 where no residuals were given
    information : (k, k) expected second derivatives
    shares : (p, k) share of each size in the variance of each z
    """

    slope: Array
    information: Array
    shares: Array


def scores(marginal: Marginal, residuals: Sequence[Array] | None = None) -> Scores:
    """Derivatives at the sizes of a model; residuals at z = 0 of the linear model."""
    log = marginal.sizes.log()
    variance, p = np.exp(2.0 * log), marginal.p
    slope, information, shares = np.zeros(log.size), np.zeros((log.size, log.size)), np.zeros((p, log.size))
    mean = None if residuals is None else marginal.mean(residuals)
    common, own = marginal.parts
    of_session = {s: _Sum(len(root), p) for s, root in marginal.roots.items()}
    towards = np.zeros((p, len(log)))  # of the laws' own scatter, summed over trials before it is squared
    for k, (b, (lower, x)) in enumerate(zip(marginal.blocks, marginal.white, strict=True)):
        mine = marginal.columns_of(b.session)
        root = solved(lower, np.eye(len(lower)))
        inverse, back = root.T @ root, root.T @ x
        total = of_session[b.session]
        weight = inverse - back @ marginal.covariance[np.ix_(mine, mine)] @ back.T
        pull = back @ marginal.covariance[mine, :p]
        left = np.zeros(len(lower))
        if residuals is not None and mean is not None:
            left = inverse @ residuals[k] - back @ mean[mine]
        _add(slope, information, variance, own[k], weight, left if residuals is not None else None)
        towards += _squares(own[k], pull, log.size)
        laws = law_columns(b, marginal.sizes)
        half = inverse @ laws
        both = np.block([[laws.T @ half, half.T], [half, inverse]])
        total.add(both, *(np.concatenate([laws.T @ v, v]) for v in (back, pull, left)))
    for s, total in of_session.items():
        mine = marginal.columns_of(s)
        weight = total.inverse - total.back @ marginal.covariance[np.ix_(mine, mine)] @ total.back.T
        _add(slope, information, variance, common[s], weight, total.left if residuals is not None else None)
        towards += _squares(common[s], total.pull, log.size)
    shares = variance * towards / np.diag(marginal.covariance)[:p, None]
    return Scores(slope, information, shares)


class _Sum:
    """Sums over the trials of one session."""

    def __init__(self, rows: int, p: int) -> None:
        self.inverse: Array = np.zeros((rows, rows))
        self.back: Array = np.zeros((rows, 0))
        self.pull, self.left = np.zeros((rows, p)), np.zeros(rows)

    def add(self, inverse: Array, back: Array, pull: Array, left: Array) -> None:
        """One more trial."""
        self.inverse = self.inverse + inverse
        self.back = back if self.back.size == 0 else self.back + back
        self.pull, self.left = self.pull + pull, self.left + left


def _squares(part: Columns, pull: Array, sizes: int) -> Array:
    """Sum of squares (p, k) of what each size's columns do to each z."""
    out = np.zeros((sizes, pull.shape[1]))
    np.add.at(out, part.place, (part.columns.T @ pull) ** 2)
    return out.T


def _add(slope: Array, information: Array, variance: Array, part: Columns, weight: Array, left: Array | None) -> None:
    """Add what one independent piece says of its sizes."""
    for k, (i, rows, columns) in enumerate(part.groups):
        for j, others, more in part.groups[: k + 1]:
            across = columns.T @ weight[rows, others] @ more
            found = 2.0 * variance[i] * variance[j] * float(np.vdot(across, across))
            information[i, j] += found
            information[j, i] += found * (i != j)
        if left is not None:  # the last across is of the part with itself
            slope[i] += variance[i] * float(np.trace(across) - np.sum((columns.T @ left[rows]) ** 2))


def learn(
    blocks: Sequence[Block], residuals: Sequence[Array], sizes: Sizes, rounds: int, floor: float = FLOOR
) -> Marginal:
    """The model with sizes learnt in so many rounds, fewer when they no longer change.

    Parameters
    ----------
    blocks : of all trials
    residuals : at z = 0 of the linear model
    sizes : to start from
    rounds : at most
    floor : smallest size of the discrepancy, of the response
    """
    parts = parts_of(blocks, sizes)
    marginal = Marginal(blocks, sizes.at_least(floor), parts)
    for _ in range(rounds):
        before = marginal.log_evidence(residuals)
        taken = _step(marginal, residuals, floor)
        if taken is None:
            break
        # what is believed of the part that is like laws has moved with the others: compare under what is believed now
        risen = taken.log_evidence(residuals) - before
        marginal = taken
        if abs(risen) < RISEN:
            break
    return marginal


def _step(marginal: Marginal, residuals: Sequence[Array], floor: float) -> Marginal | None:
    """The least damped step that raises the likelihood."""
    found, log = scores(marginal, residuals), marginal.sizes.log()
    middle, spread = marginal.sizes.belief()
    slope = found.slope + (log - middle) / spread**2
    curved = found.information + np.diag(1.0 / spread**2)
    before = marginal.log_likelihood(residuals) - 0.5 * float((((log - middle) / spread) ** 2).sum())
    for damping in DAMPINGS:
        step = -np.linalg.solve(curved + damping * np.diag(np.diag(curved)), slope)
        new = marginal.sizes.at(log + np.clip(step, -LONGEST, LONGEST)).at_least(floor)
        there = Marginal(marginal.blocks, new, marginal.parts)
        after = there.log_likelihood(residuals) - 0.5 * float((((new.log() - middle) / spread) ** 2).sum())
        if after > before:
            return there
    return None


def likeliest(
    blocks: Sequence[Block], residuals: Sequence[Array], sizes: Sizes, rounds: int, anew: bool = True
) -> Marginal:
    """The likelier model of two, learnt from these sizes and, ``anew``, from next to no discrepancy.

    Where there are several kinds of strokes, its discrepancy as a whole is then as large as predicts those of a kind
    that is kept aside best. With one kind that says nothing: the other trials tell the discrepancy, whatever its size.
    """
    seen = (sizes.own > NOT_SEEN).astype(float)
    starts = [sizes, *([Sizes.tight(sizes.families, seen)] if anew else [])]
    learnt = [learn(blocks, residuals, start, rounds) for start in starts]
    best = max(learnt, key=lambda m: m.log_evidence(residuals))
    if len(best.roots) == 1:
        return best
    score = held_out_score(best, residuals)
    for factor in GROWN:
        other = Marginal(blocks, best.sizes.grown(factor).at_least(FLOOR), best.parts)
        found = held_out_score(other, residuals)
        if found > score + (SMALLER if factor < 1.0 else 0.0):
            best, score = other, found
    return best
