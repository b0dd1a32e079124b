"""Each trial's linear model at its own scatter, not at that of all: first-order conditional estimation.

A friction that scatters by 2 % bends a soft or double stroke further than a linear model holds, and twice as far from
one trial as from the next. So what each trial's laws most probably were is estimated, the model and all its columns are
found there, sizes and values anew, until no value moves. Source: Lindstrom and Bates (1990), Biometrics 46, 673.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import replace

import numpy as np
from scipy.linalg import solve_triangular

import model
from model.errors import ModelError
from validation.conventions import Array
from validation.identification.blocks import Block, residuals, rows
from validation.identification.channels.responses import response_to
from validation.identification.fit import LAST_ROUNDS, SLIGHT, STALLED, Fitted, Problem
from validation.identification.model_runs import Response
from validation.identification.noise import Marginal, likeliest
from validation.identification.observations import ObservedTrial
from validation.identification.unknowns.priors import Unknowns
from validation.prediction.elsewhere import spread

ROUNDS = 5
STILL = 0.2  # of a posterior standard uncertainty: values that move by less have been found
BENT = 0.1  # of the same: what the scatter's bend may do to a value before it is followed
SEEN = 0.05  # of the noise: a bend of that size makes the noise of a linear model too large


def responses_of_each(
    action: model.Action,
    unknowns: Unknowns,
    trials: Sequence[ObservedTrial],
    tolerance: float,
    executor: Executor | None = None,
) -> tuple[Response, ...]:
    """The model's response to each trial alone, to all that moves and all fixed laws."""
    parameters = (*unknowns.moved, *unknowns.held)
    return tuple(response_to(action, parameters, [trial], tolerance, executor) for trial in trials)


def own_scatter(marginal: Marginal, linear: Sequence[Array]) -> list[Array]:
    """Most probable scatter (p + h,) of each trial's laws, in prior standard uncertainties; 0 of what is no law.

    Parameters
    ----------
    marginal : Marginal
    linear : residuals at z = 0 of the linear model, of each trial
    """
    mean, scatter = marginal.mean(linear), marginal.sizes.scatter
    out = []
    for (lower, x), block, r in zip(marginal.white, marginal.blocks, linear, strict=True):
        left = solve_triangular(lower, r, lower=True) - x @ mean[marginal.columns_of(block.session)]
        back = solve_triangular(lower, left, lower=True, trans=1)
        out.append(np.asarray(scatter**2 * (np.hstack([block.moved, block.held]).T @ back)))
    return out


def relinearised(
    problem: Problem, fitted: Fitted, each: Sequence[Response], say: Callable[[str], None] | None = None
) -> tuple[Problem, Fitted]:
    """The fit with each trial's model at its own scatter; as it was where that does not bend it.

    Parameters
    ----------
    problem, fitted : where a fit ended; if it has not settled, it must lack next to nothing
    each : as of `responses_of_each`
    say : called with a line after each round

    Returns
    -------
    tuple of Problem and Fitted
        The problem's trials are changed by what their bend adds, so that its residuals at z are those of the fit.
    """
    marginal, linear, z = fitted.marginal, fitted.linear, fitted.z
    wandering = not fitted.converged and float(marginal.sizes.discrepancy.max()) > SLIGHT
    if wandering or not _bends(problem, fitted, each):
        return problem, fitted
    low, high = problem.box()
    watched, moved, done = problem.watched, np.inf, 0
    while moved > STILL and done < ROUNDS:
        found = _there(problem, marginal, each, z, own_scatter(marginal, linear))
        if found is None:  # the model cannot run where a trial seems to have been
            return problem, replace(fitted, converged=False)
        blocks, linear = found
        marginal = likeliest(blocks, linear, marginal.sizes, LAST_ROUNDS, False)
        new = np.clip(marginal.mean(linear)[: marginal.p], low, high)
        u = np.sqrt(np.diag(marginal.covariance)[: marginal.p])
        moved, z, done = float(np.max((np.abs(new - z) / u)[watched])), new, done + 1
        if say is not None:
            say(f"each trial where its own scatter took it, round {done}: largest change {moved:.2g} u")
    curves = problem.response.curves([z])[0]
    if curves is None:
        return problem, replace(fitted, converged=False)
    here = [r - b.moved @ z for r, b in zip(linear, marginal.blocks, strict=True)]
    trials = tuple(
        replace(t, change_rad=np.where(np.isfinite(t.change_rad), c + r.reshape(c.shape[::-1]).T, np.nan))
        for t, c, r in zip(problem.trials, curves, here, strict=True)
    )
    settled = moved < STALLED
    at = Fitted(z, curves, marginal, linear, marginal.objective(here, z), fitted.steps + done, settled, fitted.tight)
    return replace(problem, trials=trials), at


def _full(z: Array, own: Array) -> Array:
    """Place of all that moves and of fixed laws in one trial."""
    return np.asarray(np.concatenate([z, np.zeros(own.size - z.size)]) + own)


def _bends(problem: Problem, fitted: Fitted, each: Sequence[Response]) -> bool:
    """Whether the bend of the model over each trial's own scatter moves a value."""
    own = own_scatter(fitted.marginal, fitted.linear)
    bent = []
    for response, d, block, curve in zip(each, own, fitted.marginal.blocks, fitted.curves, strict=True):
        found = response.curves([_full(fitted.z, d)])[0]
        if found is None:
            return True
        there = (block.white < 1.0).astype(float)  # what a film lost has no bend
        bent.append(rows(found[0] - curve) * there - np.hstack([block.moved, block.held]) @ d)
    marginal = fitted.marginal
    away = marginal.mean(bent)[: marginal.p] / np.sqrt(np.diag(marginal.covariance)[: marginal.p])
    seen = marginal.projected(bent)[1] > SEEN * sum(r.size for r in bent)
    return bool(seen or np.max(np.abs(away[problem.watched])) > BENT)


def _there(
    problem: Problem, marginal: Marginal, each: Sequence[Response], z: Array, own: Sequence[Array]
) -> tuple[list[Block], list[Array]] | None:
    """Blocks and residuals at z = 0 of all trials, each at its own scatter; None where one cannot run."""

    def one(k: int) -> tuple[Array, Array] | None:
        at = _full(z, own[k])
        curves = each[k].curves([at])[0]
        return None if curves is None else (curves[0], each[k].jacobian(at, range(at.size))[0])

    try:
        found = spread(None, one, range(len(each)))
    except ModelError:
        return None
    blocks, linear = [], []
    for trial, block, d, pair in zip(problem.trials, marginal.blocks, own, found, strict=True):
        if pair is None:
            return None
        there = rows(np.isfinite(trial.change_rad))[:, None]
        columns = rows(pair[1]) * there
        moved, held = columns[:, : z.size], columns[:, z.size :]
        (r,) = residuals([trial], [pair[0]])
        blocks.append(replace(block, moved=moved, held=held))
        linear.append(r + moved @ (z + d[: z.size]) + held @ d[z.size :])
    return blocks, linear
