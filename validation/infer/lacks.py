"""What strokes still say where the model lacks something: which change takes the lack away, and what is known with it.

Conventions: what may be lacking is what the search for causes tries (`hypotheses`): effects that the action
does not have, and values that the fit held. Each is let in as one more column of the linear model where the fit ended,
an effect by runs of its scene there; the likeliest are fitted anew with their own size free. Fits that explain the
strokes as well, to a factor of `ODDS`, are all kept: a value is known in spite of the lack where each of them
identifies it and their intervals together do (docs/explanation/identification.md).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

import model
from model.errors import ModelError
from model.parameters.effects import RAIL
from validation.conventions import Array
from validation.errors import ValidationInputError
from validation.infer.blocks import LOST_RAD, Block, rows
from validation.infer.budget import Budget
from validation.infer.estimates import IDENTIFIED, LACKING, NORMAL, Estimate, estimate_all
from validation.infer.fit import Fitted, fit_alike, fit_conditional
from validation.infer.hypotheses import list_addable_effects
from validation.infer.identifiability import HALF, Combination, directions
from validation.infer.noise import ODDS, Marginal
from validation.infer.observations import HAMMER_ALONE, ObservedTrial
from validation.infer.problem import Problem
from validation.infer.response import ModelResponse, Own
from validation.infer.scatter import measure_lack
from validation.infer.unknowns import Parameter, parameter_of, single_names

SIZE_U = 0.4
"""Relative standard uncertainty of an effect's size, of what its file states."""
LIFTING = {RAIL, "key_pin"}
"""Effects that a fit cannot let in: the key's encoder reads the lift of its pivot."""
NEAR, MOST_FITTED = 0.5, 2  # of the best one's gain: what is fitted anew, and how many, of values and of effects
SHOWS, UP, AROUND_S = 4.0, 0.95, 5e-3  # u of a sensor; the blow: share of the hammer's way, s about it

Promise = tuple[float, Parameter, model.Action]
"""Gain of log evidence that the linear model promises, what is let in, and the action that has it."""


@dataclass(frozen=True)
class LetIn:
    """A fit with one change let in; the fit as it was where nothing is."""

    parameter: Parameter | None  # what was let in; None: nothing
    # problem, fitted: the fit
    problem: Problem
    fitted: Fitted
    gain: float = 0.0  # natural logarithm of its evidence over that of the fit as it was

    @property
    def words(self) -> str:
        """Text on the parameter that was freed, with its size."""
        if self.parameter is None:
            return "nothing"
        p, action = self.parameter, self.problem.action
        j = self.problem.unknowns.moved.index(p)
        value, u = p.physical(action, self.fitted.z[j]), float(np.sqrt(self.fitted.covariance[j, j])) * p.u
        unit = p.unit(action)
        u = abs(value) * u if p.factor else u
        return f"{p.name} = {value:.3g}{'' if unit == '1' else ' ' + unit} (standard uncertainty {u:.2g})"


@dataclass(frozen=True)
class Supported:
    """Estimates that hold in spite of the model's discrepancy."""

    let_in: tuple[LetIn, ...]  # fits that explain the strokes as well as the best, the likeliest first
    # of what was asked for, the likeliest fit's values with intervals that hold those of all
    estimates: tuple[Estimate, ...]
    # directions of several parameters that are known, with the value and standard uncertainty of each in units of the
    # prior: sum of weights times z
    combinations: tuple[tuple[Combination, float, float], ...]
    tried: int  # how many changes
    where: str  # which part of the stroke the lack shows in

    @property
    def lines(self) -> tuple[str, ...]:
        """Two sentences: which changes take the model's lack away, and what is known in spite of it."""
        names = [one.words for one in self.let_in if one.parameter is not None]
        known = [e.name for e in self.estimates if e.verdict == IDENTIFIED]
        known += [c.words for c, _, _ in self.combinations]
        first, left = self.let_in[0], max(measure_lack(one.fitted) for one in self.let_in)
        if not names:
            what = f"none of the {self.tried} changes that were let in takes it away"
        elif len(self.let_in) == 1:
            what = (
                f"{names[0]}, let in, takes it away (odds e^{first.gain:.0f}, {100 * left:.2g} % is left), and none "
                f"other of {self.tried} that were tried does"
            )
        else:
            beside = " or nothing" if len(names) < len(self.let_in) else ""
            what = (
                f"each of these, let in alone, takes it away: {'; '.join(names)}{beside}; these strokes do not tell "
                "them apart; a plan ranks strokes that do"
            )
        inside = "in spite of the lack, whichever it is, " if len(self.let_in) > 1 else "in spite of the lack "
        values = {e.name: f"{e.name} {e.value:.4g} ({e.low:.4g} to {e.high:.4g})" for e in self.estimates}
        listed = ", ".join(values.get(name, name) for name in known) or "nothing that was asked for"
        return f"What the model lacks {self.where}: {what}.", f"Known {inside}are: {listed}."


def find_supported_estimates(
    problem: Problem, fitted: Fitted, say: Callable[[str], None], budget: Budget | None = None
) -> Supported | None:
    """Estimates that hold in spite of what the model lacks, from refits each with one held value or effect freed, as
    many as the budget allows; None where nothing seems to be lacking, or any trial is driven by its key. ``say`` gets a
    line a refit."""
    if not isinstance(problem.response, ModelResponse) or any(t.key is not None for t in problem.trials):
        return None
    budget = Budget(math.inf) if budget is None else budget
    best, found = LetIn(None, problem, fitted), []
    kinds = predict_gains(problem, fitted, budget)
    tried = sum(map(len, kinds))
    for gain, parameter, action in _rank_changes(kinds, measure_lack(fitted)):
        say(f"let in: {parameter.name} (the linear model promises e^{gain:.0f})")
        one = None
        with budget.interruptible():
            one = fit_with_change(problem, fitted, parameter, action, math.log(tried), budget)
        if one is not None and one.fitted.converged:
            found.append(one)
    every = sorted([best, *found], key=lambda one: -one.gain)
    kept = tuple(one for one in every if one.gain > every[0].gain - math.log(ODDS))
    if kept == (best,) and measure_lack(fitted) <= LACKING:
        return None
    estimates, combinations = _combine_estimates(kept)
    return Supported(
        kept,
        estimates,
        combinations,
        tried,
        describe_lack_phase(problem, _discrepancy_curves(problem, fitted, kept[0])),
    )


def _rank_changes(kinds: Sequence[Sequence[Promise]], lack: float) -> list[Promise]:
    """Promises (gain, parameter, action) to refit, of ``kinds`` (values held, effects; each the best first): up to
    `MOST_FITTED` of each with gains near the best, and, where ``lack`` (discrepancy, share of the response) is large,
    felts of contacts named.

    A felt twice as stiff is no small change: where the fit ended its linear model may promise less than a law of
    another form, or another place, of the same contact.
    """
    out: list[Promise] = []
    for gains in kinds:
        least = math.log(ODDS * max(len(gains), 1))
        out += [row for row in gains if row[0] > max(least, NEAR * gains[0][0])][:MOST_FITTED]
    named = {row[1].name for row in out}
    contacts = {name.partition(".")[0] for name in named if lack > LACKING} - named
    return out + [row for row in kinds[0] if row[1].name in contacts]


def predict_gains(problem: Problem, fitted: Fitted, budget: Budget) -> list[list[Promise]]:
    """Promises (gain of log evidence by the linear model, parameter, action with it): a list of values that the fit
    held, then one of effects that the action lacks, each the best first; the second is left out where nothing seems
    lacking.

    What an effect promises is what it does as stated; a value that looks like it may promise more, and then keep less.

    Effects compile a scene each, once on a machine: they are tried where something seems to be lacking, or a value that
    was held would explain something.
    """
    marginal, response = fitted.marginal, problem.response
    assert isinstance(response, ModelResponse)
    own = None if fitted.own is None else [fitted.own]
    sizes = replace(marginal.sizes, families=np.insert(marginal.sizes.families, marginal.p, -1))
    before = marginal.log_evidence(fitted.linear)
    out: list[list[Promise]] = []
    for columns_of in (_held_columns, _effect_columns):
        found = []
        for parameter, action, columns in columns_of(problem, fitted, response, own):
            if budget.is_spent:
                break
            if any(np.any(c) for c in columns):
                blocks = [_add_column(b, c) for b, c in zip(marginal.blocks, columns, strict=True)]
                gain = Marginal(blocks, sizes).log_evidence(fitted.linear) - before
                found.append((gain, parameter, action))
        out.append(sorted(found, key=lambda row: -row[0]))
        if measure_lack(fitted) <= LACKING and (not found or out[0][0][0] < math.log(ODDS * len(found))):
            break
    return out


Columns = Iterator[tuple[Parameter, model.Action, list[Array]]]


def _held_columns(
    problem: Problem, fitted: Fitted, response: ModelResponse, own: list[Sequence[Own]] | None
) -> Columns:
    """Yield each parameter that the fit held, the action, and the derivative (c m,) of each trial's curves by it, rad
    per prior standard uncertainty, at the fit's values and random effects."""
    action, unknowns = problem.action, problem.unknowns
    moved = {p.name for p in unknowns.moved}
    names = {n: paths for n, paths in single_names(action).items() if n not in moved}
    held = [p for p in (parameter_of(action, n, paths) for n, paths in names.items()) if p is not None]
    laws = unknowns.held[: problem.held[0].shape[2] if problem.held else 0]
    others = [p for p in held if p.name not in {q.name for q in laws}]
    n = len(unknowns.moved) + len(laws)
    runs = ModelResponse(
        action, (*unknowns.moved, *laws, *others), problem.trials, response.tolerance, response.executor
    )
    jacobian = runs.jacobian(fitted.z, range(len(unknowns.moved), n + len(others)), fitted.own)
    for k, p in enumerate((*laws, *others)):
        yield p, action, _measured_rows(fitted, [j[:, :, k] for j in jacobian])


def _measured_rows(fitted: Fitted, columns: Sequence[Array]) -> list[Array]:
    """Columns (m, c) as rows (c m,), without what a film lost or a fork left out."""
    return [rows(np.nan_to_num(c)) * (b.white < LOST_RAD) for c, b in zip(columns, fitted.marginal.blocks, strict=True)]


def _effect_columns(
    problem: Problem, fitted: Fitted, response: ModelResponse, own: list[Sequence[Own]] | None
) -> Columns:
    """Yield for each effect that the action lacks a parameter of its size, the action with it, and the change (c m,),
    rad, of each trial's curves by the whole effect at the fit's z and random effects ``own``; those that cannot run are
    skipped."""
    action, base = problem.action, response.curves([fitted.z], own)[0]
    for source in list_addable_effects(action) if base is not None else ():
        scene = None if LIFTING & set(source.effects) else source.scene(action, 1.0)
        if scene is None:
            continue
        runs = ModelResponse(
            scene.apply_to(action), response.parameters, problem.trials, response.tolerance, response.executor
        )
        curves = runs.curves([fitted.z], own)[0]
        if curves is not None and base is not None:
            path = source.scaled[0][0]
            parameter = Parameter(path, (path,), SIZE_U, True, "of an effect that was let in")
            yield parameter, runs.action, _measured_rows(fitted, [c - b for c, b in zip(curves, base, strict=True)])


def _add_column(block: Block, column: Array) -> Block:
    return replace(block, moved=np.hstack([block.moved, column[:, None]]))


def fit_with_change(
    problem: Problem,
    fitted: Fitted,
    parameter: Parameter,
    action: model.Action,
    rarity: float,
    budget: Budget | None = None,
) -> LetIn | None:
    """The fit continued with one parameter of ``action`` freed, and its gain of log evidence less ``rarity``, the
    logarithm of how many changes were tried; None where the model cannot run with it."""
    unknowns = problem.unknowns
    held = tuple(p for p in unknowns.held if p.name != parameter.name)
    unknowns = replace(unknowns, beside=(*unknowns.beside, parameter), held=held)
    before = problem.response
    assert isinstance(before, ModelResponse)
    runs = ModelResponse(action, (*unknowns.moved, *held), problem.trials, before.tolerance, before.executor)
    try:
        there = Problem(action, unknowns, problem.trials, runs, _held_columns_without(problem, parameter))
        sizes = replace(fitted.marginal.sizes, families=there.families)
        start = np.insert(fitted.z, unknowns.moved.index(parameter), 0.0)
        found = fit_conditional(there, fit_alike(there, start, sizes), budget=budget)
    except (ModelError, ValidationInputError):
        return None
    same = (
        found.bifurcations == fitted.bifurcations
    )  # else they are of other data, and compare where all trials were as they are
    ends = [f.badness if same else f.alike for f in (fitted, found)]
    return LetIn(parameter, there, found, 0.5 * (ends[0] - ends[1]) - rarity)


def _held_columns_without(problem: Problem, parameter: Parameter) -> tuple[Array, ...]:
    """Columns of fixed laws without those of one that is freed."""
    names = [p.name for p in problem.unknowns.held]
    if parameter.name not in names or not problem.held:
        return problem.held
    return tuple(np.delete(columns, names.index(parameter.name), axis=2) for columns in problem.held)


def _combine_estimates(
    kept: Sequence[LetIn],
) -> tuple[tuple[Estimate, ...], tuple[tuple[Combination, float, float], ...]]:
    """Estimates of the first, likeliest fit with intervals that cover those of all ``kept``, and (combination, value,
    u) of determined combinations of parameters, in prior standard uncertainties; of these none where a fit did not
    converge."""
    each = [estimate_all(one.problem, one.fitted, (), lambda text: None) for one in kept]
    out = []
    for of in zip(*each, strict=True):
        ends = [(e.z - NORMAL * e.z_u, e.z + NORMAL * e.z_u) for e in of]
        width = (max(b for _, b in ends) - min(a for a, _ in ends)) / (2.0 * NORMAL)
        worst = next((e.verdict for e in of if e.verdict != IDENTIFIED), of[0].verdict)
        if worst == IDENTIFIED and width >= HALF:
            worst = "not identified: what is lacking may be one thing or another"
        low, high = min(e.low for e in of), max(e.high for e in of)
        out.append(replace(of[0], low=low, high=high, z_u=max(width, of[0].z_u), verdict=worst))
    n = len(out)
    weight = np.exp([one.gain - kept[0].gain for one in kept])
    weight /= weight.sum()
    z = np.array([one.fitted.z[:n] for one in kept])
    mean = weight @ z
    covariance = sum(
        w * (one.fitted.covariance[:n, :n] + np.outer(at - mean, at - mean))
        for w, one, at in zip(weight, kept, z, strict=True)
    )
    names = [e.name for e in out]
    known = {e.name for e in out if e.verdict == IDENTIFIED}
    settled = all(one.fitted.converged for one in kept)
    combinations = []
    for c in directions(names, np.asarray(covariance))[1] if settled else []:
        if len(c.weights) > 1 and not known.issuperset(c.weights):
            w = np.array([c.weights.get(name, 0.0) for name in names])
            combinations.append((c, float(w @ mean), float(np.sqrt(w @ covariance @ w))))
    return tuple(out), tuple(combinations)


def describe_lack_phase(problem: Problem, lack: Sequence[Array]) -> str:
    """Text on where in the stroke a discrepancy, ``lack`` (m, c) of each trial, rad, first exceeds `SHOWS` u of the
    sensors, and where it is largest.

    Parameters
    ----------
    lack : (m, c) of each trial, what is measured less what the model does without it, rad; of the first session's
        trials the mean counts, so that it is what all share
    """
    first = [t for t in problem.trials if t.session == problem.trials[0].session]
    size = np.abs(np.mean(lack[: len(first)], axis=0)) / np.mean([t.u_white_rad for t in first], axis=0)
    size = np.nan_to_num(size)  # what a film lost
    there = np.flatnonzero(np.any(size > SHOWS, axis=1))
    if there.size == 0:
        return "is below the sensors' noise"
    hammer = np.abs(np.nan_to_num(first[0].change_rad[:, first[0].channels.index(HAMMER_ALONE[0])]))
    blow = float(first[0].time_s[int(np.argmax(hammer > UP * hammer.max()))])

    def phase(index: int) -> str:
        late = float(first[0].time_s[index]) - blow
        if abs(late) < AROUND_S:
            return "at the blow"
        return f"{abs(1e3 * late):.0f} ms {'before' if late < 0 else 'after'} the blow"

    return f"shows from {phase(int(there[0]))} on, most {phase(int(np.argmax(size.max(axis=1))))}"


def _discrepancy_curves(problem: Problem, fitted: Fitted, best: LetIn) -> list[Array]:
    """Discrepancy (m, c), rad, of each trial: curves of the fit ``best`` less those of the model without what it freed;
    measured less predicted by ``fitted`` where it freed nothing or the model cannot run without."""
    z = best.fitted.z
    if best.parameter is not None:
        z = np.delete(z, best.problem.unknowns.moved.index(best.parameter))
        without = problem.response.curves([z])[0]
        if without is not None:
            return [a - b for a, b in zip(best.fitted.curves, without, strict=True)]
    return [np.nan_to_num(t.change_rad - c) for t, c in zip(problem.trials, fitted.curves, strict=True)]


def measure_separation(let_in: Sequence[LetIn], trials: Sequence[ObservedTrial]) -> Array:
    """How far the predictions of the fits ``let_in`` are apart in each stroke (trials,): root mean square over times
    and channels of their range, in standard deviations of the sensors' noise; 0 where one cannot run."""
    out = np.zeros(len(trials))
    for k, trial in enumerate(trials):
        curves = []
        for one in let_in:
            parameters = (*one.problem.unknowns.moved, *one.problem.unknowns.held)
            found = ModelResponse(one.problem.action, parameters, [trial]).curves([one.fitted.z])[0]
            curves += [] if found is None else found
        if len(curves) == len(let_in):
            apart = np.ptp(curves, axis=0) / trial.u_white_rad
            out[k] = float(np.sqrt(np.nanmean(np.square(apart))))  # without what a film lost
    return out
