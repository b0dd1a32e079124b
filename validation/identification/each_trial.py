"""The end of a fit: each trial is computed where its own laws and its own force most probably were.

A soft stroke near a fork of its motion does not answer a scatter of 2 % linearly: a linear model around what all
trials share then calls the rest felt or friction, with too small an uncertainty. Each step takes values and what trials
have of their own to where the linear model wants them, and learns sizes of noise; half the way is gone where the
marginal likelihood falls far. Source: Lindstrom and Bates (1990), Biometrics 46, 673.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from model.errors import ModelError
from validation.conventions import Array
from validation.identification.fit import CLOSE, STALLED, Fitted
from validation.identification.noise import FLOOR, Marginal, box_step, largest_step, learn, likeliest
from validation.identification.problem import Columns, Problem, curves_at, linear_residuals, residuals_there
from validation.identification.runs.own import Own, nothing_own

MOST_STEPS, MOST_HALVES = 10, 3
ROUNDS = 30
BENT, SEEN = 0.1, 0.05  # of a posterior standard uncertainty, of the noise: a bend that is not followed
FALLEN = 100.0  # of the log likelihood: a step after which it is so far below the highest was too long
SAME = 1.0  # of the log likelihood: a step that changes it less, and no value by half its u, is the last
OWN_CLOSE = 0.1  # standard deviations, RMS: what trials have of their own is known where it is that well


@dataclass(frozen=True)
class _Place:
    """Values, what trials have of their own, and the linear model there."""

    z: Array
    own: list[Own]
    linear: list[Array]
    here: list[Array]
    marginal: Marginal
    evidence: float


def refine(problem: Problem, fitted: Fitted, say: Callable[[str], None] | None = None) -> Fitted:
    """The fit, each trial where what it has of its own most probably was.

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
    place = _Place(z, nothing_own(marginal.blocks), linear, here, marginal, marginal.log_evidence(linear))
    best, converged, steps = place, False, 0
    while not converged and steps < MOST_STEPS:
        steps += 1
        new = _step(problem, columns, place, best.evidence - FALLEN)
        if new is None:
            if steps == 1:
                return replace(fitted, converged=False)
            break
        gained, place = new.evidence - place.evidence, new
        best = max(best, place, key=lambda p: p.evidence)
        largest = largest_step(place.marginal, place.here, place.z, box, problem.watched)
        if say is not None:
            say(f"each trial, step {steps}: log likelihood {gained:+.1f}, largest change left {largest:.2g} u")
        converged = largest < CLOSE and _known(place) or abs(gained) < SAME and largest < STALLED
    return _fitted(problem, fitted, place if converged else best, steps, converged)


def _step(problem: Problem, columns: Columns, place: _Place, least: float) -> _Place | None:
    """The longest of some steps after which the log likelihood is at least so high; None where there is none."""
    step = box_step(place.marginal, place.here, place.z, problem.box(), 0.0)
    most = place.marginal.own(place.linear, place.z + step)
    for half in range(MOST_HALVES):
        share = 0.5**half
        own = [a.towards(b, share) for a, b in zip(place.own, most, strict=True)]
        new = _look(problem, columns, place.z + share * step, own, place.marginal)
        if new is not None and new.evidence > least:
            return new
    return None


def bends(problem: Problem, fitted: Fitted) -> bool:
    """Whether what trials have of their own bends the model so far that a value or the noise shows it."""
    marginal, own = fitted.marginal, fitted.marginal.own(fitted.linear, fitted.z)
    curves = curves_at(problem, fitted.z, own)
    if curves is None:
        return True
    here = residuals_there(problem, marginal.blocks, curves, own)
    bent = [h + b.moved @ fitted.z - r for h, b, r in zip(here, marginal.blocks, fitted.linear, strict=True)]
    away = marginal.mean(bent)[: marginal.p] / np.sqrt(np.diag(marginal.covariance)[: marginal.p])
    seen = marginal.projected(bent)[1] > SEEN * sum(r.size for r in bent)
    return bool(seen or np.max(np.abs(away[problem.watched])) > BENT)


def _look(problem: Problem, columns: Columns, z: Array, own: list[Own], before: Marginal) -> _Place | None:
    """The linear model at a place, with sizes learnt from those before; None where a trial cannot run."""
    curves = curves_at(problem, z, own)
    if curves is None:
        return None
    try:
        blocks = columns.blocks(z, own)
    except ModelError:
        return None
    linear = linear_residuals(problem, blocks, curves, z, own)
    marginal = learn(blocks, linear, before.sizes, ROUNDS, FLOOR)
    here = residuals_there(problem, blocks, curves, own)
    return _Place(z, own, linear, here, marginal, marginal.log_evidence(linear))


def _known(place: _Place) -> bool:
    """Whether each trial is where what it has of its own most probably is."""
    scatter, most = place.marginal.sizes.scatter, place.marginal.own(place.linear, place.z)
    return max(a.apart(b, scatter) for a, b in zip(place.own, most, strict=True)) < OWN_CLOSE


def _fitted(problem: Problem, before: Fitted, place: _Place, steps: int, converged: bool) -> Fitted:
    """Where it ended, with the likeliest sizes of noise."""
    marginal = likeliest(place.marginal.blocks, place.linear, place.marginal.sizes, ROUNDS)
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
