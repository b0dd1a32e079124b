"""The search for causes: score test of all, alone and in pairs, and refits of the best by runs of the model.

A cause is asked for only where the score test exceeds its Monte Carlo threshold. Causes are run at some amounts, the
likeliest are refitted by Gauss–Newton, and compared by their posterior. Beside the best one the model is linearised
again: where the score test still exceeds its threshold, a second cause is asked for in the same way.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from validation.conventions import Array
from validation.infer.blocks import make_blocks
from validation.infer.causes.responses import Point, Responses
from validation.infer.causes.score_test import LEVEL, PAIRED, BalancedNoise, ScoreTest, Threshold, helmert
from validation.infer.channels import FORCE_LEVEL
from validation.infer.fit import BACKTRACK, CLOSE
from validation.infer.hypotheses import ALL, LEAST_ADDED, SMALL_STEP, TREND, Source, known_root
from validation.infer.noise import law_family
from validation.infer.observations import ENCODERS

REFITTED = 12  # causes, and then pairs, that are refitted: the likeliest after a first run or two steps
SECOND = 2  # best single causes beside which a second one is looked for
RUNS = 128  # draws of the scatter between trials that are run: for the curvature around each fit, and the threshold
MORE_RUNS, CLEAR = 896, 10.0  # further draws for a threshold, but where it is exceeded so many times
ROUNDS = 12  # of Gauss–Newton, at most
FELTS = 4  # whose hereditary laws are tried, those whose damping shows most: each compiles a scene of its own
AMOUNTS = (0.5, 1.0, 2.0)  # at which causes are first run: effects, of what their files state
LARGE = tuple(sign * z for z in AMOUNTS for sign in (-1.0, 1.0))  # values of the model, of `Source.wrong`
LEVELS = tuple(2.0 * z for z in LARGE)  # and the force's level, as its preload chooses the rest that is run from
MISSED = 0.5 * LEVEL  # posterior probability of the causes and pairs beyond those named
LEAST_STEP = 0.02  # amount: derivatives are differences over one standard uncertainty, which runs resolve from here on
NEAR, CLIMBED = 50.0, 2  # of the log posterior: fits so near the best that they climb on; steps of each
MOVED = 3  # times, at most, that the noise is linearised around another best fit
DAMPING = ".normal.D"


@dataclass(frozen=True)
class Fit:
    """Causes where they are most probable."""

    members: tuple[int, ...]  # candidates, by index
    z: Array  # (k,) amounts
    each: Array  # (trials, n) residuals there
    columns: Array  # (trials, n, k) derivatives of the predicted curves there
    log_posterior: float = -math.inf

    @property
    def point(self) -> Point:
        """Where the model is run."""
        return Point(tuple(sorted(zip(self.members, map(float, self.z), strict=True))))


class Search:
    """The linear model around one fit."""

    columns: Array  # (n, p) derivatives of the predicted curve with respect to each source
    curved: Array  # (draws, n) changes of the curves of trials that scatter, less those of the linear model

    def __init__(
        self, responses: Responses, at: Fit, effects: Sequence[int] = (), before: Search | None = None
    ) -> None:
        self.responses, self.at, self.effects = responses, at, effects
        listed, trials = responses.listed, responses.trials
        if at.members:
            (exact,) = responses.exact_differences([at.point])
            at = at if exact is None else replace(at, each=exact)
            self.at = at
        wanted = [j for j, s in enumerate(listed) if not s.added or j in effects]
        laws, scatter = np.array([s.law for s in listed]), np.array([s.scatter for s in listed])
        families = np.array([law_family(s.paths[0]) if s.law else -1 for s in listed])
        blocks, tangents = [], []
        for t, share in self._conditions():
            columns = np.zeros((at.each.shape[1], len(listed)))
            longest = before.difference_steps()[wanted] if before is not None and at.members else ()
            found = responses.columns([(at.point, t, j) for j in wanted], len(wanted) * [at.each], longest)
            columns[:, wanted] = np.column_stack(found)
            shaped = np.moveaxis(columns.reshape(len(ENCODERS), -1, len(listed)), 0, 1)
            (block,) = make_blocks([trials[t]], [shaped], [responses.force_columns(at.point, t, at.each)], laws)
            blocks.append((share, block))
            tangents.append(columns)
        self.columns, self._tangents, self._turn = tangents[0], tangents, helmert(len(trials))
        if before is None or at.point != before.at.point:
            self.curved = self._draw_curvature(RUNS)
        else:
            self.curved = before.curved
        known = known_root(responses.tested.action, listed)
        between = np.where(laws, 0.0, scatter)
        self.noise = BalancedNoise(blocks, families, between, known, len(trials), self.curved)
        shown = [i for i, c in enumerate(responses.candidates) if np.any(self.columns[:, c.source])]
        if before is None:
            self.alike = self._group_alike(shown)
        else:
            new = {i: dict[int, float]() for i in shown if self.source(i).added}
            self.alike = {i: {} for i in self.at.members} | new | before.alike
        self.named = sorted(self.alike)
        self.test = ScoreTest(self.noise, self.columns, [responses.candidates[i] for i in self.named])

    def difference_steps(self) -> Array:
        """Standard uncertainty (p,) of each source's amount if all else is known: its longest step for a derivative.

        Over a longer one the response of an impact bends. An effect bends where it comes in: its step is its own.
        """
        added = np.array([s.added for s in self.responses.listed])
        return np.where(added, np.inf, np.clip(self.test.known_u(0), LEAST_STEP, SMALL_STEP))

    def _draw_scatter(self, count: int, seed: int) -> Array:
        """Amounts (count, p) by which the laws and lengths of trials scatter; which effects are listed does not change
        them."""
        scatter = np.array([s.scatter for s in self.responses.listed])
        moved = np.flatnonzero(scatter)
        amounts = np.zeros((count, scatter.size))
        amounts[:, moved] = scatter[moved] * np.random.default_rng(seed).standard_normal((count, moved.size))
        return amounts

    def draw_runs(self, count: int, seed: int) -> Array:
        """Changes (count, n), rad, of the curves of trials whose laws and lengths scatter, each of the next trial in
        turn, as run."""
        return self.responses.curve_changes(self._draw_scatter(count, seed), self.at.each, self.at.point)

    def _draw_curvature(self, count: int) -> Array:
        """Changes of `draw_runs` (count, n), rad, less those by the tangent of the condition nearest to the trial's."""
        weights = np.array([self.responses.candidates[i].weights for i in self.at.members]).reshape(-1, len(self._turn))
        known = weights[:, [t for t, _ in self._conditions()]]
        nearest = np.argmin(np.sum((weights[:, :, None] - known[:, None]) ** 2, axis=0), axis=1)
        amounts = self._draw_scatter(count, seed=0)
        linear = [self._tangents[nearest[k % nearest.size]] @ z for k, z in enumerate(amounts)]
        return self.draw_runs(count, seed=0) - np.array(linear)

    def find_threshold(self, runs: Array) -> Threshold:
        """Thresholds of one cause and of a pair under the null hypothesis, of which trials scatter as ``runs``, drawn
        by `draw_runs`."""
        return self.test.find_threshold(self.turned(self.at.each), runs)

    def _conditions(self) -> list[tuple[int, float]]:
        """Trials to linearise, (index, share of all trials that it represents): those with least and most of the causes
        of the fit; the first alone where all trials have them alike."""
        weights = [self.responses.candidates[i].weights for i in self.at.members]
        weights = [w for w in weights if np.ptp(w)]
        if not weights:
            return [(0, 1.0)]
        most = np.max(np.abs(weights), axis=0)
        share = float(np.mean(most) / np.max(most))
        return [(int(np.argmin(most)), 1.0 - share), (int(np.argmax(most)), share)]

    def _group_alike(self, shown: Sequence[int]) -> dict[int, dict[int, float]]:
        """Detectable candidates (index) of those ``shown``, each -> indices of those indistinguishable from it, with
        the amount that equals amount 1 of it; derivatives are central differences of runs of the first trial."""
        wanted = sorted({self.responses.candidates[i].source for i in shown})
        if not wanted:
            return {}
        columns = np.zeros_like(self.columns)
        asked = [(self.at.point, 0, j) for j in wanted]
        columns[:, wanted] = np.column_stack(self.responses.columns(asked, len(wanted) * [self.at.each], central=True))
        test = ScoreTest(self.noise, columns, [self.responses.candidates[i] for i in shown])
        k = self.log_posterior(self.at.each, self.at.z)[1]
        groups = test.group_alike(k, np.array([self.source(i).furthest for i in shown]))
        return {shown[i]: {shown[j]: amount for j, amount in group.items()} for i, group in groups.items()}

    def with_effects(self) -> Search:
        """New search around the same fit with effects that the model lacks among its causes; hereditary laws only of
        the `FELTS` felts whose damping changes the curves most."""
        listed = self.responses.listed
        size = np.sum(self.columns**2, axis=0)
        damping = {s.name.removesuffix(DAMPING): size[j] for j, s in enumerate(listed) if s.name.endswith(DAMPING)}
        felts = sorted(damping, key=lambda felt: -damping[felt])[:FELTS]
        effects = [j for j, s in enumerate(listed) if s.added and all(felt in felts for felt, _ in s.laws)]
        return Search(self.responses, self.at, effects, self)

    def source(self, i: int) -> Source:
        """Source of the candidate of this index."""
        return self.responses.listed[self.responses.candidates[i].source]

    def turned(self, each: Array) -> Array:
        """Mean and contrasts of residuals (trials, n)."""
        return np.asarray(self._turn @ each)

    def log_posterior(self, each: Array, z: Array) -> tuple[float, int]:
        """Log posterior of residuals (trials, n) with amounts z at the likeliest of `DEVIATIONS`, and its index."""
        found = self.noise.log_likelihoods(self.turned(each))
        k = int(np.argmax(found))
        return float(found[k] - 0.5 * z @ z), k

    def start_fit(self, members: tuple[int, ...], at: Fit | None = None) -> Fit:
        """Starting fit of the candidates ``members`` (indices), not run: amounts as in the fit ``at`` (the search's own
        by default), 0 of new ones; the effect of its other causes is removed linearly."""
        base = self.at if at is None else at
        z = np.array([base.z[base.members.index(i)] if i in base.members else 0.0 for i in members])
        sources = [self.responses.candidates[i].source for i in members]
        columns = np.broadcast_to(self.columns[:, sources], (len(base.each), *self.columns[:, sources].shape))
        gone = [k for k, i in enumerate(base.members) if i not in members]
        if not gone:
            return Fit(members, z, base.each, columns, self.log_posterior(base.each, z)[0])
        return Fit(members, z, base.each + self.effect(base, gone), columns)

    def effect(self, fit: Fit, places: Sequence[int]) -> Array:
        """Change (trials, n), rad, of the predicted curves by the fit's causes of these indices, linear at the fit."""
        amounts = self.trial_amounts(fit)[:, places]
        return np.asarray(np.einsum("tk,tnk->tn", amounts, fit.columns[:, :, places]))

    def trial_amounts(self, fit: Fit, slope: bool = False) -> Array:
        """Amount (trials, k) of each cause of a fit that each trial has, or its derivative by the fit's amount."""
        out = []
        for i, z in zip(fit.members, fit.z, strict=True):
            share = self.source(i).share_slope if slope else self.source(i).share
            out.append([share(float(z), w) for w in self.responses.candidates[i].weights])
        return np.array(out).T

    def step(self, fit: Fit) -> Array:
        """Amounts (k,) that the linear model around a fit has as the most probable, within their bounds."""
        k = self.log_posterior(fit.each, fit.z)[1]
        white, residual = self.whitened(fit, k)
        precision = np.eye(fit.z.size) + white.T @ white
        z = np.linalg.solve(precision, white.T @ (residual + white @ fit.z))
        return np.clip(z, *self.bounds(fit.members))

    def whitened(self, fit: Fit, k: int) -> tuple[Array, Array]:
        """Columns (trials n, causes) and residuals (trials n,) of a fit, whitened with `DEVIATIONS[k]`."""
        columns = np.einsum("jt,tk,tnk->jnk", self._turn, self.trial_amounts(fit, slope=True), fit.columns)
        residual = self.noise.whiten(k, self.turned(fit.each))
        return self.noise.whiten(k, columns).reshape(-1, fit.z.size), residual.ravel()

    def bounds(self, members: Sequence[int]) -> tuple[Array, Array]:
        """Least and largest amounts."""
        most = np.array([self.source(i).furthest for i in members])
        return np.where([self.source(i).added for i in members], 0.0, -most), most

    def covariance(self, fit: Fit) -> Array:
        """Posterior covariance (k, k) of the amounts."""
        white, _ = self.whitened(fit, self.log_posterior(fit.each, fit.z)[1])
        return np.asarray(np.linalg.inv(np.eye(fit.z.size) + white.T @ white))

    def refit(self, started: Sequence[Fit], rounds: int = ROUNDS, exact: bool = False) -> list[Fit]:
        """Refit each of ``started`` by at most ``rounds`` Gauss–Newton steps of runs (of every trial if ``exact``): the
        fits that ran, sorted by log posterior, without those whose added effect vanished."""
        differences = self.responses.exact_differences if exact else self.responses.differences
        fits = list(started)
        share = {i: 1.0 for i in range(len(fits))}
        for _ in range(rounds):
            proposed: dict[int, Array] = {}
            for i, short in share.items():
                step = self.step(fits[i]) - fits[i].z
                if np.any(np.abs(step) > CLOSE * np.sqrt(np.diag(self.covariance(fits[i])))):
                    proposed[i] = fits[i].z + short * step
            tried, share, accepted = share, {}, []
            points = [replace(fits[i], z=z).point for i, z in proposed.items()]
            for (i, z), each in zip(proposed.items(), differences(points), strict=True):
                there = -math.inf if each is None else self.log_posterior(each, z)[0]
                if each is None or there <= fits[i].log_posterior:
                    share[i] = BACKTRACK * tried[i]
                    continue
                fits[i] = replace(fits[i], z=z, each=each, log_posterior=there)
                accepted.append(i)
                share[i] = 1.0
            for i, columns in zip(accepted, self.columns_at([fits[i] for i in accepted]), strict=True):
                fits[i] = replace(fits[i], columns=columns)
            if not share:
                break
        ran = [f for f in fits if math.isfinite(f.log_posterior)]
        return sorted(self._list_present(ran), key=lambda f: -f.log_posterior)

    def _list_present(self, fits: Sequence[Fit]) -> list[Fit]:
        """The fits without those whose added effect vanished."""
        return [
            f
            for f in fits
            if all(z > LEAST_ADDED or not self.source(i).added for i, z in zip(f.members, f.z, strict=True))
        ]

    def columns_at(self, fits: Sequence[Fit]) -> list[Array]:
        """Derivatives (trials, n, k) of each fit's predicted curves by its k causes, rad per unit amount, by runs: of a
        trend in every trial that has it, else in the trial that has most of it, taken for all.

        Differences are taken over at most one standard uncertainty.
        """
        asked, here, longest, trials = [], [], [], range(self.noise.trials)
        for fit in fits:
            steps = np.maximum(np.sqrt(np.diag(self.covariance(fit))), LEAST_STEP)
            for j, step in zip(fit.members, steps, strict=True):
                c = self.responses.candidates[j]
                seen = [t for t in trials if c.weights[t]] if c.profile == TREND else [c.seen_in]
                asked += [(fit.point, t, c.source) for t in seen]
                here += len(seen) * [fit.each]
                longest += len(seen) * [float(step)]
        found = dict(zip(asked, self.responses.columns(asked, here, longest), strict=True))
        out = []
        for fit in fits:
            of = [self.responses.candidates[j] for j in fit.members]
            at = [
                [found.get((fit.point, t, c.source), found[(fit.point, c.seen_in, c.source)]) for c in of]
                for t in trials
            ]
            out.append(np.moveaxis(np.array(at), 1, 2))
        return out

    def rest(self, fit: Fit, threshold: Threshold) -> float:
        """Largest score statistic of one more cause beside a fit, over its threshold."""
        return float(self.gains(fit, fit.members).max()) / threshold.single

    def evidence(self, fit: Fit) -> float:
        """Natural logarithm of a fit's evidence, but for a constant that all fits of as many causes share: amounts are
        integrated out by Laplace's approximation."""
        return fit.log_posterior + 0.5 * float(np.linalg.slogdet(self.covariance(fit))[1])

    def credible_set(self, fits: Sequence[Fit]) -> list[Fit]:
        """The fewest fits that together have the posterior probability 1 - `MISSED`, the most probable first; all have
        as many causes, equally probable before."""
        evidence = np.array([self.evidence(f) for f in fits])
        order = np.argsort(-evidence, kind="stable")
        share = np.exp(evidence[order] - evidence.max())
        before = (np.cumsum(share) - share) / share.sum()
        return [fits[int(i)] for i in order[before < 1.0 - MISSED]]

    def exchange_causes(self, fits: Sequence[Fit]) -> tuple[Search, list[Fit]]:
        """Linearise anew at the first, best fit, start fits with one of its causes exchanged, and refit all by runs:
        the search there, and its at most `PAIRED` best fits, refitted by runs of every trial, the best first."""
        best = fits[0]
        around = Search(self.responses, best, self.effects, self)
        known = {frozenset(f.members) for f in fits}
        started = []
        for i in best.members:
            kept = tuple(j for j in best.members if j != i)
            for j in around.rank_candidates(around.at, kept)[:PAIRED]:
                if j not in kept and frozenset((*kept, j)) not in known:
                    started.append(around.start_fit((*kept, j)))
        again = [replace(f, log_posterior=around.log_posterior(f.each, f.z)[0]) for f in fits[:PAIRED]]
        every = around.refit([*again, *around.start_effects(started)], rounds=ROUNDS // 2) or list(fits)
        for _ in range(MOVED):
            best = every[0]
            u = np.sqrt(np.diag(around.covariance(best)))
            if best.members != around.at.members or np.any(np.abs(best.z - around.at.z) > u):
                around = Search(self.responses, best, self.effects, self)
            every = around.refit_exactly(every[:PAIRED]) or every
            if every[0].members == around.at.members:
                break
        return around, every

    def refit_exactly(self, fits: Sequence[Fit]) -> list[Fit]:
        """The fits with every trial run, refitted with this search's noise, the best first."""
        fits = self.refit([f for f in self._run_exactly(fits) if math.isfinite(f.log_posterior)], exact=True)
        near = [f for f in fits if f.log_posterior > fits[0].log_posterior - NEAR]
        found = self._list_present([*self.climb(near), *fits[len(near) :]])
        return sorted(found, key=lambda f: -f.log_posterior)

    def climb(self, fits: Sequence[Fit]) -> list[Fit]:
        """Fits, in the same order, moved to larger log posterior by runs of every trial: up to `CLIMBED` times a
        parabola through one standard uncertainty to both sides in each amount, or the best point run, if that is
        better; derivatives are renewed.

        Impacts bend the response within one standard uncertainty, where derivatives of Gauss–Newton mislead.
        """
        out = list(fits)
        for _ in range(CLIMBED):
            steps = [np.diag(np.sqrt(np.diag(self.covariance(f)))) for f in out]
            beside = [
                replace(f, z=np.clip(f.z + sign * h, *self.bounds(f.members)))
                for f, s in zip(out, steps, strict=True)
                for h in s
                for sign in (-1, 1)
            ]
            found = iter(self._run_exactly(beside))
            tried: list[list[Fit]] = []
            for fit, step in zip(out, steps, strict=True):
                pairs = [(next(found), next(found)) for _ in step]
                rise = np.array([[b.log_posterior, a.log_posterior] for b, a in pairs]) - fit.log_posterior
                bend = -np.sum(rise, axis=1)
                known = np.isfinite(bend) & (bend > 0.0)
                rise = np.where(known[:, None], rise, 0.0)
                move = 0.5 * (rise[:, 1] - rise[:, 0]) / np.where(known, bend, 1.0)
                at = np.clip(fit.z + np.clip(move, -2.0, 2.0) * np.diag(step), *self.bounds(fit.members))
                tried.append([fit, replace(fit, z=at), *(f for pair in pairs for f in pair)])
            tops = self._run_exactly([group[1] for group in tried])
            out = [
                max([group[0], top, *group[2:]], key=lambda f: f.log_posterior)
                for group, top in zip(tried, tops, strict=True)
            ]
        return [replace(f, columns=c) for f, c in zip(out, self.columns_at(out), strict=True)]

    def _run_exactly(self, fits: Sequence[Fit]) -> list[Fit]:
        """Copies of the fits with residuals and log posterior by runs of every trial at their amounts; one that cannot
        be run has the log posterior -inf."""
        out = []
        for fit, each in zip(fits, self.responses.exact_differences([f.point for f in fits]), strict=True):
            if each is None:
                out.append(replace(fit, log_posterior=-math.inf))
            else:
                out.append(replace(fit, each=each, log_posterior=self.log_posterior(each, fit.z)[0]))
        return out

    def pairs(self, singles: Sequence[Fit]) -> list[Fit]:
        """Starting fits of two causes, not refitted: each of the `SECOND` best of ``singles`` (fits of one cause, the
        best first) with the candidates that gain most beside it, and with the other best ones; the best also with
        values of the model at some amounts, the `REFITTED` likeliest of them."""
        started: dict[frozenset[int], Fit] = {}
        for one in singles[:SECOND]:
            for i in [
                *self.rank_candidates(one, one.members)[:REFITTED],
                *(f.members[0] for f in singles[: REFITTED // 2]),
            ]:
                if i not in one.members:
                    started.setdefault(frozenset((*one.members, i)), self.start_fit((*one.members, i), one))
        best = singles[0]
        beside = [i for i in self._list_shared(added=False) if not self.source(i).error and i not in best.members]
        moved = self._try_amounts([self.start_fit((*best.members, i), best) for i in beside], LARGE)
        return [*self.start_effects(list(started.values())), *self.choose_likeliest(moved)]

    def rank_candidates(self, fit: Fit, held: Sequence[int]) -> list[int]:
        """Candidates (indexes) by their gain beside the ``held`` ones of a fit, the largest first."""
        return [self.named[int(i)] for i in np.argsort(-self.gains(fit, held), kind="stable")]

    def gains(self, fit: Fit, held: Sequence[int]) -> Array:
        """Score statistic (P,) of the candidates `named` beside the causes ``held`` (candidate indices) of a fit, its
        others removed linearly."""
        gone = [k for k, i in enumerate(fit.members) if i not in held]
        kept = [k for k, i in enumerate(fit.members) if i in held]
        each = fit.each + self.effect(fit, gone) if gone else fit.each
        return self.test.gains(self.turned(each), [self.named.index(fit.members[k]) for k in kept], fit.z[kept])[0]

    def is_exceeded(self, threshold: Threshold, times: float = 1.0) -> bool:
        """Whether one cause or a pair gains more than its threshold, so many times."""
        single, pair = self.test.statistics(self.turned(self.at.each))
        return single > times * threshold.single or pair > times * threshold.pair

    def first_round(self) -> list[Fit]:
        """Fits of one cause each, the `REFITTED` best, best first: after one Gauss–Newton step, or at the likeliest of
        some amounts, where that is better. Every source in all trials, those that gain most as only some trials may
        have them, and every added effect."""
        partial: dict[int, int] = {}
        for i in self.rank_candidates(self.at, self.at.members):
            candidate = self.responses.candidates[i]
            if candidate.profile != ALL:
                partial.setdefault(candidate.source, i)
        shared, added = self._list_shared(added=False), self._list_shared(added=True)
        started = [self.start_fit((i,)) for i in (*shared, *list(partial.values())[: 2 * REFITTED])]
        stepped = self.refit(started, rounds=1)
        moved = self._try_amounts([f for f in started if not self.source(f.members[0]).error], LARGE)
        levels = [self.start_fit((i,)) for i in self.named if self.source(i).name == FORCE_LEVEL]
        moved += self._try_amounts(levels, LEVELS)
        effects = self.refit(self.start_effects([self.start_fit((i,)) for i in added]), rounds=1)
        return self.choose_likeliest([*stepped, *moved, *effects])

    def choose_likeliest(self, fits: Sequence[Fit]) -> list[Fit]:
        """The `REFITTED` fits of other causes with the largest log posterior, the best first, with their derivatives
        there."""
        likeliest: dict[frozenset[int], Fit] = {}
        for fit in sorted(fits, key=lambda f: -f.log_posterior):
            likeliest.setdefault(frozenset(fit.members), fit)
        chosen = list(likeliest.values())[:REFITTED]
        return [replace(f, columns=c) for f, c in zip(chosen, self.columns_at(chosen), strict=True)]

    def _list_shared(self, added: bool) -> list[int]:
        """Candidates `named` (indices) that all trials have: effects that the model lacks, or all others."""
        shared = [i for i in self.named if self.responses.candidates[i].profile == ALL]
        return [i for i in shared if self.source(i).added == added]

    def _try_amounts(self, fits: Sequence[Fit], amounts: Sequence[float]) -> list[Fit]:
        """Fits run with the last of their causes at each of the amounts; those that can be run."""
        tried = [replace(fit, z=np.append(fit.z[:-1], z)) for fit in fits for z in amounts]
        found = zip(tried, self.responses.differences([f.point for f in tried]), strict=True)
        return [replace(f, each=e, log_posterior=self.log_posterior(e, f.z)[0]) for f, e in found if e is not None]

    def refit_alike(self, fits: Sequence[Fit]) -> list[Fit]:
        """The fits, and refits by runs of every trial with one cause exchanged for an indistinguishable one, or begun
        at other amounts of an effect, together sorted by log posterior, the best first.

        A felt with memory loses as much at two relaxation times, below and above the stroke's own.
        """
        started, again = [], []
        for fit in fits:
            for place, i in enumerate(fit.members):
                for other, amount in self.alike.get(i, {}).items():
                    members = tuple(other if j == i else j for j in fit.members)
                    factor = np.where(np.array(fit.members) == i, amount, 1.0)
                    started.append(replace(fit, members=members, z=factor * fit.z, columns=fit.columns / factor))
                if self.source(i).added:
                    again += [replace(fit, z=np.where(np.arange(fit.z.size) == place, a, fit.z)) for a in AMOUNTS]
        ran = [f for f in self._run_exactly(again) if math.isfinite(f.log_posterior)]
        started += [replace(f, columns=c) for f, c in zip(ran, self.columns_at(ran), strict=True)]
        out: list[Fit] = []
        for fit in sorted([*fits, *self.refit_exactly(started)], key=lambda f: -f.log_posterior):
            if not any(self._is_same(fit, other) for other in out):
                out.append(fit)
        return out

    def _is_same(self, fit: Fit, other: Fit) -> bool:
        """Whether two fits have the same causes, of amounts within two of the larger standard uncertainties."""
        if fit.members != other.members:
            return False
        u = np.sqrt(np.maximum(np.diag(self.covariance(fit)), np.diag(self.covariance(other))))
        return bool(np.all(np.abs(fit.z - other.z) < 2.0 * u))

    def start_effects(self, fits: Sequence[Fit]) -> list[Fit]:
        """The fits, those with an added effect of amount 0 run with it at each of `AMOUNTS` and replaced by the
        likeliest (its derivative at 0 says little). The order changes; a fit that cannot be run so is dropped."""
        tried: list[tuple[int, Fit]] = []
        for n, fit in enumerate(fits):
            absent = [self.source(i).added and z == 0.0 for i, z in zip(fit.members, fit.z, strict=True)]
            if any(absent):
                tried += [(n, replace(fit, z=np.where(absent, amount, fit.z))) for amount in AMOUNTS]
        out = dict(enumerate(fits)) if not tried else {n: f for n, f in enumerate(fits) if n not in dict(tried)}
        for (n, fit), each in zip(tried, self.responses.differences([f.point for _, f in tried]), strict=True):
            if each is None:
                continue
            found = replace(fit, each=each, log_posterior=self.log_posterior(each, fit.z)[0])
            if n not in out or found.log_posterior > out[n].log_posterior:
                out[n] = found
        return list(out.values())


@dataclass(frozen=True)
class Found:
    """What a search found."""

    fits: tuple[Fit, ...] = ()  # causes, or pairs of them, that the trials cannot tell apart, the best first
    exceeds: bool = False  # whether the difference exceeds its null distribution
    search: Search | None = None  # around the best, or near it; None where the model cannot run
    left: float = 0.0  # score statistic of one more cause beside the best, over its threshold


def find_causes(responses: Responses, effects: bool = True) -> Found:
    """Search for one or two causes of measured less predicted angles, tested by a Monte Carlo threshold and refitted by
    runs; ``effects``: try those that the model lacks, too. `Found` is empty where the model cannot run or a trial
    stands still.

    Parameters
    ----------
    responses : the model in all trials
    effects : whether effects that the model lacks are among the causes
    """
    base = responses.base
    if base is None or not np.all(np.ptp(responses.measured, axis=1)):
        return Found()
    search = Search(responses, Fit((), np.zeros(0), base, np.zeros((*base.shape, 0))))
    if not search.named:  # the model stands still
        return Found()
    runs = search.draw_runs(RUNS, seed=1)
    threshold = search.find_threshold(runs)
    if search.is_exceeded(threshold) and not search.is_exceeded(threshold, CLEAR):
        threshold = search.find_threshold(np.concatenate([runs, search.draw_runs(MORE_RUNS, seed=2)]))
    if not search.is_exceeded(threshold):
        return Found(search=search)
    if effects:
        search = search.with_effects()
    singles = search.refit(search.first_round())
    if not singles:
        return Found(exceeds=True, search=search)
    around, fits = search.exchange_causes(singles)
    left = around.rest(fits[0], threshold)
    if left > 1.0:
        pairs = around.refit(around.choose_likeliest(around.refit(around.pairs(fits), rounds=2)))
        if pairs and 2.0 * (pairs[0].log_posterior - fits[0].log_posterior) > threshold.single:
            around, fits = around.exchange_causes(pairs)
            alone = around.refit([around.start_fit((i,), fits[0]) for i in fits[0].members])
            if alone and 2.0 * (fits[0].log_posterior - alone[0].log_posterior) <= threshold.single:
                closer, singles = around.exchange_causes(alone)  # from what the pair has right
                if closer.rest(singles[0], threshold) <= 1.0:
                    around, fits = closer, singles
            left = around.rest(fits[0], threshold)
        if 1.0 < left < CLEAR:
            left = around.rest(fits[0], around.find_threshold(around.draw_runs(RUNS + MORE_RUNS, seed=3)))
    fits = around.credible_set(fits)
    if left <= 1.0:
        fits = around.credible_set(around.refit_alike(fits))
    return Found(tuple(fits), True, around, left)
