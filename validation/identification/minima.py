"""Fits from several starts: whether there is one minimum, and which is the likeliest.

Starts are drawn by a Latin hypercube within one prior standard uncertainty.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import norm, qmc

from model.errors import ModelError
from validation.conventions import Array
from validation.identification.blocks import residuals
from validation.identification.fit import CLOSE, LAST_ROUNDS, STALLED, Fitted, fit
from validation.identification.force_runs import Own, nothing_own, without_own
from validation.identification.noise import FLOOR, Marginal, OwnModes, box_step, largest_step, learn, likeliest
from validation.identification.problem import Columns, Problem, curves_at, residuals_there

MOST_STEPS = 15
SHARES = (1.0, 0.5, 0.25, 0.1, 0.03)  # of the way to where the linear model puts values
OWN_SHARES = (1.0, 0.5, 0.25, 0.1, 0.0)  # of each trial's way
BENT, SEEN = 0.1, 0.05  # of a posterior standard uncertainty, of the noise: a bend that is not followed
FOLLOWED = 3.0  # cost of a trial, per datum: above it the model is not yet where the trial was
SAME = 1.0  # of the log likelihood: a step that changes it less, and no value by half its u, is the last
OWN_CLOSE = 0.1  # standard deviations, RMS: what trials have of their own is known where it is that well


@dataclass(frozen=True)
class _Place:
    """Values, what trials have of their own, residuals of runs, the linear model, and each trial's cost per datum."""

    z: Array
    own: list[Own]
    run: list[Array]
    linear: list[Array]
    here: list[Array]
    marginal: Marginal
    costs: Array

    @property
    def evidence(self) -> float:
        """Log likelihood of the linear model."""
        return self.marginal.log_evidence(self.linear)

    @property
    def followed(self) -> bool:
        """Whether the model is where each trial was."""
        return bool(np.max(self.costs) < FOLLOWED)


def refine(problem: Problem, fitted: Fitted, say: Callable[[str], None] | None = None) -> Fitted:
    """The fit, each trial where what it has of its own most probably was.

    A soft stroke near a fork of its motion does not answer a scatter of 2 % linearly: a linear model around what all
    trials share then calls the rest felt or friction, with too small an uncertainty. Each step takes values and what
    trials have of their own towards where the linear model wants them, as far as runs of the model agree better there,
    each trial by itself; sizes of noise are learnt once every trial is followed. Source: Lindstrom and Bates (1990),
    Biometrics 46, 673.

    Parameters
    ----------
    problem : Problem
    fitted : where a fit ended
    say : callable, optional
        Called with a line after each step.

    Returns
    -------
    Fitted
        As it was but not settled where a trial cannot be run.
    """
    columns, box = Columns(problem), problem.box()
    marginal, linear, z = fitted.marginal, fitted.linear, fitted.z
    here = [r - b.moved @ z for r, b in zip(linear, marginal.blocks, strict=True)]
    place = _Place(z, nothing_own(marginal.blocks), here, linear, here, marginal, np.full(len(linear), np.inf))
    converged, steps, asked = False, 0, np.arange(len(problem.unknowns.asked))
    while not converged and steps < MOST_STEPS:
        new = _step(problem, columns, place)
        if new is None:  # a kink: no way on lowers the cost
            converged = place.followed and largest_step(place.marginal, place.here, place.z, box, asked) < STALLED
            break
        steps += 1
        gained, place = new.evidence - place.evidence, new
        largest = largest_step(place.marginal, place.here, place.z, box, problem.watched)
        if say is not None:
            said = f"each trial, step {steps}: log likelihood {gained:+.1f}, largest change left {largest:.2g} u"
            say(f"{said}, cost per datum up to {np.max(place.costs):.2g}")
        still = largest < CLOSE and _known(place) or abs(gained) < SAME and largest < STALLED
        converged = place.followed and still
    if steps == 0:
        return replace(fitted, converged=False)
    return _fitted(problem, fitted, place, steps, converged)


def _step(problem: Problem, columns: Columns, place: _Place) -> _Place | None:
    """As far towards where the linear model wants all as runs agree better; None where they do nowhere."""
    step = box_step(place.marginal, place.here, place.z, problem.box(), 0.0)
    modes = OwnModes(place.marginal, place.linear, place.z)
    before = float(np.sum(modes.costs(place.run, place.own)) + place.z @ place.z)
    for share in SHARES:
        z = place.z + share * step
        way = _on_the_way(problem, place, z)
        if way is not None and float(np.sum(way.costs) + z @ z) < before:
            return _look(columns, z, way, place.marginal)
    return None


@dataclass(frozen=True)
class _Way:
    """Of each trial a place on its way: what it has of its own there, residuals of its run, and its cost."""

    own: list[Own]
    run: list[Array]
    costs: Array


def _on_the_way(problem: Problem, place: _Place, z: Array) -> _Way | None:
    """Of each trial the likeliest place on its way to where the linear model puts it; None where some cannot run."""
    modes = OwnModes(place.marginal, place.linear, z)
    tried = [[a.towards(b, s) for a, b in zip(place.own, modes.most, strict=True)] for s in OWN_SHARES]
    found = problem.response.curves(len(tried) * [z], tried)
    run = [(own, residuals(problem.trials, c)) for own, c in zip(tried, found, strict=True) if c is not None]
    if not run:
        return None
    costs = np.array([modes.costs(r, own) for own, r in run])
    best = [int(i) for i in np.argmin(costs, axis=0)]
    own = [run[i][0][k] for k, i in enumerate(best)]
    return _Way(own, [run[i][1][k] for k, i in enumerate(best)], np.asarray(costs.min(axis=0)))


def _look(columns: Columns, z: Array, way: _Way, before: Marginal) -> _Place | None:
    """The linear model at a place, with sizes as before until every trial is followed; None where it cannot be made."""
    try:
        blocks = columns.blocks(z, way.own)
    except ModelError:
        return None
    here = without_own(blocks, way.run, way.own)
    linear = [r + b.moved @ z for r, b in zip(here, blocks, strict=True)]
    each = way.costs / np.array([r.size for r in linear])
    followed = bool(np.max(each) < FOLLOWED)
    marginal = learn(blocks, linear, before.sizes, LAST_ROUNDS, FLOOR) if followed else Marginal(blocks, before.sizes)
    return _Place(z, way.own, way.run, linear, here, marginal, each)


def bends(problem: Problem, fitted: Fitted) -> bool:
    """Whether what trials have of their own bends the model so far that a value or the noise shows it."""
    marginal, own = fitted.marginal, OwnModes(fitted.marginal, fitted.linear, fitted.z).most
    curves = curves_at(problem, fitted.z, own)
    if curves is None:
        return True
    here = residuals_there(problem, marginal.blocks, curves, own)
    bent = [h + b.moved @ fitted.z - r for h, b, r in zip(here, marginal.blocks, fitted.linear, strict=True)]
    away = marginal.mean(bent)[: marginal.p] / np.sqrt(np.diag(marginal.covariance)[: marginal.p])
    seen = marginal.projected(bent)[1] > SEEN * sum(r.size for r in bent)
    return bool(seen or np.max(np.abs(away[problem.watched])) > BENT)


def _known(place: _Place) -> bool:
    """Whether each trial is where what it has of its own most probably is."""
    scatter, most = place.marginal.sizes.scatter, OwnModes(place.marginal, place.linear, place.z).most
    return max(a.apart(b, scatter) for a, b in zip(place.own, most, strict=True)) < OWN_CLOSE


def _fitted(problem: Problem, before: Fitted, place: _Place, steps: int, converged: bool) -> Fitted:
    """Where it ended, with the likeliest sizes of noise."""
    marginal = likeliest(place.marginal.blocks, place.linear, place.marginal.sizes, LAST_ROUNDS)
    z, box = place.z, problem.box()
    asked = np.arange(len(problem.unknowns.asked))
    curves = curves_at(problem, z)
    return replace(
        before,
        z=z,
        curves=before.curves if curves is None else curves,
        marginal=marginal,
        linear=place.linear,
        objective=marginal.objective(place.here, z),
        steps=before.steps + steps,
        converged=converged and largest_step(marginal, place.here, z, box, asked) < STALLED,
        own=place.own,
        before=before.badness,
    )


START_SEED = 125


def search(problem: Problem, n: int, say: Callable[[str], None] | None, columns: Columns | None) -> list[Fitted]:
    """Fits from several starts, the likeliest first.

    Where the discrepancy explains what a parameter should, a fit ends in a wrong minimum. So once the linear model is
    near enough and something seems to be lacking, it goes on as if the model lacked nothing; only where that does not
    settle, or is less likely, it goes on from there as it was. A fit that still has not settled, or leaves a
    discrepancy, is followed by one from where it ended and one from the action's values, which take the model to lack
    nothing, too. The likeliest goes on with each trial where its own laws and force were (`each_trial`).

    Parameters
    ----------
    problem : Problem
    n : how many points of `starts` to start from in any case
    say : called with a line after each step
    columns : derivatives at the action's values, found already
    """
    points = starts(problem, n)
    fits: list[Fitted] = []
    for k, z in enumerate(points):
        fits += _from(problem, z, say, None if k else columns)
    if n > 1:  # ends are compared, not how far each was left
        fits = [fit(problem, f.z, say) if f.left else f for f in fits]
    last = min(fits, key=_badness)
    best = _ended(problem, last, say)
    if best.own is None:
        fits = [best if f is last else f for f in fits]
    if best.settled or (best.slight and best.own is not None):  # other starts do not help at a fork of a trial
        return [best, *_others(fits, best)]
    fits = [fit(problem, f.z, say) if f.left else f for f in fits]
    for from_there in (True, False):
        last = min(fits, key=_badness)
        if last.settled:
            break
        if from_there and any(f.tight and f.converged for f in fits):
            continue  # tried halfway, and it found a minimum of its own
        if say is not None:
            say("once more " + ("from there" if from_there else "from the start") + ", as if the model lacked nothing")
        at, known = (last.z, None) if from_there else (points[0], columns)
        fits.append(fit(problem, at, say, known, tight=True))
    last = min(fits, key=_badness)
    if last.badness < best.alike:
        again = _ended(problem, last, say)
        best = again if again.converged and not best.converged else min(best, again, key=_badness)
    return [best, *_others(fits, best)]


def _from(problem: Problem, start: Array, say: Callable[[str], None] | None, columns: Columns | None) -> list[Fitted]:
    """Fits from one start: one, or where the discrepancy explains something halfway, all that were made from there."""
    columns = Columns(problem) if columns is None else columns
    found = fit(problem, start, say, columns, leave=True)
    if not found.left or found.slight:
        return [found]
    if say is not None:
        say("on from there as if the model lacked nothing")
    tight = fit(problem, found.z, say, columns, tight=True, leave=True)
    if (tight.left or tight.converged) and tight.slight and tight.badness < found.badness:
        return [tight]
    if say is not None:
        say("on from where it was")
    whole = fit(problem, found.z, say, columns)
    return [whole] if tight.left else [tight, whole]


def _ended(problem: Problem, found: Fitted, say: Callable[[str], None] | None) -> Fitted:
    """The fit with each trial where it was; settled as it is where that changes nothing beside what the model lacks."""
    if not found.slight or not bends(problem, found):
        return fit(problem, found.z, say) if found.left else found
    return refine(problem, found, say)


def _badness(found: Fitted) -> float:
    return found.badness


def _others(fits: Sequence[Fitted], best: Fitted) -> list[Fitted]:
    """All ends but the one that the best went on from, the likeliest first."""
    return sorted((f for f in fits if f.badness != best.alike and not f.left), key=_badness)


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
