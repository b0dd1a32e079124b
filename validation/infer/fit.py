"""Most probable values: one damped Gauss–Newton iteration in a box, its variance components estimated on the way.

Conventions: z in prior standard uncertainties, see `unknowns`. `fit` brings the values near a minimum with all trials
alike; `fit_conditional` goes on with each trial linearised around what it most probably had of its own (first-order
conditional estimation: Lindstrom and Bates 1990, Biometrics 46, 673). `fit_multistart` does both from several starts.
The work is bounded: by numbers of steps, and by a budget of processor time; each fit says how it ended.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from operator import attrgetter

import numpy as np
from scipy.special import ndtr, ndtri

from model.errors import ModelError
from validation.conventions import Array
from validation.errors import ValidationInputError
from validation.infer.blocks import Block, bend, residuals
from validation.infer.budget import BIFURCATION, CONVERGED, OUT_OF_BUDGET, Budget, End
from validation.infer.noise import (
    FLOOR,
    LEAST_DAMPING,
    MARQUARDT,
    ROUGH_FLOOR,
    Marginal,
    OwnModes,
    Sizes,
    box_step,
    find_largest_step,
    learn,
    list_dampings,
    select_noise_model,
)
from validation.infer.observations import ObservedTrial
from validation.infer.problem import Columns, Problem, curves_at, linear_residuals
from validation.infer.response import Own, make_nothing_own, remove_own

Say = Callable[[str], None]

MAX_STEPS = 10  # linearisations with all trials alike
MAX_TIGHT_STEPS, MAX_CONDITIONAL_STEPS = 6, 15  # without discrepancy; with each trial at its own mode
ROUNDS, LAST_ROUNDS = 4, 30  # of scoring the variance components, on the way and near a minimum
FIRST_FLOOR, NEAR_FLOOR = 0.1, 0.01  # of the response: error of the linear model in the first step; near a minimum
NEAR = 2.0  # posterior u: a step below it leaves the variance components as they are
CLOSE = 0.1  # posterior u: a step below it is the last
WITHIN = 1.0  # posterior u: a remaining step that no run confirms counts as uncertainty, if it is no longer
LEAST_GAIN = 0.5  # of twice the log posterior: two steps in turn that gain less end a fit
SLIGHT = 0.05  # of the response: a discrepancy that is no reason to look for another minimum
HOPELESS, HOPELESS_STEPS = 20.0, 3  # squared error a datum, in sensor noise, after so many steps without discrepancy
FOLLOWED = 3.0  # squared error a datum of a trial: above it the model is not yet where the trial was
ROUNDS_A_STEP = 2  # of scoring: smaller noise makes a steeper cost, which runs must follow
STEEP = 1000.0  # squared error a datum: variance components that raise a trial's cost above it are approached in rounds
SETTLED, MAX_LEARNINGS = 1.0, 2  # log evidence; variance components that gain less, or were learnt twice, are kept
BACKTRACK = 0.3  # share of a step that is tried where the whole one was too long, and of that again
SHARES = tuple(BACKTRACK**k for k in range(4))  # of a step, for the line search
OWN_SHARES = SHARES[:3]  # of the step of one trial's deviation
CORRECTIONS = 3  # of each trial's mode by runs
PROBES = ((0.3, 0.5), (0.03, 0.0))  # posterior u of a probe of nonlinearity; share of the trial that must remain
BENT = 2.0 * np.sqrt(2.0)  # of a sample's noise: twice the error of a difference; more is a bifurcation
MOST_BENT = 1 / 3  # of the trials: more with a bifurcation in their first half are an error of the model
PARTS = (0.4, 0.7, 1.0)  # of each trial, fitted in turn
FEW = 2  # trials of each session that are followed first, where they are no more than half of all
MAX_CONTINUED = 2  # starts that are continued with each trial at its own mode


@dataclass(frozen=True)
class Fitted:
    """Where a fit ended."""

    z: Array  # (p,) most probable values of all moved parameters
    curves: list[Array]  # of each trial there, (m, 3), without what it has of its own
    marginal: Marginal  # the linear model there, with its covariance
    linear: list[Array]  # residuals at z = 0 of the linear model, of each trial
    objective: float  # twice the negative log posterior, up to a constant of the variance components
    steps: int  # how many were taken
    end: End
    own: Sequence[Own] | None = None  # deviation of each trial that it is linearised around; None: all alike
    before: float | None = None  # badness of the fit with all trials alike that this one continues
    remaining: Array | None = None  # (p,) step that no run confirmed; part of the uncertainty
    bifurcations: Mapping[int, int] = field(default_factory=dict)  # trial -> first phase that is left out

    def own_at(self, z: Array) -> list[Own] | None:
        """Most probable random effects of each trial at the parameters z."""
        return None if self.own is None else OwnModes(self.marginal, self.linear, z).most

    @property
    def converged(self) -> bool:
        """Whether the values are those of a minimum."""
        return self.end.is_settled

    @property
    def badness(self) -> float:
        """Twice the negative log marginal likelihood, to compare fits of the same trials."""
        return -2.0 * self.marginal.log_evidence(self.linear)

    @property
    def alike(self) -> float:
        """Cost of the fit in which all trials share their parameters, which this one continues, or of this one."""
        return self.badness if self.before is None else self.before

    @property
    def is_slight(self) -> bool:
        """Whether the model lacks next to nothing."""
        return float(self.marginal.sizes.discrepancy.max()) <= SLIGHT

    @property
    def covariance(self) -> Array:
        """Of z, (p, p)."""
        p = self.marginal.p
        return self.marginal.covariance[:p, :p]


def fit(
    problem: Problem,
    start: Array | None = None,
    say: Say | None = None,
    columns: Columns | None = None,
    tight: bool = False,
    leave: bool = False,
    first_share: float = 1.0,
    budget: Budget | None = None,
) -> Fitted:
    """Damped Gauss–Newton fit from z = ``start`` (default 0), trials without random effects. ``tight``: no discrepancy
    until it settles; ``leave``: end once near; ``first_share``: of each trial, fitted. Input error where the model
    cannot run at the start.

    Parameters
    ----------
    start : (p,) z to start from; by default the action's own values
    say : called with a line after each step
    columns : derivatives found already
    tight : take the model to lack nothing until the values have settled; variance components are estimated only then
    leave : end where the linear model is good to `NEAR_FLOOR`, and either the values are near, or the discrepancy
        explains more than a slight part
    first_share : share of each trial, from its start, that is fitted

    Raises
    ------
    ValidationInputError
        The model cannot run at the start.
    """
    budget = Budget(np.inf) if budget is None else budget
    low, high = problem.box()
    z = np.clip(np.zeros(len(problem.unknowns.moved)) if start is None else start, low, high)
    curves = curves_at(problem, z)
    if curves is None:
        raise ValidationInputError("identify: the model cannot run at the start; use other values (`overrides`)")
    columns = Columns(problem) if columns is None else columns
    sizes, steps, idle = (Sizes.tight if tight else Sizes.start)(problem.families, problem.seen), 0, 0
    floor, damping, learnt = (ROUGH_FLOOR if tight else FIRST_FLOOR), 0.0, False
    last: tuple[Array, list[Array], Marginal, list[Array], list[Array]] | None = None
    asked, watched = np.arange(len(problem.unknowns.asked)), np.arange(z.size) if tight else problem.watched
    end, near, largest = End(OUT_OF_BUDGET, "its steps did not become small"), False, np.inf
    with budget.interruptible():
        while True:
            near = floor <= NEAR_FLOOR
            blocks = _blocks(columns, z, near)
            if first_share < 1.0:
                blocks = [b.until(int(first_share * b.time_s.size)) for b in blocks]
            linear, here = linear_residuals(problem, blocks, curves, z), residuals(problem.trials, curves)
            kept = learnt or (near and largest < NEAR) or tight  # one function to minimise
            rounds = LAST_ROUNDS if near else ROUNDS
            marginal = Marginal(blocks, sizes) if kept else learn(blocks, linear, sizes, rounds, floor)
            largest = find_largest_step(marginal, here, z, (low, high), watched)
            lacks = not tight and float(marginal.sizes.discrepancy.max()) > SLIGHT
            is_left = leave and near and (largest < NEAR or lacks)
            if near and not is_left and (largest < CLOSE or idle) and not learnt:
                marginal = select_noise_model(blocks, linear, marginal.sizes, LAST_ROUNDS, not tight, ROUGH_FLOOR)
                learnt = True
                largest = find_largest_step(marginal, here, z, (low, high), watched)
            sizes, last = marginal.sizes, (z, curves, marginal, linear, here)
            if is_left or (learnt and near and largest < CLOSE):
                end = End(CONVERGED)
                break
            lost = tight and steps >= HOPELESS_STEPS and _cost_per_datum(marginal, here, z) > HOPELESS
            if lost or steps == (MAX_TIGHT_STEPS if tight else MAX_STEPS) or idle == 2 or budget.is_spent:
                break
            steps += 1
            attempt = _search_damping(problem, marginal, here, z, damping)
            idle = idle + 1 if near and largest < NEAR and attempt.gain < LEAST_GAIN else 0
            if say is not None:
                taken = "" if attempt.curves is not None else "; none lowers the objective"
                said = f"step {steps}: largest {largest:.2g} u, damped by {attempt.damping:g}{taken}"
                say(f"{said}; linear to {attempt.bent:.2g}, gained {attempt.gain:.2g}")
            if attempt.curves is not None:
                z, curves = z + attempt.step, attempt.curves
            elif near and not idle:
                break
            damping, worth = attempt.damping, attempt.bent
            floor = max(ROUGH_FLOOR, 0.5 * (worth if attempt.curves is not None else min(worth, floor)))
            damping = damping / MARQUARDT if damping > LEAST_DAMPING and worth > ROUGH_FLOOR else 0.0
    if last is None:
        raise KeyboardInterrupt
    z, curves, marginal, linear, here = last
    if tight:
        marginal = learn(marginal.blocks, linear, marginal.sizes, ROUNDS, ROUGH_FLOOR)
    remaining = box_step(marginal, here, z, (low, high), 0.0)
    within = bool(np.max(np.abs(remaining[asked]) / marginal.width[asked], initial=0.0) < WITHIN)
    if end.kind == OUT_OF_BUDGET and near and within and not budget.is_spent:
        end = End(CONVERGED, "no step gains; what is left of the last one is part of u")
    return Fitted(z, curves, marginal, linear, marginal.objective(here, z), steps, end, remaining=remaining)


def _blocks(columns: Columns, z: Array, near: bool) -> list[Block]:
    try:
        return columns.blocks(z, near=near)
    except ModelError as error:
        raise ValidationInputError(f"identify: {error}") from None


def _cost_per_datum(marginal: Marginal, here: Sequence[Array], z: Array) -> float:
    return marginal.objective(here, z) / sum(r.size for r in here)


@dataclass(frozen=True)
class _Attempt:
    """A step, its curves (None: not taken), damping, error of the linear model over the longest one, and its gain."""

    step: Array
    curves: list[Array] | None
    damping: float
    bent: float
    gain: float


def _search_damping(problem: Problem, marginal: Marginal, here: Sequence[Array], z: Array, damping: float) -> _Attempt:
    """First step from z, where residuals are ``here``, that lowers the objective by runs, tried with ``damping``, then
    larger ones (of the curvature's diagonal); a zero step without curves where none does."""
    before, bent = marginal.objective(here, z), 0.0
    for more in list_dampings(damping):
        step = box_step(marginal, here, z, problem.box(), more)
        moved = curves_at(problem, z + step)
        if moved is None:
            continue
        there = residuals(problem.trials, moved)
        bent = max(bent, bend(marginal.blocks, here, there, step))  # a short step looks linear anywhere
        after = marginal.objective(there, z + step)
        if after < before:
            return _Attempt(step, moved, more, bent, before - after)
    return _Attempt(np.zeros_like(z), None, damping, bent if bent > 0.0 else np.inf, 0.0)


@dataclass(frozen=True)
class _Iterate:
    """Values, deviations of trials, residuals of their runs, the linear model there, and each trial's cost a datum."""

    z: Array
    own: list[Own]
    run: list[Array]
    linear: list[Array]
    here: list[Array]
    marginal: Marginal
    costs: Array
    is_learnt: bool = False  # whether the variance components have settled
    learnings: int = 0  # how often they were estimated to the end

    @property
    def is_followed(self) -> bool:
        """Whether the model is where each trial was."""
        return bool(np.max(self.costs) < FOLLOWED)


def fit_conditional(
    problem: Problem,
    fitted: Fitted,
    say: Say | None = None,
    budget: Budget | None = None,
    first_share: float = 1.0,
    rough: bool = False,
) -> Fitted:
    """Continue a fit with each trial linearised at its random effects, its first ``first_share`` before the rest, then,
    unless ``rough``, with less discrepancy allowed. The fit as it was, but *out of budget*, where no step could be
    taken.

    A soft stroke near a bifurcation of its motion does not answer a scatter of 2 % linearly: a linear model around what
    all trials share then calls the rest felt or friction, with too small an uncertainty. Each step moves values and
    deviations towards the minimum of the linear model, as far as runs of the model agree better there.

    Parameters
    ----------
    fitted : where a fit with all trials alike ended
    say : called with a line after each step
    first_share : share of each trial, from its start, that is fitted first; the rest follows as far as it is linear
    rough : end with the least discrepancy of fits on the way

    Returns
    -------
    Fitted
        As it was, out of budget, where no step could be taken.
    """
    budget = Budget(np.inf) if budget is None else budget
    columns = Columns(problem)
    if first_share < 1.0:
        found, at = _extend(problem, fitted, columns, say, budget, first_share)
    else:
        found, at = _iterate(problem, fitted, columns, _first_iterate(fitted), {}, say, budget)
    if rough or not found.converged:
        return found
    return _refine(problem, found, columns, at, say, budget)


def _refine(problem: Problem, found: Fitted, columns: Columns, at: _Iterate, say: Say | None, budget: Budget) -> Fitted:
    """Continue a fit, which ended at ``at`` with discrepancies of at least `ROUGH_FLOOR`, with the lower limit `FLOOR`;
    the fit ``found`` itself where that does not converge."""
    at = _estimate_noise(replace(at, is_learnt=False, learnings=0), FLOOR)
    finer, _ = _iterate(problem, found, columns, at, found.bifurcations, say, budget, FLOOR)
    if not finer.converged:
        return found
    end = finer.end if len(finer.bifurcations) > len(found.bifurcations) else found.end
    return replace(finer, before=found.before, end=end)


def _first_iterate(fitted: Fitted) -> _Iterate:
    """First iterate of the conditional fit, at the end of a fit whose trials share all parameters."""
    marginal, linear, z = fitted.marginal, fitted.linear, fitted.z
    here = [r - b.moved @ z for r, b in zip(linear, marginal.blocks, strict=True)]
    return _Iterate(z, make_nothing_own(marginal.blocks), here, linear, here, marginal, np.full(len(linear), np.inf))


def _extend(
    problem: Problem, fitted: Fitted, columns: Columns, say: Say | None, budget: Budget, first_share: float
) -> tuple[Fitted, _Iterate]:
    """Fit the first ``first_share`` of each trial, then each to its end or bifurcation: the fit, and its last iterate;
    where the second does not converge, those of the first, with an end that says so."""
    part = {k: int(first_share * t.time_s.size) for k, t in enumerate(problem.trials)}
    first, at = _iterate(
        problem, fitted, columns, _cut_at_bifurcations(_first_iterate(fitted), part), part, say, budget
    )
    if not first.converged:
        return first, at
    blocks = columns.blocks(at.z, at.own)
    here = remove_own(blocks, at.run, at.own)
    linear = [r + b.moved @ at.z for r, b in zip(here, blocks, strict=True)]
    whole = replace(at, here=here, linear=linear, marginal=Marginal(blocks, at.marginal.sizes))
    found = _find_bifurcations(problem, whole, {})
    where = "; ".join(bifurcation_words(problem, found))
    if say is not None:
        say(f"each trial to its end{', left out at a bifurcation: ' if found else ''}{where}")
    second, last = _iterate(problem, first, columns, _cut_at_bifurcations(whole, found), found, say, budget)
    if second.converged:
        return second, last
    fitted_part = f"only the first {first_share:.0%} of each trial is fitted"
    end = End(BIFURCATION, f"{where}; {fitted_part}") if found else replace(second.end, detail=fitted_part)
    return replace(first, end=end), at


def _iterate(
    problem: Problem,
    fitted: Fitted,
    columns: Columns,
    at: _Iterate,
    bifurcations: Mapping[int, int],
    say: Say | None,
    budget: Budget,
    floor: float = ROUGH_FLOOR,
) -> tuple[Fitted, _Iterate]:
    """Gauss–Newton steps from the iterate ``at`` until they are small, gain too little or the budget ends: the fit, and
    the last iterate. ``bifurcations``: trial index -> first sample left out, more are found on the way; no discrepancy
    is below ``floor``."""
    box = problem.box()
    steps, idle = 0, 0
    with budget.interruptible():
        while steps < MAX_CONDITIONAL_STEPS and idle < 2 and not budget.is_spent:
            found = _search_line(problem, at, SHARES[:1])
            if found is None and np.median(at.costs) < FOLLOWED:
                more = _find_bifurcations(problem, at, bifurcations)
                if more != bifurcations:
                    bifurcations, at = more, _cut_at_bifurcations(at, more)
                    if say is not None:
                        where = (f"{problem.trials[k].label} from phase {i} on" for k, i in more.items())
                        say(f"each trial: at a bifurcation, left out: {', '.join(where)}")
                    continue
            found = found or _search_line(problem, at, SHARES[1:])
            moved = None if found is None else _linearise(columns, found, at, bifurcations, floor)
            if found is None or moved is None:  # a kink: no step lowers the cost
                break
            steps, gained, at = steps + 1, found[2], moved
            largest = find_largest_step(at.marginal, at.here, at.z, box, problem.watched)
            if say is not None:
                said = f"each trial, step {steps}: gained {gained:.2g}, largest left {largest:.2g} u"
                say(f"{said}, cost a datum up to {np.max(at.costs):.2g}")
            if not at.is_learnt:  # the cost was another function
                continue
            if at.is_followed and largest < (CLOSE if floor == FLOOR else WITHIN):
                break
            idle = idle + 1 if gained < LEAST_GAIN else 0
    if steps == 0 and floor == ROUGH_FLOOR:
        what = "stopped by Ctrl-C" if budget.is_interrupted else "no step of all trials could be taken"
        return replace(fitted, end=End(OUT_OF_BUDGET, what, budget.is_interrupted)), at
    return _conclude(problem, fitted, at, steps, bifurcations, budget, floor), at


def _conclude(
    problem: Problem,
    before: Fitted,
    at: _Iterate,
    steps: int,
    bifurcations: Mapping[int, int],
    budget: Budget,
    floor: float,
) -> Fitted:
    """Fit at the last iterate ``at``, ``steps`` steps after the fit ``before``, with variance components learnt to the
    end, no discrepancy below ``floor``; it says that it converged, stands at a bifurcation, or ran out of budget."""
    marginal, z = select_noise_model(at.marginal.blocks, at.linear, at.marginal.sizes, LAST_ROUNDS, False, floor), at.z
    remaining = box_step(marginal, at.here, z, problem.box(), 0.0)
    asked = problem.unknowns.asked
    left = np.abs(remaining[: len(asked)]) / marginal.width[: len(asked)]
    most = int(np.argmax(left))
    if not at.is_followed:
        worst = int(np.argmax(at.costs))
        missed = f"after {steps} steps the model is not where {problem.trials[worst].label} was"
        end = End(OUT_OF_BUDGET, f"{missed} (squared error {at.costs[worst]:.2g} of the noise's)")
    elif left[most] >= WITHIN:
        end = End(
            OUT_OF_BUDGET,
            f"after {steps} steps {asked[most].name} would still move by {left[most]:.1f} standard uncertainties",
        )
    elif bifurcations:
        end = End(BIFURCATION, "; ".join(bifurcation_words(problem, bifurcations)))
    else:
        end = End(CONVERGED)
    if budget.is_interrupted and not end.is_settled:
        end = replace(end, detail=f"stopped by Ctrl-C; {end.detail}", by_user=True)
    curves = curves_at(problem, z)
    return replace(
        before,
        z=z,
        curves=before.curves if curves is None else curves,
        marginal=marginal,
        linear=at.linear,
        objective=marginal.objective(at.here, z),
        steps=before.steps + steps,
        end=end,
        own=at.own,
        before=before.badness,
        remaining=remaining,
        bifurcations=bifurcations,
    )


def bifurcation_words(problem: Problem, bifurcations: Mapping[int, int]) -> list[str]:
    """Which trial, from when on after its first phase."""
    times = {k: problem.trials[k].time_s for k in bifurcations}
    return [
        f"{problem.trials[k].label} from {1e3 * (times[k][i] - times[k][0]):.0f} ms on"
        for k, i in sorted(bifurcations.items())
    ]


def _search_line(problem: Problem, at: _Iterate, shares: Sequence[float]) -> tuple[Array, _Modes, float] | None:
    """z (p,), modes of the trials and gain at the first of ``shares`` of the whole Gauss–Newton step at which runs have
    a lower cost; None where none does."""
    step = box_step(at.marginal, at.here, at.z, problem.box(), 0.0)
    before = _cost(at.marginal, at.run, at.own, at.z)
    for share in shares:
        z = at.z + share * step
        modes = _find_modes(problem, at, z, OWN_SHARES if share < 1.0 else OWN_SHARES[:1])
        after = np.inf if modes is None else _cost(at.marginal, modes.run, modes.own, z)
        if modes is not None and after < before:
            return z, modes, before - after
    return None


def _cost(marginal: Marginal, run: Sequence[Array], own: Sequence[Own], z: Array) -> float:
    """Twice the negative log density, up to a constant, of z, the random effects ``own`` and the residuals ``run`` of
    runs made with both, all of each trial.

    What trials share is at its mode for these runs, and its own density counts: else a step that needs less of it is
    taken for none.
    """
    there = remove_own(marginal.blocks, run, own)
    modes = OwnModes(marginal, [r + b.moved @ z for r, b in zip(there, marginal.blocks, strict=True)], z)
    return float(np.sum(modes.costs(run, own)) + modes.prior + z @ z)


def _find_bifurcations(problem: Problem, at: _Iterate, known: Mapping[int, int]) -> dict[int, int]:
    """Trial index -> first sample from which on small steps bend the curves by more than the noise, found by runs;
    those of ``known`` are included. Nothing is cut here.

    A probe to both sides along the Gauss–Newton step bends its motion by more than `BENT` times the sensor's noise: a
    body just meets a stop, or misses it, and no linear model holds from there on. Where that would leave less than half
    of a trial the probe may only be too long: a tenth of it must bend as much, and only few trials may.
    """
    marginal = at.marginal
    step = box_step(marginal, at.here, at.z, problem.box(), 0.0)
    step /= max(float(np.max(np.abs(step / marginal.width)[problem.watched])), np.finfo(float).tiny)
    tried = [(sign * probed, least) for probed, least in PROBES for sign in (1.0, -1.0)]
    curves = problem.response.curves([at.z + s * step for s, _ in tried], len(tried) * [at.own])
    late, early = dict(known), dict[int, int]()
    for (s, least), there in zip(tried, curves, strict=True):
        found = [] if there is None else residuals(problem.trials, there)
        for k, (new, old, b) in enumerate(zip(found, at.run, marginal.blocks, strict=False)):
            bent = (np.abs(old - new - s * (b.moved @ step)) / np.sqrt(b.white)).reshape(-1, b.time_s.size)
            if np.any(bent > BENT):
                phase = int(np.argmax(np.any(bent > BENT, axis=0)))
                if phase >= least * b.time_s.size:
                    out = late if least else early
                    out[k] = min(phase, out.get(k, phase))
    half = PROBES[0][1] * marginal.blocks[0].time_s.size
    soon = early.keys() | {k for k, phase in known.items() if phase < half}
    return late | early if len(soon) <= MOST_BENT * len(problem.trials) else late


def _cut_at_bifurcations(at: _Iterate, bifurcations: Mapping[int, int]) -> _Iterate:
    """Copy of an iterate in which each trial counts only before its bifurcation, the sample index in ``bifurcations``
    by trial; later samples keep their place but weigh nothing."""
    blocks = [b.until(bifurcations[k]) if k in bifurcations else b for k, b in enumerate(at.marginal.blocks)]
    marginal = Marginal(blocks, at.marginal.sizes)
    costs = OwnModes(marginal, at.linear, at.z).costs(at.run, at.own)
    return replace(
        at, marginal=marginal, costs=costs / np.array([r.size for r in at.run]), is_learnt=False, learnings=0
    )


@dataclass(frozen=True)
class _Modes:
    """Most probable random effects of each trial, residuals of its run with them, and its cost."""

    own: list[Own]
    run: list[Array]
    costs: Array


def _find_modes(problem: Problem, at: _Iterate, z: Array, shares: Sequence[float]) -> _Modes | None:
    """Most probable random effects of each trial at z (p,), with residuals of runs and costs there: from the linear
    model of ``at``, corrected by runs at ``shares`` of each step; None where the model cannot run.

    What a trial has of its own turns with z along a curve: without corrections all could follow z by short steps only.
    """
    blocks = at.marginal.blocks
    modes = _run_towards(problem, z, OwnModes(at.marginal, at.linear, z), at.own, shares)
    for _ in range(CORRECTIONS):
        if modes is None:
            break
        there = remove_own(blocks, modes.run, modes.own)
        linear = [r + b.moved @ z for r, b in zip(there, blocks, strict=True)]
        corrected = OwnModes(at.marginal, linear, z)
        known = corrected.costs(modes.run, modes.own)
        found = _run_towards(problem, z, corrected, modes.own, shares)
        if found is None:
            break
        pairs = [(found if better else modes) for better in found.costs < known]
        modes = _Modes(
            [w.own[k] for k, w in enumerate(pairs)],
            [w.run[k] for k, w in enumerate(pairs)],
            np.minimum(found.costs, known),
        )
        if float(np.sum(known - modes.costs)) < LEAST_GAIN:
            break
    return modes


def _run_towards(
    problem: Problem, z: Array, modes: OwnModes, own: Sequence[Own], shares: Sequence[float]
) -> _Modes | None:
    """Run trials at z with random effects at each of ``shares`` of the way from ``own`` to ``modes``, and keep for each
    trial the most probable; None where the model cannot run at any."""
    tried = [[a.towards(b, s) for a, b in zip(own, modes.most, strict=True)] for s in shares]
    found = problem.response.curves(len(tried) * [z], tried)
    run = [(own, residuals(problem.trials, c)) for own, c in zip(tried, found, strict=True) if c is not None]
    if not run:
        return None
    costs = np.array([modes.costs(r, own) for own, r in run])
    best = [int(i) for i in np.argmin(costs, axis=0)]
    every = [run[i][0][k] for k, i in enumerate(best)]
    return _Modes(every, [run[i][1][k] for k, i in enumerate(best)], np.asarray(costs.min(axis=0)))


def _linearise(
    columns: Columns,
    found: tuple[Array, _Modes, float],
    before: _Iterate,
    bifurcations: Mapping[int, int],
    floor: float,
) -> _Iterate | None:
    """Iterate with a new linear model at the end of a step, ``found`` = (z, modes, gain), without what follows
    ``bifurcations`` (trial index -> sample), no discrepancy learnt below ``floor``; None where the model has no
    derivatives there."""
    z, modes, _ = found
    try:
        every = enumerate(columns.blocks(z, modes.own))
        blocks = [b.until(bifurcations[k]) if k in bifurcations else b for k, b in every]
    except ModelError:
        return None
    here = remove_own(blocks, modes.run, modes.own)
    linear = [r + b.moved @ z for r, b in zip(here, blocks, strict=True)]
    costs, marginal = modes.costs / np.array([r.size for r in linear]), Marginal(blocks, before.marginal.sizes)
    at = _Iterate(z, modes.own, modes.run, linear, here, marginal, costs, before.is_learnt, before.learnings)
    return _estimate_noise(at, floor)


def _estimate_noise(at: _Iterate, floor: float) -> _Iterate:
    """Iterate with variance components estimated, none of the discrepancy below ``floor``, where the model is near
    every trial and they have not settled yet; else the iterate as it is."""
    if at.is_learnt or not at.is_followed:
        return at
    marginal, learnings = at.marginal, at.learnings
    for rounds in (LAST_ROUNDS, ROUNDS_A_STEP):
        marginal = learn(at.marginal.blocks, at.linear, at.marginal.sizes, rounds, floor)
        there = OwnModes(marginal, at.linear, at.z).costs(at.run, at.own)
        if np.max(there / np.array([r.size for r in at.linear])) < STEEP:
            learnings += 1
            break
    settled = marginal.log_evidence(at.linear) - at.marginal.log_evidence(at.linear) < SETTLED
    return replace(at, marginal=marginal, is_learnt=learnings == MAX_LEARNINGS or settled, learnings=learnings)


_badness = attrgetter("badness")


def fit_multistart(problem: Problem, n: int = 1, say: Say | None = None, budget: Budget | None = None) -> list[Fitted]:
    """Fits of all trials, each at its own random effects, from the best of ``n`` start points, at most `MAX_CONTINUED`:
    first the one to use, a converged one if any, and of these the likeliest. ``say`` gets a line after each step.

    Each start is brought near a minimum of few trials (`_fit_pilots`); the likeliest of these is continued with all
    trials, each at its own mode, and the next one where it does not settle or the discrepancy is more than slight.

    Parameters
    ----------
    n : how many points of `starts` to start from
    say : called with a line after each step
    """
    budget = Budget(np.inf) if budget is None else budget
    say = say or (lambda line: None)
    pilots = [found for start in starts(problem, n) for found in _fit_pilots(problem, start, say, budget)]
    pilots.sort(key=lambda pilot: pilot[0].badness)
    fits: list[Fitted] = []
    for pilot, share in pilots[:MAX_CONTINUED]:
        fits.append(_fit_from_pilot(problem, pilot, share, say, budget))
        if (fits[-1].converged and fits[-1].is_slight) or budget.is_spent:
            break
    best = max(fits, key=lambda f: (f.converged, -f.badness))
    return [best, *(f for f in fits if f is not best)]


def _fit_pilots(problem: Problem, start: Array, say: Say, budget: Budget) -> list[tuple[Fitted, float]]:
    """Fits of one typical trial of each session from z = ``start``: with a discrepancy, then without (in growing parts
    where it is more than slight); each with the share of a trial, from its beginning, that converged, or 1.

    Without a discrepancy a trial is fitted from its start on, the rest in parts: a soft stroke whose end is another
    motion does not turn the values aside.
    """
    pilot = problem.of_trials(_select_typical_trials(problem.trials))
    say(f"pilot fit of {', '.join(t.label for t in pilot.trials)}")
    found = fit(pilot, start, say, leave=True, budget=budget)
    pilots, tight, settled = [(found, 1.0)], found, 0.0
    with budget.interruptible():
        for share in () if budget.is_spent else PARTS[-1:] if found.is_slight else PARTS:
            say(f"without discrepancy, {share:.0%} of each trial")
            at = tight.z if found.is_slight or share != PARTS[0] else start
            tight = fit(pilot, at, say, None, True, True, share, budget)
            settled = share if tight.converged else settled
        pilots += [(tight, settled or 1.0)] if tight is not found else []
    return pilots


def _fit_from_pilot(problem: Problem, pilot: Fitted, share: float, say: Say, budget: Budget) -> Fitted:
    """Fit of all trials, each at its own mode, that starts from a pilot's values; `FEW` trials of each session come
    first, and of each trial its first ``share``, as these steps cost less."""
    few, at = _select_typical_trials(problem.trials, FEW), pilot
    if 2 * len(few) <= len(problem.trials):
        say(f"fit of {len(few)} of {len(problem.trials)} trials")
        some = problem.of_trials(few)
        with budget.interruptible():
            at = fit_conditional(some, fit_alike(some, at.z, at.marginal.sizes), say, budget, share, rough=True)
        if len(at.bifurcations) < len(few):  # not all of them were left out before their end
            share = 1.0
    first = None
    with budget.interruptible():
        first = fit_alike(problem, at.z, at.marginal.sizes)
    first = first or fit_alike(problem, at.z, at.marginal.sizes)  # Ctrl-C keeps what was found before
    return fit_conditional(problem, first, say, budget, share)


def _select_typical_trials(trials: Sequence[ObservedTrial], n: int = 1) -> list[int]:
    """Indices of the ``n`` trials of each session, session after session, whose angles differ least from the median of
    its trials at each sample, the nearest first."""
    out = []
    for session in dict.fromkeys(t.session for t in trials):
        those = [k for k, t in enumerate(trials) if t.session == session]
        change = np.array([trials[k].change_rad for k in those])
        away = np.nansum(np.abs(change - np.nanmedian(change, axis=0)), axis=(1, 2))
        out += [those[int(i)] for i in np.argsort(away, kind="stable")[:n]]
    return out


def fit_alike(problem: Problem, z: Array, sizes: Sizes | None = None) -> Fitted:
    """State of a fit at z (p,) without random effects: no step is taken, variance components are learnt from ``sizes``,
    its end is *out of budget*. Input error where the model cannot run."""
    curves, blocks = curves_at(problem, z), _blocks(Columns(problem), z, True)
    if curves is None:
        raise ValidationInputError("identify: the model cannot run at the start; use other values (`overrides`)")
    linear, here = linear_residuals(problem, blocks, curves, z), residuals(problem.trials, curves)
    sizes = Sizes.start(problem.families, problem.seen) if sizes is None else sizes
    marginal = learn(blocks, linear, sizes, ROUNDS, ROUGH_FLOOR)
    return Fitted(z, curves, marginal, linear, marginal.objective(here, z), 1, End(OUT_OF_BUDGET))


def starts(problem: Problem, n: int) -> list[Array]:
    """``n`` start points z (p,), the same at every call: zeros (the action's values), then a Latin hypercube of the
    asked parameters within one prior standard uncertainty, all others 0."""
    p, asked = len(problem.unknowns.moved), len(problem.unknowns.asked)
    out = [np.zeros(p)]
    if n > 1:
        from scipy.stats import qmc  # start-up: 0.3 s that only several starts need

        tail = ndtr(-1.0)  # within one prior standard uncertainty
        drawn = qmc.LatinHypercube(asked, seed=0).random(n - 1)
        for row in drawn:
            z = np.zeros(p)
            z[:asked] = ndtri(tail + (1.0 - 2.0 * tail) * row)
            out.append(z)
    return out
