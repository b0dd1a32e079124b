"""The sets of changes that explain the trials: ranked by the linear model, followed by runs, weighed by evidence.

Sets of one, then two, then three changes. Of each size the best of the linear model, at the action's values and around
the best set found so far, are followed by runs of the model itself (Gauss–Newton) to where they are most probable, and
weighed there. The next size is looked at only where the linear model promises more than a factor of `ODDS` by it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations, islice

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve, cholesky, solve_triangular
from scipy.special import logsumexp

from validation.conventions import Array
from validation.identification.blocks import Block
from validation.identification.difference.responses import Point, Responses
from validation.identification.noise import smooth
from validation.identification.observations import ENCODERS

TIMES_S = (3e-3, 1e-2, 3e-2)
OWN = (3e-3, 1e-2, 3e-2, 1e-1)
"""Sizes of a trial's own wandering, of what all laws together could do."""
FLOOR, LACKS = 5e-3, (2e-2, 1e-1, 5e-1)
"""Sizes of what the model lacks, of the same: where nothing is lacking, and else."""
SCATTER = 0.07  # of a law from trial to trial, of its prior's standard uncertainty: 2 % of 30 %


@dataclass(frozen=True)
class _Theta:
    """One size of the noise: of the mean, for each size of what is lacking, root of the covariance, its inverse, and
    half the log of its determinant; log weight."""

    roots: tuple[Array, ...]
    inverses: tuple[Array, ...]
    half_logs: tuple[float, ...]
    log_weight: float


class Evidence:
    """Marginal likelihood of the mean difference.

    Conventions: all trials hold the same changes, so that their mean tells of them, and how the trials differ among
    themselves tells of the noise alone. Sizes of a trial's own wandering, its correlation time, and (for "the model
    lacks something") of a discrepancy are not chosen but averaged over a grid, each with the weight the trials give it.
    Laws scatter by 2 % from trial to trial. Parts of the noise: `validation.identification.noise`.

    Parameters
    ----------
    block : Block
        The linear model of the trial that stands for all.
    laws : (p,) bool, which of its columns are laws
    known : (p, k) root of the covariance of what is known of its columns' amounts
    apart : (trials - 1, 3 m) contrasts between the trials
    """

    def __init__(self, block: Block, laws: NDArray[np.bool_], known: Array, apart: Array) -> None:
        trials = len(apart) + 1
        scattered = block.moved[:, laws] * SCATTER
        known_columns = block.moved @ known
        shared = known_columns @ known_columns.T + block.instrument @ block.instrument.T
        alone = np.diag(block.white) + scattered @ scattered.T + block.own @ block.own.T
        self._thetas = []
        for time_s in TIMES_S:
            wander = _blockwise(block, time_s)
            for own in OWN:
                each = alone + own**2 * wander
                weight = _log_density(cholesky(each, lower=True), apart)
                means = [each / trials + shared + size**2 * wander for size in (FLOOR, *LACKS)]
                self._thetas.append(_theta(means, weight))
        total = logsumexp([theta.log_weight for theta in self._thetas])
        self._weights = np.array([theta.log_weight - total for theta in self._thetas])
        self._likeliest = int(np.argmax(self._weights))

    def log_evidence(self, linear: Array, columns: Array, lacking: bool = False) -> float:
        """Log marginal likelihood of a set.

        Parameters
        ----------
        linear : (3 m,) difference that the linear model at the set's values would have without the set
        columns : (3 m, k) of the set, there
        lacking : whether the model may lack something beside it
        """
        sizes = range(1, 1 + len(LACKS)) if lacking else (0,)
        both = np.column_stack([linear, columns])
        parts = [
            weight - np.log(len(sizes)) + _marginal(theta, k, both)
            for theta, weight in zip(self._thetas, self._weights, strict=True)
            for k in sizes
        ]
        return float(logsumexp(parts))

    def objective(self, difference: Array, z: Array) -> float:
        """Twice the negative log posterior of a set's amounts, at the likeliest size of the noise, but for a constant.

        ``difference`` (3 m,) is that at ``z`` (k,).
        """
        w = self.whiten(difference)
        return float(np.sum(w * w)) + float(z @ z)

    def whiten(self, columns: Array, lacking: int = 0) -> Array:
        """Columns in units of the noise, at its likeliest size."""
        root = self._thetas[self._likeliest].roots[lacking]
        return np.asarray(solve_triangular(root, columns, lower=True))

    def amounts(self, linear: Array, columns: Array) -> tuple[Array, Array]:
        """Most probable amounts (k,) of a set, and their covariance (k, k), every size of the noise weighed."""
        parts, means, spreads = [], [], []
        both = np.column_stack([linear, columns])
        for theta, weight in zip(self._thetas, self._weights, strict=True):
            gram = both.T @ theta.inverses[0] @ both
            spread = np.linalg.inv(np.eye(columns.shape[1]) + gram[1:, 1:])
            parts.append(weight + _marginal(theta, 0, both))
            means.append(spread @ gram[1:, 0])
            spreads.append(spread)
        share = np.exp(np.array(parts) - logsumexp(parts))
        mean = np.einsum("t,ti->i", share, np.array(means))
        off = np.array(means) - mean
        return mean, np.einsum("t,tij->ij", share, np.array(spreads)) + np.einsum("t,ti,tj->ij", share, off, off)


def _blockwise(block: Block, time_s: float) -> Array:
    """Covariance (3 m, 3 m) of a wandering as large as the response, channel by channel."""
    roots = [smooth(block, c, time_s) for c in ENCODERS]
    return np.asarray(sum(root @ root.T for root in roots))


def _log_density(root: Array, rows: Array) -> float:
    """Log density of rows, each normal with the covariance of a root, but for a constant."""
    if not len(rows):
        return 0.0
    w = solve_triangular(root, rows.T, lower=True)
    return float(-0.5 * np.sum(w * w) - len(rows) * np.log(np.diag(root)).sum())


def _theta(covariances: Sequence[Array], weight: float) -> _Theta:
    roots = tuple(cholesky(v, lower=True) for v in covariances)
    inverses = tuple(np.asarray(cho_solve((root, True), np.eye(len(root)))) for root in roots)
    return _Theta(roots, inverses, tuple(float(np.log(np.diag(root)).sum()) for root in roots), weight)


def _marginal(theta: _Theta, k: int, both: Array) -> float:
    """Log density of a difference, the first column, when the others have standard normal amounts, but for a constant.

    ``k`` is the size of what is lacking.
    """
    gram = both.T @ theta.inverses[k] @ both
    out = -0.5 * float(gram[0, 0]) - theta.half_logs[k]
    if len(gram) > 1:
        inner, b = np.eye(len(gram) - 1) + gram[1:, 1:], gram[1:, 0]
        out += 0.5 * float(b @ np.linalg.solve(inner, b)) - 0.5 * float(np.linalg.slogdet(inner)[1])
    return out


LEAST_SHOWN = 1.5  # standard uncertainties that a value wrong by `Candidate.wrong` makes: with less it gains no odds
LEAST_NOISE = 0.3  # of the same, that what is known of a value makes where its derivative is found again
FOLLOWED = 6  # sets from each ranking
BRANCHES = 12  # candidates that larger sets are made of
ROUNDS = 4
CLOSE = 0.1  # of a posterior u: a step below it is the last
TOO_MUCH = 4.0  # standard deviations of the sum of squares
FURTHEST = 3.0  # of how far off a value may be
SHORTER = 0.3  # of a step that did not lower the objective


@dataclass(frozen=True)
class Followed:
    """One set where it is most probable.

    Attributes
    ----------
    members : candidates, by index
    z : (k,) amounts
    difference : (3 m,) mean over the trials there
    each : (trials, 3 m) of every trial
    columns : (3 m, k) derivatives of the predicted curve there
    """

    members: tuple[int, ...]
    z: Array
    difference: Array
    each: Array
    columns: Array

    @property
    def linear(self) -> Array:
        """The difference that the linear model here has without the set."""
        return self.difference + self.columns @ self.z

    @property
    def point(self) -> Point:
        """Where the model is run."""
        return Point(tuple(sorted(zip(self.members, map(float, self.z), strict=True))))


class Search:
    """Followed sets of one session.

    Parameters
    ----------
    responses : Responses
    evidence : Evidence
    nothing : Followed
        The model as it is.
    derivatives : (3 m, p) of the predicted curve with respect to every candidate, and (m, 3, n) of the force's noise

    Attributes
    ----------
    noise : candidates that are not known well enough, or scatter too much, to be left out of the noise
    named : candidates that may be named, and would show
    """

    def __init__(
        self, responses: Responses, evidence: Evidence, nothing: Followed, derivatives: tuple[Array, Array]
    ) -> None:
        self.responses, self.evidence, self.nothing = responses, evidence, nothing
        self.columns, self.force = derivatives
        shows = np.sqrt((evidence.whiten(self.columns) ** 2).sum(axis=0))
        known = np.array([max(c.known, SCATTER) if c.law else c.known for c in responses.listed])
        self.noise = [int(j) for j in np.flatnonzero(shows * known > LEAST_NOISE)]
        self.named = [j for j, c in enumerate(responses.listed) if c.named and shows[j] > LEAST_SHOWN]

    def of_size(self, size: int, best: Followed) -> list[Followed]:
        """The likeliest sets of a size, followed; ``best`` is the best set found so far."""
        starts = [(self.nothing, k) for k in (0, 2, 3)] if size == 1 else [(self.nothing, 0), (best, 0)]
        wanted: dict[tuple[int, ...], Followed] = {}
        for start, lacking in starts:
            for members in self._ranked(size, start, lacking)[:FOLLOWED]:
                wanted.setdefault(members, self._started(members, start))
        return self._follow(list(wanted.values()))

    def subsets(self, best: Followed) -> list[Followed]:
        """The sets that a set leaves when one change is taken out, followed from where it is."""
        kept = [[i for i in range(len(best.members)) if i != out] for out in range(len(best.members))]
        parts = [replace(best, members=tuple(best.members[i] for i in k), z=best.z[k]) for k in kept]
        found = self.responses.differences([part.point for part in parts])
        started = [
            replace(part, each=each, difference=each.mean(axis=0), columns=best.columns[:, k])
            for part, k, each in zip(parts, kept, found, strict=True)
            if each is not None
        ]
        return self._follow(started)

    def fits(self, one: Followed) -> bool:
        """Whether what is left with a set is noise: its squares are no more than so much noise has."""
        n = one.difference.size
        return self.evidence.objective(one.difference, one.z) < n + TOO_MUCH * float(np.sqrt(2.0 * n))

    def without(self, size: int, named: Sequence[tuple[int, ...]]) -> list[Followed]:
        """The likeliest sets of a size that hold none of the sets named, followed."""
        wanted: dict[tuple[int, ...], Followed] = {}
        for lacking in (0, 2):
            free = (s for s in self._ranked(size, self.nothing, lacking) if not any(set(n) <= set(s) for n in named))
            for members in islice(free, FOLLOWED):
                wanted.setdefault(members, self._started(members, self.nothing))
        return self._follow(list(wanted.values()))

    def promised(self, best: Followed) -> float:
        """Log evidence that one or two changes more gain beside a set at most, by the linear model around it."""
        gram, b = self._around(best, 0)
        rest = [j for j in self.named if j not in best.members]
        ((_, here),) = self._scored(gram, b, [best.members])
        pairs = self._scored(gram, b, [(*best.members, *more) for more in combinations(rest, 2)])
        ones = self._scored(gram, b, [(*best.members, j) for j in rest])
        gains = [ones[0][1] - here - self.chosen(1)] if ones else []
        gains += [pairs[0][1] - here - self.chosen(2)] if pairs else []
        return max(gains, default=-np.inf)

    def chosen(self, size: int) -> float:
        """What a set of a size must gain for having been chosen among so many: log of the candidates, each time."""
        return size * float(np.log(max(len(self.named), 1)))

    def log_evidence(self, one: Followed, lacking: bool = False) -> float:
        """Log evidence of a set, chosen among so many; whether the model may lack something beside it."""
        return self.evidence.log_evidence(one.linear, one.columns, lacking) - self.chosen(len(one.members))

    def _around(self, start: Followed, lacking: int) -> tuple[Array, Array]:
        """Products (p, p) of all columns around a start, and with the difference (p,), in units of the noise."""
        columns = self.columns.copy()
        columns[:, list(start.members)] = start.columns
        x = self.evidence.whiten(columns, lacking)
        return x.T @ x, x.T @ self.evidence.whiten(start.linear, lacking)

    def _ranked(self, size: int, start: Followed, lacking: int) -> list[tuple[int, ...]]:
        """Sets of a size, the best of the linear model around a start first."""
        gram, b = self._around(start, lacking)
        pool = self.named
        if size > 1:
            pool = self._members(self._scored(gram, b, [(j,) for j in self.named]))
            pool = list(dict.fromkeys([*start.members, *pool]))
        if size == 2:  # both of a pair may matter only together
            every = self._scored(gram, b, list(combinations(self.named, 2)))
            return [members for members, _ in every]
        return [members for members, _ in self._scored(gram, b, list(combinations(sorted(pool), size)))]

    @staticmethod
    def _scored(gram: Array, b: Array, sets: Sequence[tuple[int, ...]]) -> list[tuple[tuple[int, ...], float]]:
        """Sets with their log evidence beside none, the best first."""
        if not sets:
            return []
        at = np.array(sets, dtype=int)
        inner = gram[at[:, :, None], at[:, None, :]] + np.eye(at.shape[1])
        right = b[at]
        gain = 0.5 * np.einsum("si,si->s", right, np.linalg.solve(inner, right[:, :, None])[:, :, 0])
        gain -= 0.5 * np.linalg.slogdet(inner)[1]
        return [(sets[i], float(gain[i])) for i in np.argsort(-gain, kind="stable")]

    @staticmethod
    def _members(scored: Sequence[tuple[tuple[int, ...], float] | tuple[int, ...]]) -> list[int]:
        """Candidates of the best sets, the best first, so many as larger sets are made of."""
        out: dict[int, None] = {}
        for one in scored:
            members = one[0] if isinstance(one[0], tuple) else one
            out |= dict.fromkeys(int(j) for j in members)  # type: ignore[arg-type]
            if len(out) >= BRANCHES:
                break
        return list(out)[:BRANCHES]

    def _started(self, members: tuple[int, ...], start: Followed) -> Followed:
        """A set before it is followed: at the amounts of a start that is part of it, else at none."""
        if not set(start.members) <= set(members):
            start = self.nothing
        z = np.array([start.z[start.members.index(j)] if j in start.members else 0.0 for j in members])
        columns = self.columns[:, list(members)].copy()
        for i, j in enumerate(members):
            if j in start.members:
                columns[:, i] = start.columns[:, start.members.index(j)]
        return Followed(members, z, start.difference, start.each, columns)

    def _follow(self, started: Sequence[Followed]) -> list[Followed]:
        """All sets, each where it is most probable; all go round together, so that their runs are done side by side."""
        at = list(started)
        going = {i: 1.0 for i in range(len(at))}
        for _ in range(ROUNDS):
            proposed: dict[int, Array] = {}
            for i, short in going.items():
                step = self._step(at[i])
                if step is not None:
                    proposed[i] = at[i].z + short * step
            points = [replace(at[i], z=z).point for i, z in proposed.items()]
            going, accepted = {}, []
            for (i, z), each in zip(proposed.items(), self.responses.differences(points), strict=True):
                here = self.evidence.objective(at[i].difference, at[i].z)
                if each is None or self.evidence.objective(each.mean(axis=0), z) >= here:
                    going[i] = SHORTER
                    continue
                at[i] = replace(at[i], z=z, each=each, difference=each.mean(axis=0))
                accepted.append(i)
            asked = [(at[i].point, j) for i in accepted for j in at[i].members]
            found = self.responses.columns(asked, [at[i].each for i in accepted for _ in at[i].members])
            for i in accepted:
                own = [found.pop(0) for _ in at[i].members]
                at[i] = replace(at[i], columns=np.column_stack(own))
                going[i] = 1.0
            if not going:
                break
        return at

    def _step(self, one: Followed) -> Array | None:
        """Gauss–Newton step of a set; None where it is small."""
        x, w = self.evidence.whiten(one.columns), self.evidence.whiten(one.linear)
        precision = np.eye(x.shape[1]) + x.T @ x
        z = np.clip(np.linalg.solve(precision, x.T @ w), -FURTHEST, FURTHEST)
        step = z - one.z
        width = np.sqrt(np.diag(np.linalg.inv(precision)))
        return None if np.all(np.abs(step) < CLOSE * width) else step
