"""Fits from several starts: whether there is one minimum, and which is the likeliest.

Starts are drawn by a Latin hypercube within one prior standard uncertainty.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.stats import norm, qmc

from validation.conventions import Array
from validation.identification.each_trial import bends, refine
from validation.identification.fit import Fitted, fit
from validation.identification.problem import Columns, Problem

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
