"""What a difference between model and trial may be made of, and how large each part is, learnt from all trials.

In: the linear model of every trial (`blocks.Block`), residuals. Out: `Marginal`, with everything linear taken out in
closed form. Sizes are those of the largest marginal likelihood, by Fisher scoring in their logarithms: the information
is taken of each session's discrepancy and of each trial by itself; a step is taken only if the likelihood, with what is
believed beforehand, rises. Source: Searle, Casella and McCulloch (1992), Variance Components.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag, cho_factor, cho_solve, cholesky, solve_triangular
from scipy.linalg.lapack import dtrtrs

from validation.conventions import Array
from validation.infer.blocks import INSTRUMENT, Block
from validation.infer.observations import CHANNEL_NAMES, ENCODERS
from validation.infer.response import Own
from validation.infer.unknowns import Parameter

IMPACT_S, ESCAPEMENT_S, STROKE_S, TRIAL_S = 3e-3, 0.01, 3e-2, 0.3  # how long the phases of a forte stroke last
OWN_S = (IMPACT_S, ESCAPEMENT_S, STROKE_S)
"""Correlation times of a trial's deviation; a third of its variance each."""
SCALES_S = (IMPACT_S, STROKE_S, TRIAL_S)
"""Correlation times of the discrepancy."""
ODDS = 20.0  # of one explanation to another: with less, both are kept
FAMILIES = ("friction of contacts", "friction of joints", "damping", "stiffness", "springs")
LEAST = 1e-6  # of the response: a component's size below it is none
NOT_SEEN, HELD = 1.5 * LEAST, 0.01  # of a channel that was not measured: its size, standard deviation of the logarithm
FLOOR = 1e-4  # of the response: least discrepancy of a converged fit; at its median as large as the error of runs
ROUGH_FLOOR = 2e-3  # of the response: the same on the way and under the null, where the linear model is no closer
# prior of a size: median, standard deviation of its natural logarithm; learning starts there but for the scatter
SCATTER_PRIOR, SCATTER_SD = 0.05, 1.1  # 1.5 % of a law whose prior is 30 %, to a factor of three
SCATTER = 0.07  # where learning starts
NULL_SCATTER = 0.1  # 3 % of a law, where causes are tested: by the prior, laws scatter less on three benches of four
OWN, OWN_SD = 0.01, 2.0  # 1 % of the response, to a factor of seven
COMMON, COMMON_SD = 0.05, 2.5  # 5 % of the response, to a factor of twelve
LIKE_LAWS = 0.5  # standard deviation of the logarithm: the part that is like laws, beside the smooth ones


def family_of(parameter: Parameter) -> int:
    """Place in `FAMILIES` of a law; -1 for what is none."""
    return law_family(parameter.paths[0]) if parameter.factor else -1


def law_family(path: str) -> int:
    """Place in `FAMILIES` of the law that a path of the action belongs to, told by its name; every other path counts as
    stiffness."""
    if "joint_friction" in path:
        return 1
    if "friction" in path:
        return 0
    if path.endswith(".D") or "damping" in path:
        return 2
    return 4 if "spring" in path else 3


@dataclass(frozen=True)
class Sizes:
    """Variance components of a difference, each as a standard deviation.

    Laws of a family (friction of contacts, of joints, damping of felts, their stiffness, springs) scatter alike from
    trial to trial: five trials say next to nothing of the scatter of one felt, and a good deal of that of thirteen.
    What the model lacks has three kinds of parts: smooth ones by channel, at three correlation times; one by channel in
    proportion to the force (what gives under load); and one that acts as if every law were another one in this session.
    The last is believed to be as large as the first are: what the model lacks knows nothing of what laws can do, so
    that as much of it must be expected where laws could have done it as where they could not.
    """

    families: NDArray[np.intp]  # (p + h,) place in `FAMILIES` of what moves and of fixed laws, -1 where it is no law
    by_family: Array  # (5,) standard deviation from trial to trial, in prior standard uncertainties
    own: Array  # (sessions, c) of a trial's own wandering, of the size of the response, by channel
    # (sessions, 4 c + 1) of the discrepancy, of the size of the response: of each channel at each of `SCALES_S`, then
    # of each channel in proportion to the force, then of the part that is like laws
    common: Array

    @staticmethod
    def start(families: NDArray[np.intp], seen: Array) -> Sizes:
        """Variance components to start from; ``seen`` (sessions, c) is 1 where a session has a channel, else 0."""
        return Sizes._fill(families, seen, SCATTER, OWN, COMMON)

    @staticmethod
    def null(families: NDArray[np.intp], own: float) -> Sizes:
        """Variance components with the discrepancy `ROUGH_FLOOR`, for encoders; each trial deviates by the share
        ``own``."""
        seen = np.isin(range(len(CHANNEL_NAMES)), ENCODERS).astype(float)[None]
        return Sizes._fill(families, seen, NULL_SCATTER, own, ROUGH_FLOOR)

    @staticmethod
    def tight(families: NDArray[np.intp], seen: Array) -> Sizes:
        """Start values with a very small discrepancy, with which a fit follows the data closely."""
        return Sizes._fill(families, seen, SCATTER, 2.0 * ROUGH_FLOOR, 2.0 * ROUGH_FLOOR)

    @staticmethod
    def _fill(families: NDArray[np.intp], seen: Array, scatter: float, own: float, common: float) -> Sizes:
        """Equal start values, standard deviations: ``scatter`` of laws (prior u), ``own`` of each trial's deviation and
        ``common`` of the discrepancy (shares of the response); next to none of a channel that ``seen`` (sessions, c; 1
        or 0) lacks."""
        sessions = len(seen)
        parts = np.hstack([np.repeat(seen, len(SCALES_S), axis=1), seen, np.ones((sessions, 1))])
        return Sizes(
            np.asarray(families, dtype=np.intp),
            np.full(len(FAMILIES), scatter),
            np.maximum(own * seen, LEAST),
            np.maximum(common / np.sqrt(len(SCALES_S)) * parts, LEAST),
        )

    @property
    def scatter(self) -> Array:
        """Standard deviation from trial to trial of everything that moves and of fixed laws, (p + h,)."""
        return np.where(self.families >= 0, self.by_family[self.families], 0.0)

    @property
    def channels(self) -> int:
        """How many channels there may be."""
        return int(self.own.shape[1])

    @property
    def discrepancy(self) -> Array:
        """Size of the smooth discrepancy by session and channel, all correlation times together, (sessions, c)."""
        smooth = self.common[:, : len(SCALES_S) * self.channels]
        return np.sqrt((smooth.reshape(len(smooth), self.channels, -1) ** 2).sum(axis=2))

    def log(self) -> Array:
        """Natural logarithms of all components: scatter by family, deviation of trials, discrepancy."""
        return np.log(np.concatenate([self.by_family, self.own.ravel(), self.common.ravel()]))

    def at(self, log: Array) -> Sizes:
        """Sizes with these logarithms."""
        f, n = len(self.by_family), self.own.size
        size = np.exp(log)
        own, common = size[f : f + n].reshape(self.own.shape), size[f + n :].reshape(self.common.shape)
        return Sizes(self.families, size[:f], own, common)

    def at_least(self, floor: float) -> Sizes:
        """None smaller than `LEAST`, none of the smooth discrepancy smaller than the floor."""
        common = np.maximum(self.common, LEAST)
        smooth = slice(0, len(SCALES_S) * self.channels)
        there = self.common[:, smooth] > NOT_SEEN
        common[:, smooth] = np.where(there, np.maximum(common[:, smooth], floor / np.sqrt(len(SCALES_S))), LEAST)
        return Sizes(self.families, np.maximum(self.by_family, LEAST), np.maximum(self.own, LEAST), common)

    def grown(self, factor: float) -> Sizes:
        """The whole discrepancy this much larger."""
        there = self.common > NOT_SEEN
        return Sizes(self.families, self.by_family, self.own, np.where(there, factor * self.common, LEAST))

    def log_prior_moments(self) -> tuple[Array, Array]:
        """Median and standard deviation (k,) of the logarithms of all components before the strokes, in the order of
        `log`; log-normal prior."""
        total = self.discrepancy
        there = total > 2.0 * NOT_SEEN
        mean = (np.log(np.maximum(total, LEAST)) * there).sum(axis=1) / np.maximum(there.sum(axis=1), 1)
        middle, spread = np.full(self.common.shape, np.log(COMMON)), np.full_like(self.common, COMMON_SD)
        middle[:, -1], spread[:, -1] = mean, LIKE_LAWS
        own = np.full(self.own.shape, np.log(OWN)), np.full(self.own.shape, OWN_SD)
        for size, (mid, wide) in ((self.common, (middle, spread)), (self.own, own)):
            mid[size < NOT_SEEN], wide[size < NOT_SEEN] = np.log(LEAST), HELD  # of a channel that was not measured
        f = len(self.by_family)
        return (
            np.concatenate([np.full(f, np.log(SCATTER_PRIOR)), own[0].ravel(), middle.ravel()]),
            np.concatenate([np.full(f, SCATTER_SD), own[1].ravel(), spread.ravel()]),
        )

    def log_prior(self) -> float:
        """Log density of the logarithms before the strokes, but for a constant."""
        middle, spread = self.log_prior_moments()
        return -0.5 * float((((self.log() - middle) / spread) ** 2).sum())


TINY = 1e-9  # of a variance, so that a covariance has a root


@dataclass(frozen=True)
class RandomEffectColumns:
    """Columns (n, k) of random effects, and of each the index of its variance component in `Sizes.log`."""

    columns: Array
    component: NDArray[np.intp]

    @cached_property
    def component_blocks(self) -> list[tuple[int, slice, Array]]:
        """For each variance component its index in `Sizes.log`, a slice of rows outside which its columns are zero, and
        its columns in these rows."""
        out = []
        for component in np.unique(self.component):
            mine = self.columns[:, self.component == component]
            there = np.flatnonzero(mine.any(axis=1))
            rows = slice(int(there[0]), int(there[-1]) + 1) if there.size else slice(0, 1)
            out.append((int(component), rows, np.ascontiguousarray(mine[rows])))
        return out

    def covariance(self, size: Array) -> Array:
        """Covariance (n, n), given the standard deviations ``size`` of all components."""
        scaled = self.columns * size[self.component]
        return np.asarray(scaled @ scaled.T)


def smooth_root(block: Block, channel: int, *correlated_s: float) -> Array:
    """Root (c m, m) of the covariance, rad², of a smooth process in one channel (its place in the block) of a trial, as
    large as its response: the mean of exponential correlations over the times ``correlated_s``, s. Other channels' rows
    are 0.

    Rows of a trial are channel after channel. Smooth parts are Gaussian processes over time with exponential
    correlation, the mean of those of the times given, and as large where the action responds as `Block.size` says.
    Source: Kennedy and O'Hagan (2001).
    """
    t, m = block.time_s, block.time_s.size
    apart = np.abs(t[:, None] - t[None, :])
    k = np.mean([np.exp(-apart / s) for s in correlated_s], axis=0) + TINY * np.eye(m)
    out = np.zeros((block.white.size, m))
    out[channel * m : (channel + 1) * m] = block.size[channel][:, None] * cholesky(k, lower=True)
    return out


def own_parts(block: Block, sizes: Sizes) -> RandomEffectColumns:
    """Random-effect columns of one trial: laws, which scatter, and its smooth deviation."""
    m, first = block.time_s.size, len(FAMILIES) + block.session * sizes.channels
    wander = [smooth_root(block, c, *OWN_S) for c in range(len(block.size))]
    component = [sizes.families[sizes.families >= 0], *(np.full(m, first + c) for c in block.channels)]
    columns = np.hstack([law_columns(block, sizes), *wander])
    return RandomEffectColumns(columns, np.concatenate(component).astype(np.intp))


def law_columns(block: Block, sizes: Sizes) -> Array:
    """Columns (n, l) of all laws of a trial, free or fixed."""
    return np.asarray(np.hstack([block.moved, block.held])[:, sizes.families >= 0])


def shared_root(block: Block, sizes: Sizes, root: Array) -> Array:
    """Root (n, l + n) of the covariance of a trial's n rows by what its session shares: from ``root`` (l + n, l + n) of
    the shifts of l laws, then of a discrepancy of n rows; the trial's own law columns carry the first.

    Trials of one kind differ by some per cent in their force, and after an impact their columns of a law by half.
    """
    laws = law_columns(block, sizes)
    out = root[laws.shape[1] :].copy()
    out[:, : laws.shape[1]] += laws @ root[: laws.shape[1], : laws.shape[1]]
    return np.asarray(out)


def common_parts(blocks: Sequence[Block], sizes: Sizes) -> RandomEffectColumns:
    """Columns (l + n, k), of unit size, of what the trials ``blocks`` of one session share, with the index of the
    variance component of each; rows: l laws' shifts, then the n angle samples of the first trial."""
    lead, c = blocks[0], sizes.channels
    m, first = lead.time_s.size, len(FAMILIES) + sizes.own.size + lead.session * sizes.common.shape[1]
    columns, component = [], []
    for k, channel in enumerate(lead.channels):
        for i, scale in enumerate(SCALES_S):
            columns.append(smooth_root(lead, k, scale))
            component.append(np.full(m, first + channel * len(SCALES_S) + i))
        under_load = np.zeros((lead.white.size, 1))
        under_load[k * m : (k + 1) * m, 0] = lead.load * lead.size[k].max()
        columns.append(under_load)
        component.append(np.full(1, first + c * len(SCALES_S) + channel))
    laws = int(np.sum(sizes.families >= 0))
    component.append(np.full(laws, first + c * (len(SCALES_S) + 1)))
    return RandomEffectColumns(
        np.roll(block_diag(np.hstack(columns), np.eye(laws)), laws, axis=0), np.concatenate(component)
    )


Parts = tuple[Mapping[int, RandomEffectColumns], Sequence[RandomEffectColumns]]


def make_parts(blocks: Sequence[Block], sizes: Sizes) -> Parts:
    """Columns of the discrepancy by session, and of each trial's random effects; both of unit size."""
    sessions = sorted({b.session for b in blocks})
    common = {s: common_parts([b for b in blocks if b.session == s], sizes) for s in sessions}
    return common, [own_parts(b, sizes) for b in blocks]


def null_covariances(block: Block, sizes: Sizes) -> tuple[Array, Array, Array]:
    """Covariances (n, n), rad², of a trial: of its sensors, drive and smooth deviation; of the scatter of its laws; of
    what all trials share, discrepancy and errors of instruments."""
    common, (own,) = make_parts([block], sizes)
    size, laws = np.exp(sizes.log()), law_columns(block, sizes)
    alone = replace(sizes, by_family=np.full_like(sizes.by_family, LEAST))
    each = np.diag(block.white) + block.own @ block.own.T + own.covariance(np.exp(alone.log()))
    root = shared_root(block, sizes, np.eye(laws.shape[1] + len(each)))
    shared = root @ common[block.session].covariance(size) @ root.T + block.instrument @ block.instrument.T
    return each, (laws * sizes.scatter[sizes.families >= 0] ** 2) @ laws.T, shared


def solve_lower(lower: Array, right: Array) -> Array:
    """Solution x of ``lower x = right``, ``lower`` of `scipy.linalg.cholesky`.

    LAPACK's, as `scipy.linalg.solve_triangular` calls it; its checks take as long as the small systems here.
    """
    return np.asarray(dtrtrs(lower, right, lower=1)[0])


class Marginal:
    """The model of all trials.

    Parameters
    ----------
    blocks : sequence of Block
    sizes : Sizes
    parts : as of `make_parts` with the same blocks, if known already
    """

    def __init__(self, blocks: Sequence[Block], sizes: Sizes, parts: Parts | None = None) -> None:
        self.blocks, self.sizes = list(blocks), sizes
        self.parts = make_parts(blocks, sizes) if parts is None else parts
        self.p = blocks[0].moved.shape[1]
        self.shared = self.p + len(INSTRUMENT)
        size = np.exp(sizes.log())
        self.starts: dict[int, int] = {}
        self.roots: dict[int, Array] = {}
        at = self.shared
        for s, common in self.parts[0].items():
            covariance = common.covariance(size)
            lift = TINY * np.diag(covariance) + np.finfo(float).tiny
            self.roots[s] = cholesky(covariance + np.diag(lift), lower=True)
            self.starts[s], at = at, at + len(covariance)
        self.q = at
        self.white = [self._whiten(b, own.covariance(size)) for b, own in zip(self.blocks, self.parts[1], strict=True)]
        self.precision = np.eye(self.q)
        for (_, x), b in zip(self.white, self.blocks, strict=True):
            mine = self.columns_of(b.session)
            self.precision[np.ix_(mine, mine)] += x.T @ x
        factor = cho_factor(self.precision)
        self.log_det = 2.0 * float(np.log(np.diag(factor[0])).sum())
        self.covariance = np.asarray(cho_solve(factor, np.eye(self.q)))
        self._asked: Sequence[Array] | None = None
        self._projected: tuple[Array, float] = np.zeros(self.q), 0.0

    @cached_property
    def width(self) -> Array:
        """Posterior standard uncertainties (p,) of z."""
        return np.asarray(np.sqrt(np.diag(self.covariance)[: self.p]))

    @cached_property
    def rest(self) -> tuple[Array, bool]:
        """Cholesky factor of the precision of all columns but z."""
        found: tuple[Array, bool] = cho_factor(self.precision[self.p :, self.p :])
        return found

    @cached_property
    def curvature(self) -> Array:
        """Half the second derivative (p, p) of the objective with respect to z."""
        across = self.precision[: self.p, self.p :]
        return np.asarray(self.precision[: self.p, : self.p] - across @ cho_solve(self.rest, across.T))

    def columns_of(self, session: int) -> NDArray[np.intp]:
        """Indices of the columns that a trial of this session has."""
        a = self.starts[session]
        return np.concatenate([np.arange(self.shared), np.arange(a, a + len(self.roots[session]))])

    def design(self, b: Block) -> Array:
        """Columns (n, …) of one trial: moved, instrument, discrepancy of its session."""
        return np.hstack([b.moved, b.instrument, shared_root(b, self.sizes, self.roots[b.session])])

    def _whiten(self, b: Block, own: Array) -> tuple[Array, Array]:
        lower = cholesky(np.diag(b.white) + b.own @ b.own.T + own, lower=True)
        return lower, solve_lower(lower, self.design(b))

    def projected(self, residuals: Sequence[Array]) -> tuple[Array, float]:
        """Xᵀ C⁻¹ r (q,) and rᵀ C⁻¹ r of residuals r (n,) of each trial: X all columns that trials share, C the
        covariance of what a trial has of its own. The last answer is kept for the same list."""
        if self._asked is residuals:
            return self._projected
        b, square = np.zeros(self.q), 0.0
        for (lower, x), r, block in zip(self.white, residuals, self.blocks, strict=True):
            w = solve_lower(lower, np.asarray_chkfinite(r))
            b[self.columns_of(block.session)] += x.T @ w
            square += float(w @ w)
        self._asked, self._projected = residuals, (b, square)
        return self._projected

    def mean(self, residuals: Sequence[Array]) -> Array:
        """Most probable value (q,) of every column, given residuals at z = 0 of the linear model."""
        return np.asarray(self.covariance @ self.projected(residuals)[0])

    def slope(self, residuals: Sequence[Array], z: Array) -> Array:
        """Half the negative derivative (p,) of the objective at z, given residuals there."""
        b, _ = self.projected(residuals)
        across = self.precision[: self.p, self.p :]
        return np.asarray(b[: self.p] - across @ cho_solve(self.rest, b[self.p :]) - z)

    def objective(self, residuals: Sequence[Array], z: Array) -> float:
        """Twice the negative log posterior at z, but for a constant; residuals at z, everything else taken out."""
        b, square = self.projected(residuals)
        rest = b[self.p :]
        return square - float(rest @ cho_solve(self.rest, rest)) + float(z @ z)

    def log_likelihood(self, residuals: Sequence[Array]) -> float:
        """Log marginal likelihood of residuals at z = 0 of the linear model, but for a constant."""
        b, square = self.projected(residuals)
        log_det = self.log_det + 2.0 * sum(float(np.log(np.diag(lower)).sum()) for lower, _ in self.white)
        return -0.5 * (square - float(b @ self.covariance @ b) + log_det)

    def log_evidence(self, residuals: Sequence[Array]) -> float:
        """Log likelihood of the residuals plus the log prior of the variance components."""
        return self.log_likelihood(residuals) + self.sizes.log_prior()


GROWN = (2.0, 4.0, 0.5)
"""Factors of the whole discrepancy that are tried beside the likeliest."""


def held_out_score(marginal: Marginal, residuals: Sequence[Array]) -> float:
    """Sum of the log densities, but for a constant, of each session's strokes (with one session: each stroke's) as all
    others predict them; ``residuals`` (n,) of each trial at z = 0 of the linear model.

    With W the inverse covariance of all data and a = W y, the trials kept aside (k) differ from what all others predict
    by W_kk⁻¹ a_k with covariance W_kk⁻¹. Source: Rasmussen and Williams (2006), 5.4.2.

    Parameters
    ----------
    residuals : at z = 0 of the linear model, of each trial
    """
    mean, total = marginal.mean(residuals), 0.0
    sessions = sorted(marginal.roots)
    numbers = range(len(marginal.blocks))
    kinds = [[k for k in numbers if marginal.blocks[k].session == s] for s in sessions]
    if len(sessions) == 1:
        kinds = [[k] for k in numbers]
    for aside in kinds:
        mine = marginal.columns_of(marginal.blocks[aside[0]].session)
        log_root, backs, pulls = 0.0, [], []
        for k in aside:
            lower, x = marginal.white[k]
            log_root -= float(np.log(np.diag(lower)).sum())
            backs.append(x)
            pulls.append(solve_triangular(lower, residuals[k], lower=True) - x @ mean[mine])
        inner = marginal.covariance[np.ix_(mine, mine)]
        total += log_root + _log_density(np.vstack(backs), np.concatenate(pulls), inner)
    return total


def _log_density(back: Array, left: Array, covariance: Array) -> float:
    """Log density, but for a constant, of n whitened rows kept aside: ``left`` (n,) these rows less what the fit to all
    data explains, ``back`` (n, q) their columns, ``covariance`` (q, q) of the columns given all data."""
    inside = np.linalg.inv(covariance) - back.T @ back  # the precision without the strokes kept aside
    inside = 0.5 * (inside + inside.T)
    factor = cho_factor(inside)
    # W_kk⁻¹ = 1 + back inside⁻¹ backᵀ, in whitened rows
    square = float(left @ left) + float((back.T @ left) @ cho_solve(factor, back.T @ left))
    log_det = float(np.linalg.slogdet(covariance)[1]) + 2.0 * float(np.log(np.diag(factor[0])).sum())
    return 0.5 * (log_det - square)


class OwnModes:
    """Most probable random effects of trials at parameters z.

    Given z and all that trials share, trials are independent: the cost of one is twice the negative log density of its
    residual and of what it has of its own, but for a constant. Source: Lindstrom and Bates (1990), penalised least
    squares.

    Parameters
    ----------
    marginal : Marginal
    residuals : at z = 0 of the linear model, of each trial, as if none had anything of its own
    z : (p,)

    Attributes
    ----------
    most : most probable of each trial, by the linear model
    prior : twice the negative log density of all that trials share beside z, but for a constant
    """

    def __init__(self, marginal: Marginal, residuals: Sequence[Array], z: Array) -> None:
        self.marginal, p = marginal, marginal.p
        there = [r - b.moved @ z for r, b in zip(residuals, marginal.blocks, strict=True)]
        rest = np.zeros(marginal.q)
        rest[p:] = cho_solve(marginal.rest, marginal.projected(there)[0][p:])
        self.scatter, self.prior = marginal.sizes.scatter, float(rest @ rest)
        self.shared: list[Array] = []
        self.most: list[Own] = []
        for (lower, x), b, r in zip(marginal.white, marginal.blocks, there, strict=True):
            mine = x @ rest[marginal.columns_of(b.session)]
            pull = solve_triangular(lower, solve_triangular(lower, r, lower=True) - mine, lower=True, trans=1)
            self.shared.append(lower @ mine)
            laws = self.scatter**2 * (np.hstack([b.moved, b.held]).T @ pull)
            self.most.append(Own(laws, b.own[:, : b.driven].T @ pull))

    def costs(self, residuals: Sequence[Array], own: Sequence[Own]) -> Array:
        """Cost (trials,), twice the negative log density but for a constant, of the residuals (n,) of runs at z with
        the random effects ``own``, and of these, one of each trial."""
        scatters, out = self.scatter > 0.0, []
        for lower, shared, r, o in zip(self._own_roots, self.shared, residuals, own, strict=True):
            white = solve_triangular(lower, r - shared, lower=True)
            prior = o.laws[scatters] / self.scatter[scatters]
            out.append(float(white @ white + prior @ prior + o.drive @ o.drive))
        return np.array(out)

    @cached_property
    def _own_roots(self) -> list[Array]:
        """Cholesky root (n, n) of the covariance of each trial's residual given its laws and drive: sensor noise,
        smooth deviation, zeros of its sensors."""
        size, out = np.exp(self.marginal.sizes.log()), []
        for b, part in zip(self.marginal.blocks, self.marginal.parts[1], strict=True):
            laws = law_columns(b, self.marginal.sizes).shape[1]
            wander = part.columns[:, laws:] * size[part.component[laws:]]
            zeros = b.own[:, b.driven :]
            out.append(cholesky(np.diag(b.white) + wander @ wander.T + zeros @ zeros.T, lower=True))
        return out


LEAST_DAMPING, MARQUARDT = 0.03, 10.0  # of the curvature's diagonal; factor to the next one


def box_step(marginal: Marginal, here: Sequence[Array], z: Array, box: tuple[Array, Array], damping: float) -> Array:
    """Step (p,) from z to the linear model's minimum within ``box``, lowest and highest z (p,) each; ``here``:
    residuals (n,) of each trial at z; ``damping`` times the curvature's diagonal is added to it (Marquardt)."""
    low, high = box
    slope, curvature = marginal.slope(here, z), marginal.curvature
    damped = curvature + damping * np.diag(np.diag(curvature))
    free, step = np.ones(z.size, dtype=bool), np.zeros(z.size)
    for _ in range(z.size):  # each round holds one more value at the end of what is allowed
        rest = slope[free] - damped[np.ix_(free, ~free)] @ step[~free]
        step[free] = np.linalg.solve(damped[np.ix_(free, free)], rest)
        out = free & ((z + step < low) | (z + step > high))
        if not out.any():
            break
        step[out] = np.clip(z + step, low, high)[out] - z[out]
        free &= ~out
    return np.clip(z + step, low, high) - z


def find_largest_step(
    marginal: Marginal, here: Sequence[Array], z: Array, box: tuple[Array, Array], watched: NDArray[np.intp]
) -> float:
    """Largest change of what is watched in the whole step from z, in its posterior standard uncertainties."""
    return float(np.max((np.abs(box_step(marginal, here, z, box, 0.0)) / marginal.width)[watched]))


def list_dampings(last: float) -> list[float]:
    """Dampings to try in turn."""
    first = max(last, LEAST_DAMPING)
    return [last] + [first * MARQUARDT**k for k in range(0 if last < LEAST_DAMPING else 1, 5)]


LONGEST = 1.5  # step of a logarithm
RISEN = 0.1  # of the log likelihood or posterior: a gain that ends an iteration
DAMPINGS = (0.0, *(MARQUARDT**k for k in (-1, 0, 1)))


@dataclass(frozen=True)
class Scores:
    """First and second derivatives of the negative log likelihood with respect to logarithms of sizes."""

    slope: Array  # (k,); 0 where no residuals were given
    information: Array  # (k, k) expected second derivatives
    shares: Array  # (p, k) share of each size in the variance of each z


def scores(marginal: Marginal, residuals: Sequence[Array] | None = None) -> Scores:
    """Slope, expected information and share in each parameter's variance, of the negative log likelihood by the
    logarithms of the variance components of ``marginal``; ``residuals`` at z = 0 of the linear model, without which the
    slope is 0."""
    log = marginal.sizes.log()
    variance, p = np.exp(2.0 * log), marginal.p
    slope, information, shares = np.zeros(log.size), np.zeros((log.size, log.size)), np.zeros((p, log.size))
    mean = None if residuals is None else marginal.mean(residuals)
    common, own = marginal.parts
    of_session = {s: _Sum(len(root), p) for s, root in marginal.roots.items()}
    towards = np.zeros((p, len(log)))  # of the laws' own scatter, summed over trials before it is squared
    for k, (b, (lower, x)) in enumerate(zip(marginal.blocks, marginal.white, strict=True)):
        mine = marginal.columns_of(b.session)
        root = solve_lower(lower, np.eye(len(lower)))
        inverse, back = root.T @ root, root.T @ x
        total = of_session[b.session]
        weight = inverse - back @ marginal.covariance[np.ix_(mine, mine)] @ back.T
        pull = back @ marginal.covariance[mine, :p]
        left = np.zeros(len(lower))
        if residuals is not None and mean is not None:
            left = inverse @ residuals[k] - back @ mean[mine]
        _add_scores(slope, information, variance, own[k], weight, left if residuals is not None else None)
        towards += _sum_squares(own[k], pull, log.size)
        laws = law_columns(b, marginal.sizes)
        half = inverse @ laws
        both = np.block([[laws.T @ half, half.T], [half, inverse]])
        total.add(both, *(np.concatenate([laws.T @ v, v]) for v in (back, pull, left)))
    for s, total in of_session.items():
        mine = marginal.columns_of(s)
        weight = total.inverse - total.back @ marginal.covariance[np.ix_(mine, mine)] @ total.back.T
        _add_scores(slope, information, variance, common[s], weight, total.left if residuals is not None else None)
        towards += _sum_squares(common[s], total.pull, log.size)
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


def _sum_squares(part: RandomEffectColumns, pull: Array, sizes: int) -> Array:
    """Sum of squares (p, k) of what each size's columns do to each z."""
    out = np.zeros((sizes, pull.shape[1]))
    np.add.at(out, part.component, (part.columns.T @ pull) ** 2)
    return out.T


def _add_scores(
    slope: Array, information: Array, variance: Array, part: RandomEffectColumns, weight: Array, left: Array | None
) -> None:
    """Add what one independent part says of its variance components to ``slope`` (k,) and ``information`` (k, k) in
    place: ``variance`` (k,) by component, ``weight`` (n, n) the projected precision, ``left`` (n,) that times the data;
    no slope without."""
    for k, (i, rows, columns) in enumerate(part.component_blocks):
        for j, others, more in part.component_blocks[: k + 1]:
            across = columns.T @ weight[rows, others] @ more
            found = 2.0 * variance[i] * variance[j] * float(np.vdot(across, across))
            information[i, j] += found
            information[j, i] += found * (i != j)
        if left is not None:  # the last across is of the part with itself
            slope[i] += variance[i] * float(np.trace(across) - np.sum((columns.T @ left[rows]) ** 2))


def learn(
    blocks: Sequence[Block], residuals: Sequence[Array], sizes: Sizes, rounds: int, floor: float = FLOOR
) -> Marginal:
    """Marginal model with variance components estimated (REML) from ``sizes`` in at most ``rounds`` scoring steps, none
    of the discrepancy below ``floor``; residuals at z = 0 of the linear model."""
    parts = make_parts(blocks, sizes)
    marginal = Marginal(blocks, sizes.at_least(floor), parts)
    for _ in range(rounds):
        before = marginal.log_evidence(residuals)
        taken = _take_step(marginal, residuals, floor)
        if taken is None:
            break
        # what is believed of the part that is like laws has moved with the others: compare under what is believed now
        risen = taken.log_evidence(residuals) - before
        marginal = taken
        if abs(risen) < RISEN:
            break
    return marginal


def _take_step(marginal: Marginal, residuals: Sequence[Array], floor: float) -> Marginal | None:
    """Marginal model after the least damped scoring step that raises the posterior of the variance components; None
    where none does."""
    found, log = scores(marginal, residuals), marginal.sizes.log()
    middle, spread = marginal.sizes.log_prior_moments()
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


def select_noise_model(
    blocks: Sequence[Block],
    residuals: Sequence[Array],
    sizes: Sizes,
    rounds: int,
    anew: bool = True,
    floor: float = FLOOR,
) -> Marginal:
    """Marginal model with the likelier variance components of two, learnt from ``sizes`` and, if ``anew``, from next to
    no discrepancy; with several sessions, discrepancy as large as predicts left-out ones best; none of it below
    ``floor``.

    Where there are several kinds of strokes, its discrepancy as a whole is then as large as predicts those of a kind
    that is kept aside best. With one kind that says nothing: the other trials tell the discrepancy, whatever its size.
    """
    seen = (sizes.own > NOT_SEEN).astype(float)
    starts = [sizes, *([Sizes.tight(sizes.families, seen)] if anew else [])]
    learnt = [learn(blocks, residuals, start, rounds, floor) for start in starts]
    best = max(learnt, key=lambda m: m.log_evidence(residuals))
    if len(best.roots) == 1:
        return best
    score = held_out_score(best, residuals)
    for factor in GROWN:
        other = Marginal(blocks, best.sizes.grown(factor).at_least(floor), best.parts)
        found = held_out_score(other, residuals)
        if found > score + (np.log(ODDS) if factor < 1.0 else 0.0):
            best, score = other, found
    return best
