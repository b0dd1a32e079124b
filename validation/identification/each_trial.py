"""The end of a fit: each trial is computed where its own laws and its own force most probably were.

A soft stroke near a fork of its motion does not answer a scatter of 2 % linearly: a linear model around what all
trials share then calls the rest felt or friction, with too small an uncertainty. Each step takes values and what trials
have of their own towards where the linear model wants them, as far as runs of the model agree better there, each
trial by itself; sizes of noise are learnt once every trial is followed. Source: Lindstrom and Bates (1990),
Biometrics 46, 673.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from model.errors import ModelError
from validation.conventions import Array
from validation.identification.blocks import residuals
from validation.identification.fit import CLOSE, LAST_ROUNDS, STALLED, Fitted
from validation.identification.noise import FLOOR, Marginal, OwnModes, box_step, largest_step, learn, likeliest
from validation.identification.problem import Columns, Problem, curves_at, residuals_there
from validation.identification.runs.own import Own, nothing_own, without_own

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
