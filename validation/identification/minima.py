"""Fits from several starts: whether there is one minimum, and which is the likeliest.

Starts are drawn by a Latin hypercube within one prior standard uncertainty.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.stats import norm, qmc

from validation.conventions import Array
from validation.identification.fit import Fitted, fit
from validation.identification.problem import Columns, Problem

START_SEED = 125


def search(problem: Problem, n: int, say: Callable[[str], None] | None, columns: Columns | None) -> list[Fitted]:
    """Fits from several starts, the likeliest first.

    A fit that has not settled, or after which the model seems to lack something, may stand in a wrong minimum where
    the discrepancy explains what a parameter should. It is followed by one from where it ended and one from the
    action's values, both of which take the model to lack nothing until they have settled.

    Parameters
    ----------
    problem : Problem
    n : how many points of `starts` to start from in any case
    say : called with a line after each step
    columns : derivatives at the action's values, found already
    """
    points = starts(problem, n)
    fits = [fit(problem, z, say, None if k else columns) for k, z in enumerate(points)]
    for from_there in (True, False):
        best = min(fits, key=lambda f: f.badness)
        if best.settled:
            break
        if say is not None:
            say("once more " + ("from there" if from_there else "from the start") + ", as if the model lacked nothing")
        at, known = (best.z, None) if from_there else (points[0], columns)
        fits.append(fit(problem, at, say, known, tight=True))
    return sorted(fits, key=lambda f: f.badness)


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
