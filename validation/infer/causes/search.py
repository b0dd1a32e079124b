"""The sets of changes that explain the trials: ranked by the linear model, followed by runs, weighed by evidence.

Sets of one, then two, then three changes. Of each size the best of the linear model, at the action's values and around
the best set found so far, are followed by runs of the model itself (Gauss–Newton) to where they are most probable, and
weighed there. The next size is looked at only where the linear model promises more than a factor of `ODDS` by it.
Where the best set is another one, noise and derivatives are found anew around it, and the sets near it run anew.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve, cholesky, solve_triangular
from scipy.special import logsumexp

from validation.conventions import Array
from validation.infer.blocks import Block
from validation.infer.causes.responses import ALL, LEAST_ADDED, Point, Responses, Source
from validation.infer.noise import smooth
from validation.infer.observations import ENCODERS

TIMES_S = (3e-3, 1e-2, 3e-2)
OWN = (3e-3, 1e-2, 3e-2, 1e-1)
"""Sizes of a trial's own wandering, of what all laws together could do."""
FLOOR, LACKS = 5e-3, (2e-2, 1e-1, 5e-1)
"""Sizes of what the model lacks, of the same: where nothing is lacking, and else."""


class _Theta:
    """One size of the noise: covariances of a contrast between trials, and of their mean for each size of what lacks.

    ``part`` is `BETWEEN` for the first, 0 where nothing lacks but ``floor``, 1 … for each size of it. What is not asked
    for is not computed.
    """

    def __init__(
        self, alone: Array, shared: Array, wander: Array, own: float, trials: int, floor: float = FLOOR
    ) -> None:
        self._one, self._shared, self._wander, self._trials = alone + own**2 * wander, shared, wander, trials
        self._floor = floor
        self._roots: dict[int, Array] = {}

    def root(self, part: int) -> Array:
        """Lower triangular root of a covariance."""
        if part not in self._roots:
            covariance = self._one
            if part != BETWEEN:
                lacks = (self._floor, *LACKS)[part] ** 2 * self._wander
                covariance = self._one / self._trials + self._shared + lacks
            self._roots[part] = cholesky(covariance, lower=True)
        return self._roots[part]

    def inverse(self, part: int) -> Array:
        """Inverse of a covariance."""
        return np.asarray(cho_solve((self.root(part), True), np.eye(len(self._one))))

    def half_log(self, part: int) -> float:
        """Half the logarithm of a determinant."""
        return float(np.log(np.diag(self.root(part))).sum())


MEAN, BETWEEN = 0, -1
"""What is asked: what all trials share, beside what they differ by; or the latter alone."""


class Evidence:
    """Marginal likelihood of the differences of all trials.

    Conventions: differences of n trials are turned into their mean and n - 1 orthonormal contrasts, which are
    independent. What the model lacks, and what is not known of its values, is common to all trials, and so in the mean
    alone: the contrasts hold each trial's own noise, and what happened to some of the trials. Sizes of a trial's own
    wandering, its correlation time, and (for "the model lacks something") of a discrepancy are not chosen but averaged
    over a grid, each with the weight that the differences give it. Laws and channels scatter from trial to trial
    (`Source.scatter`). Parts of the noise: `validation.infer.noise`.

    Parameters
    ----------
    block : Block
        The linear model of the trial that stands for all.
    scatter : (p,) of its columns' amounts from trial to trial
    known : (p, k) root of the covariance of what is known of its columns' amounts
    each : (trials, 3 m) differences, which tell the likeliest size of the noise
    """

    def __init__(self, block: Block, scatter: Array, known: Array, each: Array) -> None:
        apart = contrasts(each)
        scattered = block.moved * scatter
        known_columns = block.moved @ known
        shared = known_columns @ known_columns.T + block.instrument @ block.instrument.T
        alone = np.diag(block.white) + scattered @ scattered.T + block.own @ block.own.T
        wanders = [_blockwise(block, time_s) for time_s in TIMES_S]
        self._thetas = [_Theta(alone, shared, wander, own, len(each)) for wander in wanders for own in OWN]
        self.contrasts, self._weights = len(apart), [_log_density(theta, apart) for theta in self._thetas]
        self.likeliest = self._thetas[0]
        self.broad = _Theta(alone, shared, wanders[-1], OWN[-1], len(each), OWN[-1])
        self._stacked: dict[int, tuple[Array, Array]] = {}
        self.settle()

    def settle(self, gain: Callable[[], float] = lambda: 0.0) -> None:
        """Take the size of the noise that is likeliest beside the best cause, as what is its gain at each size."""
        found = []
        for theta, weight in zip(self._thetas, self._weights, strict=True):
            self.likeliest = theta
            found.append(weight + max(gain(), 0.0))
        self.likeliest = self._thetas[int(np.argmax(found))]

    def settle_beside(self, linear: Array, columns: Array) -> None:
        """Take the size of the noise that is likeliest beside a set, of what trials differ by."""
        self.likeliest = self._thetas[int(np.argmax(self._marginals(linear, columns, None, (BETWEEN,))))]

    def log_evidence(self, linear: Array, columns: Array, z: Array, lacking: bool = False, asked: int = MEAN) -> float:
        """Log marginal likelihood of a set.

        Parameters
        ----------
        linear : (trials, 3 m) turned differences that the linear model at the set's values would have without the set
        columns : (trials, 3 m, k) turned, of the set, there
        z : (k,) amounts that were run: what the linear model promises beyond them does not count
        lacking : whether the model may lack something beside it
        """
        return float(logsumexp(self._marginals(linear, columns, z, self._sizes(lacking, asked))))

    @staticmethod
    def _sizes(lacking: bool, asked: int) -> Sequence[int]:
        return (BETWEEN,) if asked == BETWEEN else range(1, 1 + len(LACKS)) if lacking else (0,)

    def _marginals(self, linear: Array, columns: Array, z: Array | None, sizes: Sequence[int]) -> Array:
        """Log densities of a set, sizes of what lacks after one another, each (noise,) for every size of the noise."""
        grams = self._grams(linear, columns, sizes)
        return np.concatenate([_marginal(gram, z) - half_log - math.log(len(sizes)) for gram, half_log in grams])

    def _grams(self, linear: Array, columns: Array, sizes: Sequence[int]) -> list[tuple[Array, Array]]:
        """Products (noise, 1 + k, 1 + k) of differences and columns in units of the noise; half the logs of its
        determinants (noise,): for each size of what lacks."""
        both = np.concatenate([linear[..., None], columns], axis=-1)
        apart = np.moveaxis(both[1:], 0, 1)  # (3 m, contrasts, 1 + k)
        inverses, half_logs = self._noise(BETWEEN)
        turned = (inverses @ apart.reshape(len(apart), -1)).reshape(len(inverses), -1, both.shape[-1])
        between = apart.reshape(-1, both.shape[-1]).T @ turned, self.contrasts * half_logs
        out = []
        for size in sizes:
            gram, half_log = between
            if size != BETWEEN:
                inverses, half_logs = self._noise(size)
                gram, half_log = gram + both[0].T @ (inverses @ both[0]), half_log + half_logs
            out.append((gram, half_log))
        return out

    def _noise(self, part: int) -> tuple[Array, Array]:
        """Inverses (noise, 3 m, 3 m) of a covariance for every size of the noise; half the logs of determinants."""
        if part not in self._stacked:
            inverses = np.array([theta.inverse(part) for theta in self._thetas])
            self._stacked[part] = inverses, np.array([theta.half_log(part) for theta in self._thetas])
        return self._stacked[part]

    def objective(self, difference: Array, z: Array, asked: int = MEAN) -> float:
        """Twice the negative log posterior of a set's amounts, at the likeliest size of the noise, but for a constant.

        ``difference`` (trials, 3 m), turned, is that at ``z`` (k,).
        """
        w = self.whiten(difference, asked=asked)
        return float(np.sum(w * w)) + float(z @ z)

    def whiten(self, turned: Array, lacking: int = 0, asked: int = MEAN) -> Array:
        """Turned differences (trials, 3 m) or columns (trials, 3 m, k) in units of the noise, at its likeliest size.

        One row for each trial and sample.
        """
        theta = self.likeliest
        k = turned[..., None] if turned.ndim == 2 else turned
        parts = [solve_triangular(theta.root(BETWEEN), row, lower=True) for row in k[1:]]
        if asked != BETWEEN:
            parts.insert(0, solve_triangular(theta.root(lacking), k[0], lower=True))
        out = np.concatenate(parts) if parts else np.zeros((0, k.shape[2]))
        return out[:, 0] if turned.ndim == 2 else out

    def products(self, columns: Array, lacking: int, asked: int) -> tuple[Array, Array]:
        """Products (p, p) of columns (3 m, p) in units of the noise of the mean, and of one contrast."""
        theta = self.likeliest
        x = solve_triangular(theta.root(BETWEEN), columns, lower=True)
        if asked == BETWEEN:
            return np.zeros((columns.shape[1], columns.shape[1])), x.T @ x
        y = solve_triangular(theta.root(lacking), columns, lower=True)
        return y.T @ y, x.T @ x

    def amounts(self, linear: Array, columns: Array, z: Array, asked: int = MEAN) -> tuple[Array, Array]:
        """Most probable amounts (k,) of a set, and their covariance (k, k), every size of the noise weighed."""
        sizes = self._sizes(False, asked)
        ((gram, _),) = self._grams(linear, columns, sizes)
        spreads = np.linalg.inv(np.eye(columns.shape[-1]) + gram[:, 1:, 1:])
        means = (spreads @ gram[:, 1:, :1])[:, :, 0]
        parts = self._marginals(linear, columns, z, sizes)
        share = np.exp(parts - logsumexp(parts))
        off = means - share @ means
        covariance = np.einsum("t,tij->ij", share, spreads) + np.einsum("t,ti,tj->ij", share, off, off)
        return np.asarray(share @ means), covariance


def contrasts(each: Array) -> Array:
    """Orthonormal contrasts (trials - 1, n) of the rows (Helmert): what the trials differ by among themselves."""
    out = []
    for k in range(1, len(each)):
        out.append((each[:k].sum(axis=0) - k * each[k]) / math.sqrt(k * (k + 1)))
    return np.array(out).reshape(len(out), each.shape[1])


def turned(each: Array) -> Array:
    """The mean of the rows (trials, n), then their contrasts."""
    return np.vstack([each.mean(axis=0), contrasts(each)])


def _blockwise(block: Block, time_s: float) -> Array:
    """Covariance (3 m, 3 m) of a wandering as large as the response, channel by channel."""
    roots = [smooth(block, c, time_s) for c in ENCODERS]
    return np.asarray(sum(root @ root.T for root in roots))


def _log_density(theta: _Theta, rows: Array) -> float:
    """Log density of contrasts, but for a constant."""
    w = solve_triangular(theta.root(BETWEEN), rows.T, lower=True) if len(rows) else np.zeros(0)
    return float(-0.5 * np.sum(w * w)) - len(rows) * theta.half_log(BETWEEN)


def _marginal(gram: Array, z: Array | None) -> Array:
    """Log densities (noise,) of a difference, the first column, when the others have standard normal amounts, but for
    a constant.

    ``gram`` (noise, 1 + k, 1 + k) holds their products in units of the noise. What the linear model gains between the
    amounts that were run and its own best ones counts to `UNTAKEN` only; wholly where none are given.
    """
    out = -0.5 * gram[:, 0, 0]
    if gram.shape[1] > 1:
        inner, b = np.eye(gram.shape[1] - 1) + gram[:, 1:, 1:], gram[:, 1:, 0]
        best = np.linalg.solve(inner, b[..., None])[..., 0]
        short = best if z is None else best - z
        untaken = 0.0 if z is None else 0.5 * np.einsum("si,sij,sj->s", short, inner, short)
        out += 0.5 * np.sum(b * best, axis=1) - 0.5 * np.linalg.slogdet(inner)[1]
        out -= np.maximum(untaken - UNTAKEN, 0.0)
    return np.asarray(out)


UNTAKEN = 1.0
LEAST_SHOWN = 1.5  # standard uncertainties that a value wrong by `Candidate.wrong` makes: with less it gains no odds
LEAST_NOISE = 0.5  # of the same, that what is known of a value makes where its derivative is found again
FOLLOWED = 6  # sets from each ranking
ALIKE = 2
BRANCHES = 12  # candidates that larger sets are made of
ROUNDS, MORE_ROUNDS = 4, 8  # what some trials differ by bends more
HOPELESS, FAR_BEHIND = 100.0, 0.25  # log odds, and share of what the best explains, that a set may be behind it
CLEAR = 2.0  # of a u: a change that is told from none
PAIRED = 60  # candidates, the best alone, whose pairs are looked at
CLOSE = 0.1  # of a posterior u: a step below it is the last
TOO_MUCH = 4.0  # standard deviations of the sum of squares
LEAST_TOLD = 2.0 * LEAST_ADDED  # of an effect: with less it is its being there, not its size, that is seen
DAMPING = ".normal.D"
FELTS = 4  # that may remember
HALF = 0.5  # of a squared difference, left
MUCH_ALIKE = 0.7  # cosine of what two causes do, in broad noise
AMOUNTS, FEW = (-3.0, -2.0, -1.5, -1.0, -0.5, 0.5, 1.0, 1.5, 2.0, 3.0), (-1.5, 1.5)
"""Of a single cause, before it is followed."""
SHORTER = 0.3  # of a step that did not lower the objective


@dataclass(frozen=True)
class Followed:
    """One set where it is most probable."""

    members: tuple[int, ...]  # candidates, by index
    z: Array  # (k,) amounts
    each: Array  # (trials, 3 m) differences there
    columns: Array  # (3 m, k) derivatives of the predicted curve with respect to each member's source there
    rough: float = 0.0  # log odds that the linear model was off by at the last step that was run from there

    @cached_property
    def turned(self) -> Array:
        """Mean and contrasts (trials, 3 m) of the differences."""
        return turned(self.each)

    @property
    def point(self) -> Point:
        """Where the model is run."""
        return Point(tuple(sorted(zip(self.members, map(float, self.z), strict=True))))


class Search:
    """Followed sets of one session, of one part of the question.

    Parameters
    ----------
    responses : Responses
    evidence : Evidence
    points : Followed, Followed
        What is taken for granted (the model as it is, or with what the trials differ by), which all sets hold; and the
        set around which derivatives and noise were found.
    derivatives : (3 m, p) of the predicted curve with respect to every source, and (m, 3, n) of the force's noise
    asked : `MEAN` or `BETWEEN`

    Attributes
    ----------
    noise : sources that are not known well enough, or scatter too much, to be left out of the noise
    named : candidates that may be named, and would show
    """

    def __init__(
        self,
        responses: Responses,
        evidence: Evidence,
        points: tuple[Followed, Followed],
        derivatives: tuple[Array, Array],
        asked: int = MEAN,
    ) -> None:
        self.responses, self.evidence, self.asked = responses, evidence, asked
        self.start, self.around = points
        self._told: dict[int, Array] = {}
        self._known: dict[tuple[int, bool], tuple[Followed, float]] = {}
        self.columns, self.force = derivatives
        listed = responses.listed
        mean, between = evidence.products(self.columns, 0, MEAN)
        known = np.array([max(s.known, s.scatter) for s in listed])
        self.noise = [int(j) for j in np.flatnonzero(np.sqrt(np.diag(mean)) * known > LEAST_NOISE)]
        self._weights = turned(np.array([c.weights for c in responses.candidates]).T)
        own = np.array([c.source for c in responses.candidates])
        shows = np.diag(between)[own] * np.sum(self._weights[1:] ** 2, axis=0)
        if asked != BETWEEN:
            shows = shows + np.diag(mean)[own] * self._weights[0] ** 2
        wanted = np.array([(c.profile == ALL) == (asked == MEAN) for c in responses.candidates])
        self.named = [int(j) for j in np.flatnonzero(wanted & (np.sqrt(shows) > LEAST_SHOWN))]
        if asked == BETWEEN and self.named:
            evidence.settle(lambda: self._best_gain(self.around))

    def with_effects(self) -> Search:
        """The search with effects that the model lacks among its causes: of felts that remember, the `FELTS` whose
        damping, which a memory takes the place of, shows most."""
        listed, known = self.responses.listed, np.any(self.columns != 0.0, axis=0)
        shows = np.diag(self.evidence.products(self.columns, 0, self.asked)[0])
        damping = {s.name.removesuffix(DAMPING): shows[j] for j, s in enumerate(listed) if s.name.endswith(DAMPING)}
        felts = sorted(damping, key=lambda felt: -damping[felt])[:FELTS]
        late = [
            j for j, s in enumerate(listed)
            if s.added and not known[j] and all(damping.get(felt, 0.0) > 0.0 and felt in felts for felt, _ in s.laws)
        ]  # fmt: skip
        if not late:
            return self
        at, columns = self.around, self.columns.copy()
        found = self.responses.columns([(at.point, 0, j) for j in late], len(late) * [at.each])
        columns[:, late] = np.column_stack(found)
        return Search(self.responses, self.evidence, (self.start, at), (columns, self.force), self.asked)

    def effects(self, found: Sequence[Followed]) -> list[Followed]:
        """Every effect by itself that may come near the best of the sets found, followed."""
        ours = np.array(self.named, dtype=int)[self._added(self.named)]
        started = [self._started((*self.start.members, int(j)), self.start) for j in ours]
        needed = self._needed(found)
        near = [one for one in started if self._step(one)[1] < needed]
        if not any(self.fits(one) for one in found):  # as stated, where its derivative was found, it may come nearer
            stated = [replace(one, z=np.append(one.z[:-1], 1.0), each=one.each - one.columns[:, -1]) for one in started]
            near += sorted((one for one in stated if self.left(one) < HALF), key=self.left)[:FOLLOWED]
        return self.better(self._follow(near))

    def better(self, found: Sequence[Followed]) -> list[Followed]:
        """The better one of sets that were followed twice."""
        best: dict[tuple[int, ...], Followed] = {}
        for one in sorted(found, key=self.log_evidence):
            best[one.members] = one
        return list(best.values())

    def of_size(self, size: int, best: Followed) -> list[Followed]:
        """The likeliest sets of a size, followed; ``best`` is the best set found so far."""
        lacks = (0,) if self.asked == BETWEEN else (0, 2, 3)
        if self.asked == BETWEEN and not self._told:
            self._tell()
        starts = [(self.start, k) for k in lacks] if size == 1 else [(self.start, 0), (best, 0)]
        wanted: dict[tuple[int, ...], Followed] = {}
        for start, lacking in starts:
            ranked = self._ranked(size, start, lacking)
            for members in ranked[:FOLLOWED] if self.asked == MEAN and size > 1 else self._unlike(ranked):
                wanted.setdefault(members, self._started(members, start))
        if self.asked == MEAN:
            found = self._follow(list(wanted.values()))
            if size > 1:
                return found
            again = {one.members: one for one in self._faults()}
            if not any(self.fits(one) for one in found):
                again = wanted | again | {one.members: one for one in self._loudest()}
            near = [one for one in self._follow(list(again.values()), broad=True) if self.left(one) < HALF]
            return self.better(found + self._follow(near))
        with self._broadly():
            for start, _ in starts:
                for members in self._ranked(size, start, 0)[:FOLLOWED]:
                    wanted.setdefault(members, self._started(members, start))
        started = list(wanted.values())
        if size == 1:
            started += self._faults()  # a cause among both is followed from either end
        found = self._follow_far(started)
        if size > 1:
            return found
        laws = self._least([j for j in self.named if self.source(j).law], FEW)  # they, too, have lost only if followed
        return self.better(found + self._follow_far(laws))

    def _faults(self) -> list[Followed]:
        """Faults of the session, and where the arm presses, each at the amount of ten that leaves least in broad noise.

        They have lost only if they were followed: what is known of them hides how they show.
        """
        return self._least([j for j in self.named if self.source(j).of_setup], AMOUNTS)

    def _loudest(self) -> list[Followed]:
        """Other causes of the model's own, those that show most in broad noise, where few amounts leave least."""
        with self._broadly():
            shows = np.diag(self._around(self.start, 0)[0])
        ours = [j for j in self.named if not self.source(j).added and not self.source(j).of_setup]
        return self._least(sorted(ours, key=lambda j: -shows[j])[:BRANCHES], FEW)

    def _least(self, ours: Sequence[int], amounts: Sequence[float]) -> list[Followed]:
        """Single causes, each at the amount that leaves least in broad noise: the best of them.

        Near a fork of the motion a stroke's answer bends so that no step from nothing leads to the cause.
        """
        alone = [self._started((*self.start.members, j), self.start) for j in ours]
        tried = [replace(one, z=np.append(one.z[:-1], z)) for one in alone for z in amounts]
        runs = self.responses.differences([one.point for one in tried])
        least: dict[tuple[int, ...], tuple[float, Followed]] = {}
        with self._broadly():
            for one, each in zip(tried, runs, strict=True):
                if each is not None:
                    there = replace(one, each=each)
                    value = self.evidence.objective(there.turned, there.z, self.asked)
                    if value < least.get(one.members, (math.inf, one))[0]:
                        least[one.members] = value, there
        return [one for _, one in sorted(least.values(), key=lambda pair: pair[0])[:FOLLOWED]]

    def again(self, sets: Mapping[int, Sequence[Followed]]) -> dict[int, list[Followed]]:
        """Sets by size, those near the best run anew and followed on: around another set they lie elsewhere."""
        ranked = sorted((s for size, found in sets.items() if size for s in found), key=self.log_evidence, reverse=True)
        near = [s for s in ranked[:FOLLOWED] if self.log_evidence(s) > self.log_evidence(ranked[0]) - HOPELESS]
        moved = {size: [s for s in found if all(s is not one for one in near)] for size, found in sets.items()}
        runs = self.responses.differences([one.point for one in near])
        for one in self._follow(
            [replace(s, each=each) for s, each in zip(near, runs, strict=True) if each is not None]
        ):
            moved[len(self.own(one.members))].append(one)
        return moved

    def twins(self, one: Followed) -> list[Followed]:
        """Sets with another cause in place of one, in the same trials, that do much the same there, followed.

        Where a stroke's answer bends, no step from nothing leads to them.
        """
        listed, started = self.responses.candidates, list[Followed]()
        for i, j in enumerate(one.members):
            if j in self.start.members:
                continue
            others = [k for k in self.named if listed[k].weights == listed[j].weights and k not in one.members]
            asked = [(one.point, listed[k].seen_in, listed[k].source) for k in others]
            found = self.responses.columns(asked, len(others) * [one.each])
            with self._broadly():
                mean, between = self.evidence.products(np.column_stack([one.columns[:, i], *found]), 0, self.asked)
            gram = mean + between
            norms = np.sqrt(np.diag(gram))
            alike, sizes = gram[0, 1:] / np.maximum(norms[0] * norms[1:], 1e-300), one.z[i] * gram[0, 1:]
            for n in np.argsort(-np.abs(alike), kind="stable")[:FOLLOWED]:
                if abs(alike[n]) > MUCH_ALIKE:
                    members, z, columns = list(one.members), one.z.copy(), one.columns.copy()
                    members[i], columns[:, i] = others[n], found[n]
                    most = self.source(others[n]).furthest
                    z[i] = np.clip(sizes[n] / gram[n + 1, n + 1], -most, most)
                    started.append(replace(one, members=tuple(members), z=z, columns=columns))
        runs = self.responses.differences([s.point for s in started])
        there = [replace(s, each=each) for s, each in zip(started, runs, strict=True) if each is not None]
        if len(one.members) == 1 + len(self.start.members):  # near a fork not even these derivatives lead there
            there += self._least([k for k in others if self.source(k).law or self.source(k).of_setup], AMOUNTS)
        return self._follow_far(there)

    def _tell(self) -> None:
        """Find derivatives of faults of the session anew, each in a trial that would have it.

        What a stroke answers to its force after the blow may be the opposite of what another one does.
        """
        listed, at = self.responses.candidates, self.around
        ours = [j for j in self.named if self.source(j).of_session]
        asked = [(at.point, listed[j].seen_in, listed[j].source) for j in ours]
        self._told = dict(zip(ours, self.responses.columns(asked, len(ours) * [at.each]), strict=True))
        self.evidence.settle(lambda: self._best_gain(at))

    def _unlike(self, ranked: Sequence[tuple[int, ...]]) -> list[tuple[int, ...]]:
        """The best sets, `ALIKE` of the same sources at most; and twice as many of faults of the session alone.

        A fault of the session has lost only if it was followed.
        """
        counts: dict[tuple[int, ...], int] = {}
        kept: list[tuple[int, ...]] = []
        ours: list[tuple[int, ...]] = []
        for members in ranked:
            own = tuple(sorted(self.responses.candidates[j].source for j in self.own(members)))
            counts[own] = counts.get(own, 0) + 1
            if all(self.responses.listed[k].of_session for k in own):
                ours.append(members)
            elif counts[own] <= ALIKE or self.asked == MEAN:
                kept.append(members)
        return kept[:FOLLOWED] + ours[: 2 * FOLLOWED]

    def subsets(self, best: Followed) -> list[Followed]:
        """The sets that a set leaves when one change is taken out, followed from where it is."""
        kept = [[i for i in range(len(best.members)) if i != out] for out in self.at(best)]
        parts = [replace(best, members=tuple(best.members[i] for i in k), z=best.z[k]) for k in kept]
        found = self.responses.differences([part.point for part in parts])
        started = [
            replace(part, each=each, columns=best.columns[:, k])
            for part, k, each in zip(parts, kept, found, strict=True)
            if each is not None
        ]
        return self._follow(started)

    def fits(self, one: Followed) -> bool:
        """Whether what is left with a set is noise: its squares are no more than so much noise has."""
        rows = one.turned[1:] if self.asked == BETWEEN else one.turned[:1]
        w = self.evidence.objective(one.turned, one.z, self.asked)
        if self.asked == MEAN:
            w -= self.evidence.objective(one.turned, 0.0 * one.z, BETWEEN)
        return w < rows.size + TOO_MUCH * float(np.sqrt(2.0 * rows.size))

    def shown(self, one: Followed) -> bool:
        """Whether every change of a set is told from none by its u, and lies no further than sets are followed."""
        z, covariance = self.evidence.amounts(*self.linear(one), one.z, self.asked)
        own = self.at(one)
        most = self._furthest(one.members)
        size, u = np.abs(z), np.sqrt(np.diag(covariance))
        return bool(np.all(size[own] > CLEAR * u[own]) and np.all(size[own] < most[own]))

    def left(self, one: Followed) -> float:
        """Share of the squared difference that is left with a set: of the mean, or of what the trials differ by."""
        asked = slice(1, None) if self.asked == BETWEEN else slice(0, 1)
        return float(np.sum(one.turned[asked] ** 2) / np.sum(self.start.turned[asked] ** 2))

    def scatter(self, j: int) -> float:
        """Standard uncertainty of an amount for what its source scatters by from trial to trial alone; 0 of the mean.

        The noise holds that scatter as one stroke answers it; others may answer otherwise.
        """
        if self.asked == MEAN:
            return 0.0
        return self.source(j).scatter / float(np.linalg.norm(self._weights[1:, j]))

    def without(self, size: int, named: Sequence[tuple[int, ...]]) -> list[Followed]:
        """The likeliest sets of a size that hold none of the sets named, followed."""
        wanted: dict[tuple[int, ...], Followed] = {}
        for lacking in (0,) if self.asked == BETWEEN else (0, 2):
            ranked = self._ranked(size, self.start, lacking)
            free = [s for s in ranked if not any(set(self.own(n)) <= set(s) for n in named)]
            for members in free[:FOLLOWED]:
                wanted.setdefault(members, self._started(members, self.start))
        return self._follow(list(wanted.values()))

    def holding(self, one: Followed, margin: float) -> list[Followed]:
        """Sets with one or two changes more that explain as well, by a clear amount, or move a size by more than its u.

        That a set is the smallest does not say that nothing else has changed: where such a set is as likely, to a log
        evidence of ``margin``, neither the set alone nor its sizes are known.
        """
        gram, b = self._around(one, 0)
        k = len(one.members)

        def amounts(members: tuple[int, ...]) -> tuple[Array, Array]:
            spread = np.linalg.inv(gram[np.ix_(members, members)] + np.eye(len(members)))
            return spread @ b[list(members)], np.sqrt(np.diag(spread))

        def differs(members: tuple[int, ...]) -> bool:
            there, width = amounts(members)
            return bool(np.any(np.abs(there[:k] - z) > u) or np.all(np.abs(there[k:]) > CLEAR * width[k:]))

        z, u = amounts(one.members)
        ((_, here),) = self._scored(gram, b, [one.members], 0.0)
        found: list[tuple[int, ...]] = []
        pool = [j for j in self.named if j not in one.members]
        for more in (1, 2):
            scored = self._scored(gram, b, [(*one.members, *extra) for extra in combinations(pool, more)], 0.0)
            moved = [s for s, gain in scored if gain > here - margin and differs(s)]
            found += moved[:FOLLOWED]
            pool = [s[-1] for s in moved[:BRANCHES]]
        followed = self._follow([self._started(members, one) for members in found])
        return [s for s in followed if np.all(s.z[k:] != 0.0)]  # what runs do not confirm is where it started

    def source(self, j: int) -> Source:
        """What may be wrong by a candidate."""
        return self.responses.listed[self.responses.candidates[j].source]

    def own(self, members: Sequence[int]) -> tuple[int, ...]:
        """Members of a set without what is taken for granted."""
        return tuple(j for j in members if j not in self.start.members)

    def at(self, one: Followed) -> list[int]:
        """Places of the members that are not taken for granted."""
        return [i for i, j in enumerate(one.members) if j not in self.start.members]

    def alone(self, one: Followed) -> Followed:
        """A set without what is taken for granted; its differences hold that until they are run anew (`linearised`)."""
        own = self.at(one)
        return replace(one, members=self.own(one.members), z=one.z[own], columns=one.columns[:, own])

    def promised(self, best: Followed) -> float:
        """Log evidence that one or two changes more gain beside a set at most, by the linear model around it."""
        gram, b = self._around(best, 0)
        rest = [j for j in self.named if j not in best.members]
        ((_, here),) = self._scored(gram, b, [best.members], 0.0)
        ones = self._scored(gram, b, [(*best.members, j) for j in rest])
        near = sorted({j for s, _ in ones[:PAIRED] for j in s[-1:]})
        pairs = self._scored(gram, b, [(*best.members, *more) for more in combinations(near, 2)])
        held = self.chosen(best.members)
        return max((found[0][1] + held - here for found in (ones, pairs) if found), default=-np.inf)

    def _best_gain(self, start: Followed) -> float:
        """Log evidence that one change more gains beside a set at most, by the linear model around it."""
        gram, b = self._around(start, 0)
        ((_, here),) = self._scored(gram, b, [start.members], 0.0)
        ones = self._scored(gram, b, [(*start.members, j) for j in self.named if j not in start.members])
        return ones[0][1] + self.chosen(start.members) - here if ones else -np.inf

    def chosen(self, members: Sequence[int]) -> float:
        """What a set must gain for having been chosen among so many."""
        return sum(self.responses.candidates[j].rarity for j in self.own(members))

    def log_evidence(self, one: Followed, lacking: bool = False) -> float:
        """Log evidence of a set, chosen among so many; whether the model may lack something beside it."""
        key = id(one), lacking
        if key not in self._known:  # with the set, so that no other has its id
            found = self.evidence.log_evidence(*self.linear(one), one.z, lacking, self.asked)
            self._known[key] = one, found - self.chosen(one.members)
        return self._known[key][1]

    @property
    def tried(self) -> str:
        """All causes that were looked at, in words."""
        listed, known = self.responses.listed, np.any(self.columns != 0.0, axis=0)
        apart = self.asked == BETWEEN
        kinds = [
            s.kind
            for j, s in enumerate(listed)
            if s.named and (known[j] or not s.added) and (not apart or len(s.profiles) > 1)
        ]
        return ", ".join(dict.fromkeys(kinds))

    def linear(self, one: Followed) -> tuple[Array, Array]:
        """Turned differences (trials, 3 m) that the linear model at a set has without it; its columns, turned."""
        columns = self._weights[:, None, list(one.members)] * one.columns
        return one.turned + columns @ one.z, columns

    def _around(self, start: Followed, lacking: int) -> tuple[Array, Array]:
        """Products (p, p) of all candidates around a start, and with the difference (p,), in units of the noise."""
        told = list(self._told)
        everything = np.hstack([self.columns, start.columns, *(self._told[j][:, None] for j in told)])
        own = np.array([c.source for c in self.responses.candidates])
        own[told] = self.columns.shape[1] + len(start.members) + np.arange(len(told))
        own[list(start.members)] = self.columns.shape[1] + np.arange(len(start.members))
        at = np.array(sorted({*self.named, *start.members}), dtype=int)
        mean, between = self.evidence.products(everything, lacking, self.asked)
        w, places = self._weights[:, at], np.ix_(own[at], own[at])
        gram, right = np.zeros((own.size, own.size)), np.zeros(own.size)
        gram[np.ix_(at, at)] = np.outer(w[0], w[0]) * mean[places] + (w[1:].T @ w[1:]) * between[places]
        left = self.evidence.whiten(self.linear(start)[0], lacking, self.asked)
        right[at] = np.einsum("tj,tj->j", w, self._projected(everything, left, lacking)[:, own[at]])
        return gram, right

    def _projected(self, columns: Array, left: Array, lacking: int) -> Array:
        """Products (trials, p) of columns with differences in units of the noise; none of the mean if not asked."""
        theta = self.evidence.likeliest
        x = solve_triangular(theta.root(BETWEEN), columns, lower=True)
        rows = left.reshape(-1, columns.shape[0])
        out = rows @ x
        if self.asked == BETWEEN:
            return np.vstack([np.zeros(columns.shape[1]), out])
        out[0] = rows[0] @ solve_triangular(theta.root(lacking), columns, lower=True)
        return np.asarray(out)

    def _ranked(self, size: int, start: Followed, lacking: int) -> list[tuple[int, ...]]:
        """Sets of a size, the best of the linear model around a start first, each with what is taken for granted."""
        gram, b = self._around(start, lacking)
        granted = self.start.members
        ones = self._scored(gram, b, [(*granted, j) for j in self.named])
        if size == 1:
            return [members for members, _ in ones]
        near = [members[-1] for members, _ in ones]
        if size == 2:  # both of a pair may matter only together
            pool = near[:PAIRED]
        else:
            pairs = self._scored(gram, b, [(*granted, *more) for more in combinations(near[:PAIRED], 2)])
            pool = list(dict.fromkeys(j for members, _ in pairs for j in self.own(members)))[:BRANCHES]
        pool = sorted({*self.own(start.members), *pool})
        return [m for m, _ in self._scored(gram, b, [(*granted, *more) for more in combinations(pool, size)])]

    def _scored(
        self, gram: Array, b: Array, sets: Sequence[tuple[int, ...]], rarity: float = 1.0
    ) -> list[tuple[tuple[int, ...], float]]:
        """Sets with their log evidence beside none, the best first."""
        if not sets:
            return []
        at = np.array(sets, dtype=int)
        inner = gram[at[:, :, None], at[:, None, :]] + np.eye(at.shape[1])
        right = b[at]
        amounts = np.linalg.solve(inner, right[:, :, None])[:, :, 0]
        gain = 0.5 * np.einsum("si,si->s", right, amounts)
        gain -= 0.5 * np.linalg.slogdet(inner)[1]
        gain -= rarity * np.array([self.chosen(s) for s in sets])
        added = self._added(range(len(self.responses.candidates)))[at]
        gain[np.any(added & (amounts < 0.0), axis=1)] = -np.inf  # there is no less than none of an effect
        return [(sets[i], float(gain[i])) for i in np.argsort(-gain, kind="stable")]

    def _started(self, members: tuple[int, ...], start: Followed) -> Followed:
        """A set before it is followed: at the amounts of a start that is part of it, else at none."""
        if not set(start.members) <= set(members):
            start = self.start
        z = np.array([start.z[start.members.index(j)] if j in start.members else 0.0 for j in members])
        columns = self.columns[:, [self.responses.candidates[j].source for j in members]].copy()
        for i, j in enumerate(members):
            columns[:, i] = self._told.get(j, columns[:, i])
            if j in start.members:
                columns[:, i] = start.columns[:, start.members.index(j)]
        return Followed(members, z, start.each, columns)

    def _follow(self, started: Sequence[Followed], broad: bool = False) -> list[Followed]:
        """All sets, each where it is most probable; all go round together, so that their runs are done side by side.

        In ``broad`` noise, which looks at the whole of a stroke, the way there is smooth.
        What all share: a set that does not come near the best, nor promises to after its first step, goes no further.
        """
        at, listed, likeliest = list(started), self.responses.candidates, self.evidence.likeliest

        def settle(one: Followed) -> None:  # what some trials differ by would be noise; beside a set it is not
            if broad:
                self.evidence.likeliest = self.evidence.broad
            elif self.asked == BETWEEN:
                self.evidence.settle_beside(*self.linear(one))

        going = {i: 1.0 for i in range(len(at))}
        for round_ in range(ROUNDS if self.asked == MEAN else MORE_ROUNDS):
            proposed: dict[int, Array] = {}
            hoped: dict[int, float] = {}
            needed = self._needed(at, broad) if round_ and self.asked == MEAN else math.inf
            for i, short in going.items():
                settle(at[i])
                step, promised = self._step(at[i])
                if step is not None and promised < needed:
                    proposed[i] = at[i].z + short * step
                    hoped[i] = promised + (1.0 - short) ** 2 * (
                        self.evidence.objective(at[i].turned, at[i].z, self.asked) - promised
                    )
            points = [replace(at[i], z=z).point for i, z in proposed.items()]
            tried, going, accepted = going, {}, []
            for (i, z), each in zip(proposed.items(), self.responses.differences(points), strict=True):
                settle(at[i])
                here = self.evidence.objective(at[i].turned, at[i].z, self.asked)
                there = math.inf if each is None else self.evidence.objective(turned(each), z, self.asked)
                if each is not None:
                    at[i] = replace(at[i], rough=0.5 * abs(there - hoped[i]))
                if each is None or there >= here:
                    going[i] = SHORTER * tried[i]
                    continue
                at[i] = replace(at[i], z=z, each=each)
                accepted.append(i)
            asked = [(at[i].point, listed[j].seen_in, listed[j].source) for i in accepted for j in at[i].members]
            found = self.responses.columns(asked, [at[i].each for i in accepted for _ in at[i].members])
            for i in accepted:
                own = [found.pop(0) for _ in at[i].members]
                at[i] = replace(at[i], columns=np.column_stack(own))
                going[i] = 1.0
            if not going:
                break
        self.evidence.likeliest = likeliest
        return [one for one in at if not np.any(self._added(one.members) & (one.z < LEAST_TOLD))]

    def _follow_far(self, started: Sequence[Followed]) -> list[Followed]:
        """`_follow` in broad noise, and on from there in that of the set."""
        return self._follow(self._follow(started, broad=True))

    @contextmanager
    def _broadly(self) -> Iterator[None]:
        """Broad noise, in which the whole of a stroke shows, for as long."""
        likeliest, self.evidence.likeliest = self.evidence.likeliest, self.evidence.broad
        try:
            yield
        finally:
            self.evidence.likeliest = likeliest

    def _added(self, members: Sequence[int]) -> NDArray[np.bool_]:
        """Which members are effects that the model does not have."""
        return np.array([self.source(j).added for j in members], dtype=bool)

    def _furthest(self, members: Sequence[int]) -> Array:
        """Amounts that members are followed to."""
        return np.array([self.source(j).furthest for j in members])

    def _needed(self, at: Sequence[Followed], broad: bool = False) -> float:
        """The objective that a set must promise to be followed on, beside the best of these."""
        nothing, *others = (self.evidence.objective(s.turned, s.z) for s in (self.start, *at))
        best = min(others, default=nothing)
        return best + max(0.0 if broad else 2.0 * HOPELESS, FAR_BEHIND * (nothing - best))

    def _step(self, one: Followed) -> tuple[Array | None, float]:
        """Gauss–Newton step of a set, None where it is small; the objective that it promises."""
        linear, columns = self.linear(one)
        x, w = (self.evidence.whiten(part, asked=self.asked) for part in (columns, linear))
        precision = np.eye(x.shape[1]) + x.T @ x
        added = self._added(one.members)
        most = self._furthest(one.members)
        least = np.where(added, 0.0, -most)
        z = np.clip(np.linalg.solve(precision, x.T @ w), least, most)
        if self.asked == BETWEEN:  # of what all share no contrast tells the amount
            z = np.where(np.isin(one.members, self.start.members), one.z, z)
        step = z - one.z
        width = np.sqrt(np.diag(np.linalg.inv(precision)))
        promised = float(np.sum((w - x @ z) ** 2) + z @ z)
        return None if np.all(np.abs(step) < CLOSE * width) else step, promised
