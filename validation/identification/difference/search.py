"""The sets of changes that explain the trials: ranked by the linear model, followed by runs, weighed by evidence.

Sets of one, then two, then three changes. Of each size the best of the linear model, at the action's values and around
the best set found so far, are followed by runs of the model itself (Gauss–Newton) to where they are most probable, and
weighed there. The next size is looked at only where the linear model promises more than a factor of `ODDS` by it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from validation.conventions import Array
from validation.identification.difference.evidence import Evidence
from validation.identification.difference.responses import Point, Responses

LEAST_SHOWN = 1.5  # standard uncertainties that a value wrong by `Candidate.wrong` makes: with less it gains no odds
LEAST_NOISE = 0.3  # of the same, that what is known of a value makes where its derivative is found again
FOLLOWED = 6  # sets from each ranking
BRANCHES = 12  # candidates that larger sets are made of
ROUNDS = 4
CLOSE = 0.1  # of a posterior u: a step below it is the last
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
    noise : candidates that are not known well enough to be left out of the noise
    named : candidates that may be named, and would show
    """

    def __init__(
        self, responses: Responses, evidence: Evidence, nothing: Followed, derivatives: tuple[Array, Array]
    ) -> None:
        self.responses, self.evidence, self.nothing = responses, evidence, nothing
        self.columns, self.force = derivatives
        shows = np.sqrt((evidence.whiten(self.columns) ** 2).sum(axis=0))
        known = np.array([c.known for c in responses.listed])
        self.noise = [int(j) for j in np.flatnonzero(shows * known > LEAST_NOISE)]
        self.named = [j for j, c in enumerate(responses.listed) if c.named and shows[j] > LEAST_SHOWN]

    def of_size(self, size: int, best: Followed) -> list[Followed]:
        """The likeliest sets of a size, followed; ``best`` is the best set found so far."""
        starts = [(self.nothing, 0), (self.nothing, 2)] if size == 1 else [(self.nothing, 0), (best, 0)]
        wanted: dict[tuple[int, ...], Followed] = {}
        for start, lacking in starts:
            for members in self._ranked(size, start, lacking)[:FOLLOWED]:
                wanted.setdefault(members, self._started(members, start))
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
