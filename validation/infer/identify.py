"""Identification from sessions to result: one stage after the other."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Unpack

import numpy as np
from threadpoolctl import threadpool_limits

import model
from model.errors import ModelError
from model.keywords import make_options
from rig.session import Session
from validation.cache.content_hash import code_sha256
from validation.conventions import Array
from validation.errors import ValidationInputError
from validation.infer.budget import BIFURCATION, NOT_IDENTIFIABLE, Budget, End
from validation.infer.estimates import AT_BOUND, LACKING, Profile, estimate_all
from validation.infer.fit import Fitted, fit_multistart
from validation.infer.identifiability import EXPECTED, HALF, Combination, directions, warnings_before, warnings_of
from validation.infer.noise import ODDS, Marginal, Sizes
from validation.infer.observations import CHANNEL_NAMES, add_drive_errors, with_calibration
from validation.infer.problem import Columns, Problem, make_problem_at_start
from validation.infer.response import LOOSEST, ModelResponse
from validation.infer.result import FITTED, Details, Identification, joint_posterior, sensor_calibration
from validation.infer.scatter import measure_lack
from validation.infer.scores import explain_rising_rmse, rmse_by_channel, score, score_events
from validation.infer.sources import IdentifyKeywords, IdentifyOptions, Sources, collect
from validation.infer.unknowns import Unknowns, unknowns
from validation.prediction.model_under_test import action_sha256
from validation.prediction.posterior import EARLIER, TRIALS, posterior_of

LEAST_EFFECT_RAD = 1e-8  # a twentieth of the error of the runs: less is rounding
PROVISIONAL = (
    "intervals are provisional: how often they hold the truth is known from few virtual experiments "
    "(docs/explanation/identification.md)"
)
MOST_ASKED = 25  # values at once: how often intervals of more hold the truth was not counted
BUDGET_S_PER_TRIAL, LEAST_TRIALS, LEAST_ASKED = 5.0, 10, 12
"""Processor time by default: ten linearisations of 0.25 s a trial, and as much for runs, profiles and the rest."""
FIT_SHARE = 0.75  # of the budget; profiles and changes of the model have the rest


@threadpool_limits.wrap(limits=1, user_api="blas")
def identify(
    sessions: Session | str | Path | Sequence[Session | str | Path],
    parameters: str | Sequence[str],
    action: model.Action | str | Path = "hirschkorn2004",
    **keywords: Unpack[IdentifyKeywords],
) -> Identification:
    """Find the parameter values that explain the measured strokes, and say how well they are known: a fit to
    ``sessions``, with the values and uncertainties of ``action`` as the prior. The result holds the new action; the one
    given is not changed.

    Parameters
    ----------
    sessions : Session or path, or a sequence of them
        Sessions of one action; one kind of stroke each.
    parameters : str or sequence of str
        Paths or laws (``hammer.mass``, ``hammer.joint_friction``), ``felt:contact02``, or groups: ``friction``,
        ``joint_friction``, ``damping``, ``stiffness``, ``springs``.
    action : model.Action, name or path
        Values to start from; their uncertainties are the prior.
    **keywords
        fixed, hold_out, hold_out_trials : tuple
            Names held at the action's values; sessions, and numbers of trials, that are only predicted.
        priors : dict
            Standard uncertainty before, by name; relative for friction, felt and springs, SI else.
        starts : int, default 1
            Points that the fit starts from.
        profiles : tuple of str, optional
            Names to make a profile of; all that were asked for by default, ``()`` for none.
        condition, motion_driven, film
            As for `validation.compare` (``by_motion``); also fit jack and lever as tracked on films.
        budget_s, progress, executor, tolerance, phases, now
            See `validation.infer.sources.IdentifyOptions`.

    Returns
    -------
    Identification

    Raises
    ------
    ValidationInputError
        A parameter is unknown, has no prior or no effect, sessions cannot be used together, or the model cannot run.

    Notes
    -----
    A fit factors thousands of small matrices, which the threads of a BLAS library only slow down, twenty times beside
    another busy process: BLAS has one thread meanwhile.

    Examples
    --------
    >>> import validation
    >>> found = validation.identify(["sessions/example_forte"], ["hammer.joint_friction"], profiles=())
    >>> found.to_frame()["name"][0]
    'hammer.joint_friction.A'
    >>> path = found.save("identified.toml")
    """
    options = make_options(IdentifyOptions, "validation.identify", keywords)
    sessions = [sessions] if isinstance(sessions, Session | str | Path) else sessions
    parameters = [parameters] if isinstance(parameters, str) else parameters
    start = model.load_action(action) if isinstance(action, str | Path) else action
    asked = unknowns(start, parameters, options.fixed, options.priors)
    sources = collect(sessions, start, options)
    asked = add_drive_errors(asked, sources.fitted)
    every = (*asked.moved, *asked.held)
    response = ModelResponse(start, every, sources.fitted, options.tolerance, options.executor)
    try:
        problem, columns = make_problem_at_start(start, asked, sources.fitted, response)
    except ModelError as error:
        why = str(error).removeprefix("identification: ")
        raise ValidationInputError(f"identify: {start.name}: {why}; use other values (`overrides`)") from None
    before = check_identifiability(problem, columns)
    stuck = list_bounds_not_run(problem)
    for line in [*stuck, *before]:
        options.say(f"before the fit: {line}")
    seconds = default_budget_s(problem) if options.budget_s is None else options.budget_s
    budget = Budget(seconds)
    fits = fit_multistart(problem, options.starts, options.say, budget.fraction(FIT_SHARE))
    best = fits[0]
    found = action_at(start, asked, best.z)
    profiles: list[Profile] = []
    estimates = estimate_all(problem, best, options.profiles, options.say, profiles.append, budget)
    covariance = best.covariance[: len(asked.asked), : len(asked.asked)]
    names = [p.name for p in asked.asked]
    undetermined, determined = directions(names, covariance)
    end = _decide_end(best, names, covariance, determined)
    sensors = sensor_calibration(problem, best, sources)
    both = {"before": start, "identified": found}
    of = {name: with_calibration(trials, sensors) for name, trials in {FITTED: sources.fitted, **sources.held}.items()}
    scores = {name: score(trials, both, options.tolerance) for name, trials in of.items()}
    events = {name: score_events(some, both, LOOSEST) for name, some in sources.measured_held.items()}
    fitted, risen = scores[FITTED], []
    if fitted["before"] is not None and fitted["identified"] is not None:
        risen = explain_rising_rmse(
            fitted["before"], fitted["identified"], rmse_by_channel(sources.fitted, best.curves)
        )
    width = np.sqrt(np.diag(covariance))
    sizes = best.marginal.sizes.scatter
    scatter = {p.name: float(sizes[j] * p.u) for j, p in enumerate(asked.asked) if problem.laws[j]}
    bound = [f"{e.name}: {AT_BOUND}; its prior is too narrow, or the model lacks something" for e in estimates]
    said = list_size_warnings(names) + [line for line, e in zip(bound, estimates, strict=True) if e.verdict == AT_BOUND]
    return Identification(
        action=found,
        estimates=tuple(estimates),
        correlation=covariance / np.outer(width, width),
        undetermined=tuple(undetermined),
        determined=tuple(determined),
        warnings=(
            *_list_fit_warnings(best, end, fits, sources),
            *risen,
            *stuck,
            *said,
            *warnings_of(names, covariance),
        ),
        starts=tuple(f.alike for f in fits),
        scatter=scatter,
        scores=scores,
        events=events,
        provenance=_provenance(start, asked, sources, best, options),
        posterior=joint_posterior(problem, best, estimates, sources, sensors),
        sensors=sensors,
        end=end,
        details=Details(problem, best, tuple(profiles), sources, max(budget.left_s, 0.0)),
    )


def check_identifiability(problem: Problem, columns: Columns) -> list[str]:
    """Sentences, before the fit, on parameters of which the strokes will leave over half of the prior's u, from the
    derivatives at z = 0; input error where a parameter moves no angle, data are too few, or the model cannot run."""
    data = sum(t.change_rad.size for t in problem.trials)
    names = [p.name for p in problem.unknowns.asked]
    if data < len(names):
        raise ValidationInputError(f"identify: found {data} data for {len(names)} parameters; record more trials")
    zero = np.zeros(len(problem.unknowns.moved))
    curves = problem.response.curves([zero])[0]
    if curves is None:
        raise ValidationInputError(
            f"identify: the model {problem.action.name} cannot run these strokes; use other values (`overrides`)"
        )
    blocks = columns.blocks(zero)
    effect = np.max([np.abs(b.moved).max(axis=0) for b in blocks], axis=0)
    for name, size in zip(names, effect, strict=False):
        if size < LEAST_EFFECT_RAD:
            raise ValidationInputError(
                f"`parameters` {name}: has no effect in these strokes (no angle moves by {LEAST_EFFECT_RAD:g} rad); "
                "leave it out, or record a stroke in which it acts"
            )
    tight, n = Sizes.tight(problem.families, problem.seen), len(names)
    usual = tight.grown(EXPECTED / float(tight.discrepancy.max()))
    at_best, expected = (Marginal(blocks, sizes).covariance[:n, :n] for sizes in (tight, usual))
    return warnings_before(names, at_best, expected)


def list_bounds_not_run(problem: Problem) -> list[str]:
    """Lines, one for each end of a requested parameter's range, all others at z = 0, at which the model cannot run the
    strokes; empty where it runs at all of them."""
    asked, (low, high) = problem.unknowns.asked, problem.box()
    ends = [(j, side, edge[j]) for j in range(len(asked)) for side, edge in (("lower", low), ("upper", high))]
    points = [at * np.eye(low.size)[j] for j, _, at in ends]
    return [
        f"{asked[j].name}: the model cannot run at the {side} end of its range "
        f"({asked[j].physical(problem.action, at):.3g} {asked[j].unit(problem.action)}); what its interval says beyond "
        "the last value that ran is extrapolated"
        for (j, side, at), curves in zip(ends, problem.response.curves(points), strict=True)
        if curves is None
    ]


def default_budget_s(problem: Problem) -> float:
    """Processor time that a problem of this size may take, s."""
    larger = max(len(problem.unknowns.asked) / LEAST_ASKED, 1.0)
    return BUDGET_S_PER_TRIAL * max(len(problem.trials), LEAST_TRIALS) * larger


def action_at(start: model.Action, asked: Unknowns, z: Array) -> model.Action:
    """The action with all moved parameters at z."""
    values: dict[str, float] = {}
    for parameter, at in zip(asked.moved, z, strict=True):
        values |= parameter.values(start, float(at))
    return start.with_values(values, "identify")


def list_size_warnings(names: Sequence[str]) -> list[str]:
    """One warning, in a list, where more than `MOST_ASKED` parameters are fitted at once, for which intervals were not
    tested; empty for fewer."""
    if len(names) <= MOST_ASKED:
        return []
    return [
        f"{len(names)} values at once: beyond {MOST_ASKED} a fit that settles may be in one of several minima, "
        "its values several standard uncertainties off; ask for fewer"
    ]


def _decide_end(best: Fitted, names: Sequence[str], covariance: Array, determined: Sequence[Combination]) -> End:
    """How the fit ended: *not identifiable* where it converged and leaves over half of the prior's u of every
    parameter, ``covariance`` (n, n) being that of z, else its own end; ``determined`` combinations are named in the
    text."""
    if not best.converged or np.any(np.sqrt(np.diag(covariance)) < HALF):
        return best.end
    known = "; ".join(f"{d.words} ({100 * d.left:.0f} % of its prior uncertainty left)" for d in determined)
    known = f"of their combinations {known}" if known else "nor any combination of them" if len(names) > 1 else ""
    none = f"these strokes do not tell {'any of ' if len(names) > 1 else ''}{', '.join(names)}"
    return End(NOT_IDENTIFIABLE, f"{none}{', ' if known else ''}{known}")


def _list_fit_warnings(best: Fitted, end: End, fits: Sequence[Fitted], sources: Sources) -> list[str]:
    """Warnings on the fit: convergence, bifurcations, model discrepancy, local minima, trials refused."""
    said = [PROVISIONAL, *sources.refused, *sources.notes]
    if not best.converged:
        said.insert(0, f"{end}; these values are the best so far, their intervals too narrow; give more (`budget_s`)")
    if end.kind == BIFURCATION:
        said.append(
            f"{end}: there a third of a standard uncertainty turns the motion by more than twice the noise; what "
            "follows was left out"
        )
    share = measure_lack(best)
    if share > LACKING:
        said.append(
            f"the model lacks something: trials differ from it alike by {100 * share:.0f} % of what all its laws "
            "together could do; intervals hold what that may do to a value"
        )
    apart = [f.alike - best.alike for f in fits]
    if max(apart) > 2.0 * np.log(ODDS):
        other = sum(a > 2.0 * np.log(ODDS) for a in apart)
        better = "" if best.is_slight else "; more starts (`starts`) may find a better one"
        said.append(f"{other} of {len(fits)} fits ended in a worse minimum and are not used{better}")
    if len(sources.fitted) < 5:  # a standard deviation of four is known to a factor of two and more
        said.append(
            f"{len(sources.fitted)} trials fitted: scatter between trials is poorly known; five or more are advised"
        )
    return said


def _provenance(
    start: model.Action, asked: Unknowns, sources: Sources, best: Fitted, options: IdentifyOptions
) -> dict[str, Any]:
    """Plain values that say what an identification started from, was fitted to, and how it ended."""
    before = posterior_of(start)
    return {
        "created_utc": options.now().strftime("%Y-%m-%dT%H:%M:%SZ"),
        "start": start.name,
        "start_sha256": action_sha256(start),
        "model_sha256": code_sha256("model"),
        TRIALS: dict(sources.seals),
        EARLIER: [] if before is None else list(before.trials.values()),
        "fitted_beside": [p.name for p in asked.beside],
        "fitted_small": len(asked.small),
        "fixed": list(options.fixed),
        "paths": {p.name: list(p.paths) for p in asked.asked},
        "steps": best.steps,
        "end": str(best.end),
        "driven_by_the_key": [t.label for t in sources.fitted if t.key is not None],
        "discrepancy": {
            f"session {s + 1}": {CHANNEL_NAMES[c]: float(best.marginal.sizes.discrepancy[s, c]) for c in channels}
            for s, channels in {b.session: b.channels for b in best.marginal.blocks}.items()
        },
    }
