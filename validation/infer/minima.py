"""Fits from several starts: whether there is one minimum, and which is the likeliest.

Starts are drawn by a Latin hypercube within one prior standard uncertainty.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from operator import attrgetter

import numpy as np
from scipy.stats import norm, qmc

from model.errors import ModelError
from validation.conventions import Array
from validation.infer.blocks import residuals
from validation.infer.fit import CLOSE, LAST_ROUNDS, Fitted, fit
from validation.infer.force_runs import Own, nothing_own, without_own
from validation.infer.noise import FLOOR, Marginal, OwnModes, box_step, largest_step, learn, likeliest
from validation.infer.problem import Columns, Problem, curves_at, residuals_there

MOST_STEPS = 15
SHARES = (1.0, 0.5, 0.25, 0.1, 0.03)  # of the way to where the linear model puts values
OWN_SHARES = (1.0, 0.3, 0.1)  # of each trial's way; less than all of it only where values cannot go all of theirs
CORRECTIONS = 3  # of each trial's place
BENT, SEEN = 0.1, 0.05  # of a posterior standard uncertainty, of the noise: a bend that is not followed
TINY = 1e-9  # of the same: a step below it has no direction
FORK = 2.8  # of a sample's noise, twice that of a change, whose zero is rounded too: a bend that is a fork
PROBES = ((0.3, 0.5), (0.03, 0.0))  # steps, of a posterior standard uncertainty; share of its phases a fork must leave
FEW = 1 / 3  # of the trials: no more have a fork in their first half, else the model is at fault
FOLLOWED = 3.0  # cost of a trial, per datum: above it the model is not yet where the trial was
LEARNT = 2  # times that sizes of noise are learnt
WANTED = 1.0  # of a posterior standard uncertainty: a step that gains nothing, and is counted in the uncertainty
SAME, IDLE = 1.0, 2  # of twice the log likelihood: so many steps that gain no more end at a kink
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
    fitted : where a fit ended
    say : called with a line after each step

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
    forks: dict[int, int] = {}
    learnt, idle, trail = 0, 0, [z]
    while not converged and steps < MOST_STEPS:
        found = _way_on(problem, place, SHARES[:1])
        if found is None and np.median(place.costs) < FOLLOWED:
            more = _forks(problem, place, forks)
            if more != forks:
                forks, place, learnt = more, _until(place, more), min(learnt, LEARNT - 1)
                if say is not None:
                    where = ", ".join(f"{problem.trials[k].label} from phase {at} on" for k, at in forks.items())
                    say(f"each trial: at a fork, left out: {where}")
                continue
        found = found or _way_on(problem, place, SHARES[1:])
        new = None if found is None else _look(columns, found, place.marginal, forks, learnt < LEARNT)
        if found is None or new is None:  # a kink: no way on lowers the cost
            converged = place.followed and largest_step(place.marginal, place.here, place.z, box, asked) < WANTED
            break
        steps, gained, place = steps + 1, found[2], new
        trail.append(place.z)
        learnt += place.followed
        largest = largest_step(place.marginal, place.here, place.z, box, problem.watched)
        if say is not None:
            said = f"each trial, step {steps}: gained {gained:.2g}, largest change left {largest:.2g} u"
            say(f"{said}, cost per datum up to {np.max(place.costs):.2g}")
        if learnt <= LEARNT:  # the cost was another function
            continue
        converged = place.followed and largest < CLOSE and _known(place)
        back = len(trail) > 2 and np.max(np.abs(place.z - trail[-3]) / place.marginal.width) < CLOSE
        if gained < SAME or back:  # to and fro between two linear models nothing is gained, whatever each step says
            converged = place.followed and largest_step(place.marginal, place.here, place.z, box, asked) < WANTED
            idle += 1
            if idle == IDLE:
                break
    if steps == 0:
        return replace(fitted, converged=False)
    return replace(_fitted(problem, fitted, place, steps, converged), forks=forks)


def _way_on(problem: Problem, place: _Place, shares: Sequence[float]) -> tuple[Array, _Way, float] | None:
    """As far to where the linear model wants all as runs agree better, and the gain; None where they do nowhere."""
    step = box_step(place.marginal, place.here, place.z, problem.box(), 0.0)
    before = _cost(place.marginal, place.run, place.own, place.z)
    for share in shares:
        z = place.z + share * step
        way = _on_the_way(problem, place, z, OWN_SHARES if share < 1.0 else OWN_SHARES[:1])
        after = np.inf if way is None else _cost(place.marginal, way.run, way.own, z)
        if way is not None and after < before:
            return z, way, before - after
    return None


def _cost(marginal: Marginal, run: Sequence[Array], own: Sequence[Own], z: Array) -> float:
    """Twice the negative log density of runs, of what trials share and have of their own, and of z; constants apart.

    What trials share is where it most probably is for these runs: its own density counts, or a step that needs less of
    it is taken for none.
    """
    there = without_own(marginal.blocks, run, own)
    modes = OwnModes(marginal, [r + b.moved @ z for r, b in zip(there, marginal.blocks, strict=True)], z)
    return float(np.sum(modes.costs(run, own)) + modes.prior + z @ z)


def _forks(problem: Problem, place: _Place, known: Mapping[int, int]) -> dict[int, int]:
    """Of each trial at a fork its first phase there, those known already among them.

    A step of 0.3 standard uncertainties, to where values are wanted and back, bends its motion by more than `FORK`
    times the sensor's noise: a body just meets a stop, or misses it. No linear model holds from there on. Where that
    would leave less than half of a trial the step may only be too long for the model: a tenth of it must bend as much
    (a key that just stands still on its way), and only few trials may.
    """
    marginal = place.marginal
    step = box_step(marginal, place.here, place.z, problem.box(), 0.0)
    step /= max(float(np.max(np.abs(step / marginal.width)[problem.watched])), TINY)
    tried = [(sign * probed, least) for probed, least in PROBES for sign in (1.0, -1.0)]
    curves = problem.response.curves([place.z + s * step for s, _ in tried], len(tried) * [place.own])
    late, early = dict(known), dict[int, int]()
    for (s, least), there in zip(tried, curves, strict=True):
        found = [] if there is None else residuals(problem.trials, there)
        for k, (new, old, b) in enumerate(zip(found, place.run, marginal.blocks, strict=False)):
            bent = (np.abs(old - new - s * (b.moved @ step)) / np.sqrt(b.white)).reshape(-1, b.time_s.size)
            if np.any(bent > FORK):
                phase = int(np.argmax(np.any(bent > FORK, axis=0)))
                if phase >= least * b.time_s.size:
                    out = late if least else early
                    out[k] = min(phase, out.get(k, phase))
    half = PROBES[0][1] * marginal.blocks[0].time_s.size
    soon = early.keys() | {k for k, phase in known.items() if phase < half}
    return late | early if len(soon) <= FEW * len(problem.trials) else late


def _until(place: _Place, forks: Mapping[int, int]) -> _Place:
    """The same place without what was measured after forks."""
    blocks = [b.until(forks[k]) if k in forks else b for k, b in enumerate(place.marginal.blocks)]
    marginal = Marginal(blocks, place.marginal.sizes)
    costs = OwnModes(marginal, place.linear, place.z).costs(place.run, place.own)
    return replace(place, marginal=marginal, costs=costs / np.array([r.size for r in place.run]))


@dataclass(frozen=True)
class _Way:
    """Of each trial a place on its way: what it has of its own there, residuals of its run, and its cost."""

    own: list[Own]
    run: list[Array]
    costs: Array


def _on_the_way(problem: Problem, place: _Place, z: Array, shares: Sequence[float]) -> _Way | None:
    """Of each trial the likeliest place near where the linear model puts it; None where some cannot run.

    What a trial has of its own turns with z along a curve: from the first place it is corrected by what the run there
    says, or the whole could follow z by a tenth of a step only.
    """
    blocks = place.marginal.blocks
    way = _likeliest_way(problem, z, OwnModes(place.marginal, place.linear, z), place.own, shares)
    for _ in range(CORRECTIONS):
        if way is None:
            break
        there = without_own(blocks, way.run, way.own)
        linear = [r + b.moved @ z for r, b in zip(there, blocks, strict=True)]
        modes = OwnModes(place.marginal, linear, z)
        known = modes.costs(way.run, way.own)
        found = _likeliest_way(problem, z, modes, way.own, shares)
        if found is None:
            break
        better = found.costs < known
        pairs = [(found if take else way) for take in better]
        way = _Way(
            [w.own[k] for k, w in enumerate(pairs)],
            [w.run[k] for k, w in enumerate(pairs)],
            np.minimum(found.costs, known),
        )
        if float(np.sum(known - way.costs)) < SAME:
            break
    return way


def _likeliest_way(
    problem: Problem, z: Array, modes: OwnModes, own: Sequence[Own], shares: Sequence[float]
) -> _Way | None:
    """Of each trial the likeliest of some shares of the way to its mode; None where it cannot be run at all."""
    tried = [[a.towards(b, s) for a, b in zip(own, modes.most, strict=True)] for s in shares]
    found = problem.response.curves(len(tried) * [z], tried)
    run = [(own, residuals(problem.trials, c)) for own, c in zip(tried, found, strict=True) if c is not None]
    if not run:
        return None
    costs = np.array([modes.costs(r, own) for own, r in run])
    best = [int(i) for i in np.argmin(costs, axis=0)]
    every = [run[i][0][k] for k, i in enumerate(best)]
    return _Way(every, [run[i][1][k] for k, i in enumerate(best)], np.asarray(costs.min(axis=0)))


def _look(
    columns: Columns, found: tuple[Array, _Way, float], before: Marginal, forks: Mapping[int, int], anew: bool
) -> _Place | None:
    """The linear model at a place; None where it cannot be made.

    Sizes are learnt ``anew`` once every trial is followed, and then kept, so that there is one function to minimise.
    """
    z, way, _ = found
    try:
        blocks = [b.until(forks[k]) if k in forks else b for k, b in enumerate(columns.blocks(z, way.own))]
    except ModelError:
        return None
    here = without_own(blocks, way.run, way.own)
    linear = [r + b.moved @ z for r, b in zip(here, blocks, strict=True)]
    each = way.costs / np.array([r.size for r in linear])
    anew = anew and bool(np.max(each) < FOLLOWED)
    marginal = learn(blocks, linear, before.sizes, LAST_ROUNDS, FLOOR) if anew else Marginal(blocks, before.sizes)
    return _Place(z, way.own, way.run, linear, here, marginal, each)


def bends(problem: Problem, fitted: Fitted) -> bool:
    """Whether what trials have of their own bends the model so far that a value or the noise shows it."""
    marginal, own = fitted.marginal, OwnModes(fitted.marginal, fitted.linear, fitted.z).most
    curves = curves_at(problem, fitted.z, own)
    if curves is None:
        return True
    here = residuals_there(problem, marginal.blocks, curves, own)
    bent = [h + b.moved @ fitted.z - r for h, b, r in zip(here, marginal.blocks, fitted.linear, strict=True)]
    away = marginal.mean(bent)[: marginal.p] / marginal.width
    seen = marginal.projected(bent)[1] > SEEN * sum(r.size for r in bent)
    return bool(seen or np.max(np.abs(away[problem.watched])) > BENT)


def _known(place: _Place) -> bool:
    """Whether each trial is where what it has of its own most probably is."""
    scatter, most = place.marginal.sizes.scatter, OwnModes(place.marginal, place.linear, place.z).most
    return max(a.apart(b, scatter) for a, b in zip(place.own, most, strict=True)) < OWN_CLOSE


def _fitted(problem: Problem, before: Fitted, place: _Place, steps: int, converged: bool) -> Fitted:
    """Where it ended, with the likeliest sizes of noise, and what the last step would still have changed."""
    marginal = likeliest(place.marginal.blocks, place.linear, place.marginal.sizes, LAST_ROUNDS)
    z, asked = place.z, np.arange(len(problem.unknowns.asked))
    wanted = box_step(marginal, place.here, z, problem.box(), 0.0)
    largest = np.max(np.abs(wanted[asked]) / np.sqrt(np.diag(marginal.covariance)[asked]))
    curves = curves_at(problem, z)
    return replace(
        before,
        z=z,
        curves=before.curves if curves is None else curves,
        marginal=marginal,
        linear=place.linear,
        objective=marginal.objective(place.here, z),
        steps=before.steps + steps,
        converged=converged and bool(largest < WANTED),
        own=place.own,
        before=before.badness,
        wanted=wanted,
    )


START_SEED = 125
_badness = attrgetter("badness")


def search(problem: Problem, n: int, say: Callable[[str], None] | None, columns: Columns | None) -> list[Fitted]:
    """Fits from several starts, the likeliest first.

    Where the discrepancy explains what a parameter should, a fit ends in a wrong minimum. So once the linear model is
    near enough and something seems to be lacking, it goes on as if the model lacked nothing; only where that does not
    settle, or is less likely, it goes on from there as it was. A fit that still has not settled, or leaves a
    discrepancy, is followed by one from where it ended and one from the action's values, which take the model to lack
    nothing, too. The likeliest goes on with each trial where its own laws and force were (`each_trial`).

    Parameters
    ----------
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
