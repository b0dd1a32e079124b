"""The verdict on a model: its outcome, the sentence that says it, and the table of quantities that it rests on.

Outcomes, in this order: *differs* (an error is resolved and its interval lies beyond the limit of relevance, or the
motion takes a branch that a model without error hardly ever takes); *differs, by less than matters*; *differs,
whether by enough to matter cannot be told*; *agrees within* (nothing is resolved, and every 90 % interval lies inside
its limit: two one-sided tests of 5 %, Schuirmann 1987); *cannot tell*.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import Any

import numpy as np
import pandas as pd

from validation.conventions import LEVEL, Array
from validation.curves.display_signs import SIGN
from validation.measurement.trial import trials_in_words
from validation.result import AGREES, CANNOT_TELL, DIFFERS, DIFFERS_LITTLE, DIFFERS_PERHAPS
from validation.verdict.error_draws import DRAWS, INPUTS, Condition, SessionErrors
from validation.verdict.estimate import RARE_BRANCH, ErrorSample, Estimates, estimate_errors, strongest_inputs
from validation.verdict.evidence import log_evidence
from validation.verdict.quantities import (
    ANGLES,
    INDEX,
    LET_OFF,
    PHASES,
    QUANTITIES,
    RELEVANT,
    Quantity,
    branch_words,
    quantity_limits,
)

FEWEST_DRAWS = DRAWS // 2
SELDOM = LEVEL  # share of the draws on the observed branch, below which the first line says so
MOST_FAILED = 0.2  # of the draws: beyond, those that could be run are a selection
MOST_NAMED = 3  # quantities in the first line
UNTESTED = 10.0  # limits of relevance: where only a larger error would be shown, a session does not test a quantity
NOT_TESTED = "not tested"
FALL = ("drop", "landing")
ANOTHER_FALL = "falls at another time"
COLUMNS = [
    "quantity", "title", "trials", "channel", "phase", "unit", "primary", "travel", "n_trials", "difference",
    "plain_low", "plain_high", "low", "high", "low_90", "high_90", "limit", "ratio", "ratio_limit", "resolved",
    "alone", "detectable_low", "detectable_high", "u", "u_force", "u_sensors", "u_parameters", "u_repeat",
    "main_input", "state",
]  # fmt: skip
FORCE_INPUTS = sum(name.startswith("force ") for name in INPUTS)  # the first of them
PARAMETERS, SCATTER = "parameters of the model as declared", "scatter of the trials"


@dataclass(frozen=True)
class Verdict:
    """What is said of a model on a session."""

    outcome: str  # one of `validation.result.OUTCOMES`
    sentence: str  # the outcome with what it rests on
    # one row a quantity, `COLUMNS`
    quantities: pd.DataFrame = field(default_factory=lambda: pd.DataFrame(columns=COLUMNS))
    facts: Mapping[str, Any] = field(default_factory=dict)  # the test in plain values
    # errors, estimates: what it was made from; None where nothing was drawn
    errors: SessionErrors | None = None
    estimates: Estimates | None = None


def undecided_verdict(reason: str) -> Verdict:
    return Verdict(CANNOT_TELL, f"cannot tell: {reason}.", facts={"judged": False, "reason": reason})


def judge_model(errors: SessionErrors | None, limits: Mapping[str, float]) -> Verdict:
    """Verdict on a model: estimates of its errors, their table and the outcome, in a sentence; undecided where
    ``errors`` is None (no usable trial) or over a fifth of the draws failed. ``limits``: limits of relevance by name.
    """
    if errors is None:
        return undecided_verdict("no trial is usable")
    if errors.failed > MOST_FAILED * DRAWS:
        return undecided_verdict(f"{errors.failed} of {DRAWS} draws of the declared uncertainties cannot be simulated")
    estimates = estimate_errors(errors.sample)
    table = quantity_table(errors, estimates, limits)
    outcome = decide_outcome(table, is_branch_resolved=estimates.is_branch_resolved)
    return Verdict(
        outcome, sentence_of(outcome, table, errors, estimates), table, _facts(errors, estimates), errors, estimates
    )


def _facts(errors: SessionErrors, e: Estimates) -> dict[str, Any]:
    """Plain values of a verdict by name: p and factor of the test, numbers of draws, branch of the motion and its share
    of the draws, trial numbers, logarithm of the evidence and its uncertainty."""
    sample = errors.sample
    found, common = _mean_of_conditions(sample)
    angles = [i for i, q in enumerate(ANGLES) if q.is_primary and np.isfinite(found[i])]
    known = np.isfinite(common[:, angles]).all(axis=1)
    evidence, u_evidence = log_evidence(found[angles], common[known][:, angles], sample.floor[angles])
    return {
        "judged": True,
        "level": LEVEL,
        "rejected": bool(e.resolved.any() or e.is_branch_resolved),
        "p": e.p,
        "factor": e.ratio_limit,
        "draws": int(len(sample.common)),
        "failed_draws": errors.failed,
        "draws_on_branch": int(e.n_draws.min()),
        "branch": "; ".join(dict.fromkeys(branch_words(one.branch, one.known) for one in errors.conditions)),
        "branch_share": float(e.share.min()),
        "trials": list(errors.trials),
        "trials_on_other_branch": sorted(errors.other_branch),
        "drawn_trials": [one.representative for one in errors.conditions],
        "log_evidence": evidence,
        "u_log_evidence": u_evidence,
    }


def _mean_of_conditions(sample: ErrorSample) -> tuple[Array, Array]:
    """Errors found, (Q,), and drawn, (N, Q), each averaged over the conditions, weighted by their numbers of trials; Q
    quantities."""
    shape = len(sample.branch_found), len(QUANTITIES)
    weight = np.where(np.isfinite(sample.found), sample.n_trials, 0).reshape(shape)
    with np.errstate(invalid="ignore"):
        weight = weight / weight.sum(axis=0)
    found, common = sample.found.reshape(shape), sample.common.reshape(-1, *shape)
    of_found, of_common = (np.where(weight == 0, 0.0, weight * part).sum(axis=-2) for part in (found, common))
    return of_found, of_common


def quantity_table(errors: SessionErrors, e: Estimates, limits: Mapping[str, float]) -> pd.DataFrame:
    """Table of model errors with the columns `COLUMNS`, SI, one row for each condition and each quantity whose channel
    was recorded; NaN where it is not estimated, and ``state`` says why. ``limits``: limits of relevance by name."""
    sample = errors.sample
    names = sorted({name for changed in errors.changed for name in changed})
    parameters = np.array([[changed.get(name, 0.0) for name in names] for changed in errors.changed]).reshape(
        len(errors.changed), len(names)
    )
    sensors = e.u_inputs[FORCE_INPUTS:]
    of_force, of_sensors = (np.sqrt((part**2).sum(axis=0)) for part in (e.u_inputs[:FORCE_INPUTS], sensors))
    plain = 1.96 * np.sqrt(of_force**2 + of_sensors**2 + e.u_repeat**2)
    on_branch = (sample.branch == sample.branch_found)[:, sample.condition]
    strongest = strongest_inputs(np.where(on_branch, sample.common, np.nan), parameters, names)
    limit = np.concatenate([quantity_limits(limits, one.travel, one.values) for one in errors.conditions])
    rows = []
    for i, (one, q) in enumerate(product(errors.conditions, QUANTITIES)):
        found = float(sample.found[i])
        if q.channel and q.channel not in one.travel:
            continue
        main = ""
        if np.isfinite(e.low[i]):
            parts = {name: u for name, u in zip(INPUTS, e.u_inputs[:, i], strict=True)}
            parts |= {SCATTER: e.u_repeat[i], PARAMETERS: e.u_other[i]}
            main = max(parts, key=lambda name: parts[name] if np.isfinite(parts[name]) else -1.0)
            if main == PARAMETERS and strongest[i]:
                main += f", mostly {strongest[i]}"
        if q.name in FALL and is_another_fall(one, sample.found[i - INDEX[q.name] :]):
            unknown = dict.fromkeys(COLUMNS, math.nan)
            named = {"quantity": q.name, "title": q.title, "trials": _trials_of_condition(errors, one), "channel": ""}
            rest = {"phase": "", "unit": q.unit, "n_trials": 0, "main_input": "", "state": ANOTHER_FALL}
            rows.append(unknown | named | rest | dict.fromkeys(("primary", "resolved", "alone"), False))
            continue
        values = (
            q.name, q.title, _trials_of_condition(errors, one), q.channel, q.phase, q.unit, q.is_primary,
            one.travel.get(q.channel, math.nan), int(sample.n_trials[i]), found,
            found - plain[i], found + plain[i], e.low[i], e.high[i], e.low_90[i], e.high_90[i], limit[i], e.ratio[i],
            e.ratio_limit, bool(e.resolved[i]), bool(e.alone[i]), e.detectable_low[i], e.detectable_high[i], e.u[i],
            of_force[i], of_sensors[i], e.u_other[i], e.u_repeat[i], main,
            _explain_no_estimate(q, one, found, float(e.low[i])),
        )  # fmt: skip
        rows.append(dict(zip(COLUMNS, values, strict=True)))
    return pd.DataFrame(rows, columns=COLUMNS)


def is_another_fall(condition: Condition, differences: Array) -> bool:
    """Whether model and trials show two different falls of the hammer: one hammer lands before the other drops;
    ``differences``: mean model − trial of each of `QUANTITIES` in this condition, SI."""
    drop, landing = (float(condition.values[INDEX[name] - len(ANGLES)]) for name in FALL)
    moved_drop, moved_landing = drop + differences[INDEX[FALL[0]]], landing + differences[INDEX[FALL[1]]]
    return bool(moved_drop > landing or moved_landing < drop)


def _trials_of_condition(errors: SessionErrors, one: Condition) -> str:
    """Text of a condition's trials; empty where the session holds one condition only."""
    return trials_in_words(one.trials) if len(errors.conditions) > 1 else ""


def _explain_no_estimate(q: Quantity, one: Condition, found: float, low: float) -> str:
    """Reason why quantity ``q`` of condition ``one`` has no estimate, from its difference ``found`` and the lower end
    ``low`` of its interval, NaN where missing; empty where it has one."""
    if not math.isfinite(found):
        if q.channel:
            before = list(PHASES)[: list(PHASES).index(q.phase)][-1:]
            begins = all(np.isfinite(one.values[INDEX[PHASES[phase]] - len(ANGLES)]) for phase in before)
            return "outside the window" if begins else "not recorded"
        return "not in the model" if np.isfinite(one.values[INDEX[q.name] - len(ANGLES)]) else "not in the trials"
    return "" if math.isfinite(low) else "too few draws take this branch of the motion"


def decide_outcome(table: pd.DataFrame, *, is_branch_resolved: bool = False) -> str:
    """One of `validation.result.OUTCOMES` (differs, differs by less than matters, differs perhaps, agrees, cannot tell)
    from a table as of `quantity_table`; a resolved branch of the motion makes it differ."""
    claim = table[table["primary"].astype(bool) & table["difference"].notna()]
    readings = {reading_of(row) for row in claim[claim["resolved"].astype(bool)].itertuples()}
    if is_branch_resolved or DIFFERS in readings:
        return DIFFERS
    if readings:
        return DIFFERS_LITTLE if readings == {DIFFERS_LITTLE} else DIFFERS_PERHAPS
    return AGREES if len(claim) and is_within_limit(claim).all() else CANNOT_TELL


def is_within_limit(rows: Any) -> Any:
    """Whether a 90 % interval lies inside its limit, of a row or of each row of a table: two one-sided tests of 5 %."""
    return (rows.low_90 > -rows.limit) & (rows.high_90 < rows.limit)


def sort_by_importance(table: pd.DataFrame) -> pd.DataFrame:
    """Primary quantities with an interval, by how far it reaches in units of what matters; resolved ones first."""
    known = table[table["primary"].astype(bool) & table["low"].notna()]
    reach = known[["low", "high"]].abs().max(axis=1) / known["limit"]
    return known.assign(reach=reach).sort_values(["resolved", "reach"], ascending=False, kind="stable")


def shown_interval(row: Any, names: tuple[str, str] = ("low", "high")) -> tuple[float, float]:
    """Middle and half width of the interval between two columns of a row of the quantities, in the unit shown, with the
    signs of the thesis."""
    q = QUANTITIES[INDEX[str(row.quantity)]]
    sign = float(SIGN[q.channel]) if q.channel else 1.0
    low, high = (float(getattr(row, name)) for name in names)
    return sign * q.factor * 0.5 * (low + high), q.factor * 0.5 * (high - low)


def format_interval(middle: float, half: float, unit: str, *, is_signed: bool = True) -> str:
    """Text ``middle ± half unit``, rounded to one digit of ``half``, two if it begins with 1, and to three decimals at
    most; ``middle`` has a plus sign unless ``is_signed`` is False."""
    places = 2
    if half > 0:
        first = math.floor(math.log10(half))
        places = min(max(0, (half < 2 * 10.0**first) - first), 3)  # a half width that begins with 1 has two digits
    joined = " " if unit and unit != "°" else ""
    rounded = round(middle, places) + 0.0  # no minus before zero
    number = f"{rounded:+.{places}f}" if is_signed and rounded else f"{rounded:.{places}f}"
    return f"{number} ± {half:.{places}f}{joined}{unit}".replace("-", "−")


def title_of(row: Any) -> str:
    """Title of a quantity, with its trials where the session holds several conditions."""
    return f"{row.title} of {row.trials}" if row.trials else str(row.title)


def quantity_words(row: Any, names: tuple[str, str] = ("low", "high")) -> str:
    """Text of a row of `quantity_table`: its title with the interval between the columns ``names``, by default the 95 %
    one of the error, in the unit shown; of an angle also in percent of the travel."""
    q = QUANTITIES[INDEX[str(row.quantity)]]
    middle, half = shown_interval(row, names)
    text = f"{title_of(row)} {format_interval(middle, half, q.unit_shown)}"
    if q.channel and row.travel > 0:
        share = 100.0 / (q.factor * row.travel)
        text += f" ({format_interval(share * middle, share * half, '%', is_signed=False)} of its travel)"
    return text


def reading_of(row: Any) -> str:
    """Reading of one row of `quantity_table`: one of the outcomes that differ where it is resolved, else ``alone``,
    ``within its limit``, ``not tested`` or ``not resolved``; without an estimate the reason."""
    if not math.isfinite(row.low):
        return str(row.state) or "not estimated"
    if row.resolved:
        if row.low > row.limit or row.high < -row.limit:
            return DIFFERS
        return DIFFERS_LITTLE if -row.limit <= row.low and row.high <= row.limit else DIFFERS_PERHAPS
    if row.alone:
        return "alone"
    if is_within_limit(row):
        return "within its limit"
    return NOT_TESTED if is_untested(row) else "not resolved"


def is_untested(row: Any) -> bool:
    """Whether only an error beyond `UNTESTED` limits of relevance would be shown."""
    return bool(row.primary and max(-row.detectable_low, row.detectable_high) > UNTESTED * row.limit)


def sentence_of(outcome: str, table: pd.DataFrame, errors: SessionErrors, e: Estimates) -> str:
    """Verdict in sentences: the outcome and what it rests on, the model errors that matter most with their 95 %
    intervals, what was not tested, and reservations; ``table`` is that of `quantity_table`."""
    ordered = sort_by_importance(table)
    is_tested = np.array([reading_of(row) != NOT_TESTED for row in ordered.itertuples()], dtype=bool)
    untested, ordered = list(ordered[~is_tested].itertuples()), ordered[is_tested]
    named = list(ordered.itertuples())
    parts = []
    if outcome == AGREES:
        parts.append(f"agrees within {_largest_ends(ordered)}")
    elif outcome == CANNOT_TELL:
        parts.append(f"cannot tell{_describe_undecided(ordered, untested)}")
    elif e.is_branch_resolved:
        k = int(np.argmin(e.share))
        one, n = errors.conditions[k], len(errors.sample.common)
        parts.append(
            f"differs: in {_trials_of_condition(errors, one) or 'the trials'} {branch_words(one.branch, one.known)}, "
            f"which a model without error does in {_percent(e.share[k])} of {n} draws of the declared uncertainties"
        )
    else:
        parts.append(outcome)
    shown = [row for row in named if row.resolved] if outcome not in (AGREES, CANNOT_TELL) else named
    if shown:
        parts.append(f"Model error (95 % interval): {'; '.join(map(quantity_words, shown[:MOST_NAMED]))}")
    if untested and (outcome != CANNOT_TELL or len(ordered)):
        parts.append(_untested_words(untested))
    parts += _reservations(table, errors, e)
    return ". ".join(parts) + "."


def _largest_ends(ordered: pd.DataFrame) -> str:
    """Text of the largest end of the 90 % intervals in rows of `quantity_table`, one for each limit of relevance, in
    the unit shown and with its quantity."""
    words = []
    for name in RELEVANT:
        own = [row for row in ordered.itertuples() if QUANTITIES[INDEX[str(row.quantity)]].relevant == name]
        if not own:
            continue
        row = max(own, key=lambda r: max(abs(r.low_90), abs(r.high_90)) / r.limit)
        q, end = QUANTITIES[INDEX[str(row.quantity)]], max(abs(row.low_90), abs(row.high_90))
        if name == "travel":
            words.append(f"{q.factor * end:.2g}° ({100.0 * end / row.travel:.2g} % of travel, {title_of(row)})")
        else:
            words.append(f"{q.factor * end:.2g} {q.unit_shown} ({title_of(row)})")
    return ", ".join(words)


def _untested_words(rows: Sequence[Any]) -> str:
    """Text on the quantities of these rows of `quantity_table`, which the trials do not test, with the least error that
    would be shown, in the unit shown."""
    parts = []
    for row in rows:
        q = QUANTITIES[INDEX[str(row.quantity)]]
        unit = q.unit_shown if q.unit_shown == "°" else f" {q.unit_shown}"
        parts.append(f"{title_of(row)} ({detectable_words(row)}{unit})")
    return f"Not tested, since only so large an error would be shown: {', '.join(parts)}"


def _describe_undecided(ordered: pd.DataFrame, untested: Sequence[Any]) -> str:
    """End of the sentence ``cannot tell``: the detectable error farthest over its limit, its main input and what would
    halve it, and the quantities that agree; ``ordered``, ``untested``: rows of `quantity_table`, tested and not."""
    inside = is_within_limit(ordered)
    if inside.all():
        if not len(ordered):
            if not untested:
                return ": no quantity of the claim has an interval"
            return f": these trials test no primary quantity. {_untested_words(untested)}"
        return f". All that is tested agrees within {_largest_ends(ordered)}"
    far = ordered[["detectable_low", "detectable_high"]].abs().max(axis=1) / ordered["limit"]
    row = next(ordered[~inside].assign(far=far).sort_values("far").iloc[::-1].itertuples())
    q = QUANTITIES[INDEX[str(row.quantity)]]
    unit = q.unit_shown if q.unit_shown == "°" else f" {q.unit_shown}"
    text = (
        f": an error of {detectable_words(row)}{unit} in {title_of(row)} would be shown in 80 % of sessions "
        f"(limit {q.factor * row.limit:.2g}{unit}); most of it comes from {row.main_input}, and {describe_halving(row)}"
    )
    if inside.any():
        share = f"{int(inside.sum())} of {len(ordered)} primary quantities agree{'s' if inside.sum() == 1 else ''}"
        text += f". {share} within {_largest_ends(ordered[inside])}"
    return text


def detectable_words(row: Any) -> str:
    """Text, without unit, of the least error that the test would show of a row of `quantity_table`, in its unit shown:
    one number, or that of either sign where they differ by a tenth or more."""
    q = QUANTITIES[INDEX[str(row.quantity)]]
    sign = float(SIGN[q.channel]) if q.channel else 1.0
    low, high = sorted(sign * q.factor * y for y in (row.detectable_low, row.detectable_high))
    if max(-low, high) < 1.1 * min(-low, high):  # a tenth
        return _plain_digits(max(-low, high))
    return f"−{_plain_digits(-low)} or +{_plain_digits(high)}"


def _plain_digits(value: float) -> str:
    """Two significant digits, never in powers of ten."""
    return f"{float(f'{value:.2g}'):g}"


def describe_halving(row: Any) -> str:
    """Text on what would halve the detectable error of a row of `quantity_table`: more trials, or a smaller uncertainty
    of the input, force, sensors or parameters, that contributes most."""
    parts = {"force": row.u_force, "sensors": row.u_sensors, "parameters": row.u_parameters, "scatter": row.u_repeat}
    squares = {name: float(u) ** 2 for name, u in parts.items() if np.isfinite(u)}
    total = sum(squares.values())
    words = {
        "force": "the uncertainty of the force",
        "sensors": "the uncertainty of sensors and levels",
        "parameters": "the uncertainty of the parameters",
        "scatter": "the scatter",
    }
    if not total > 0:
        return "what would halve it is not known"
    most = max(squares, key=lambda name: squares[name])
    left = 0.25 * total - (total - squares[most])
    if left > 0:
        factor = math.sqrt(squares[most] / left)
        if most == "scatter":
            return f"{math.ceil(row.n_trials * factor**2)} trials instead of {row.n_trials} would halve it"
        return f"{words[most]} divided by {factor:.2g} would halve it"
    second = max((name for name in squares if name != most), key=lambda name: squares[name])
    return f"to halve it, both {words[most]} and {words[second]} must shrink"


def _reservations(table: pd.DataFrame, errors: SessionErrors, e: Estimates) -> list[str]:
    """Sentences, without full stop, on what limits an outcome: several conditions, an untested let-off, few draws on
    the observed branch, conditions of two trials, trials on another branch; empty if nothing does."""
    said = []
    if len(errors.conditions) > 1:
        names = "; ".join(trials_in_words(one.trials) for one in errors.conditions)
        said.append(f"{len(errors.conditions)} conditions, each estimated by itself: {names}")
        resolved = set(table.loc[table["resolved"].astype(bool), "trials"])
        quiet = [
            name
            for k, one in enumerate(errors.conditions)
            if (name := _trials_of_condition(errors, one)) not in resolved and e.share[k] > RARE_BRANCH
        ]
        if resolved and quiet:
            said.append(f"Nothing is resolved in {'; '.join(quiet)}")
    n = len(errors.sample.common)
    for k, one in enumerate(errors.conditions):
        name = _trials_of_condition(errors, one)
        let_off = table[(table["quantity"] == LET_OFF.name) & (table["trials"] == name)]
        if let_off["difference"].isna().all():
            is_reached = bool((let_off["state"] != "not in the trials").any())
            where = "the model does not reach it" if is_reached else "no trial reaches it"
            said.append(f"Let-off{f' in {name}' if name else ''} is not tested: {where}")
        if e.n_draws[k] < FEWEST_DRAWS or (e.share[k] < SELDOM and not e.is_branch_resolved):
            what = f"what {name or 'the trials'} do ({branch_words(one.branch, one.known)})"
            said.append(f"Only {e.n_draws[k]} of {n} draws do {what}")
    pairs = "; ".join(trials_in_words(one.trials) for one in errors.conditions if len(one.trials) == 2)
    if pairs:
        said.append(f"Of two trials ({pairs}) the scatter is hardly known, which makes the intervals wide")
    if errors.other_branch:
        numbers = trials_in_words(sorted(errors.other_branch))
        words = branch_words(*next(iter(errors.other_branch.values())))
        said.append(f"Not in these figures: {numbers}, in which {words}")
    return said


def _percent(share: float) -> str:
    return f"{100 * share:.2g} %" if share > 0 else "none"


def curve_errors(verdict: Verdict, channel: int) -> tuple[Array, Array]:
    """Times (n,), s, and at each the standard uncertainty (n,), rad, that what is common to the trials makes of the
    difference model − trial of the channel with index ``channel``; both empty where nothing was drawn."""
    errors = verdict.errors
    if errors is None:
        return np.empty(0), np.empty(0)
    here = errors.sample.branch[:, 0] == errors.sample.branch_found[0]
    curves = errors.curves[here, :, channel].astype(float)
    known = np.isfinite(curves).any(axis=0) if len(curves) else np.zeros(errors.time_s.size, dtype=bool)
    u = np.full(errors.time_s.size, np.nan)
    if known.any():
        whole = np.isfinite(curves).all()  # `nanquantile` goes through the times one by one
        low, high = (np.quantile if whole else np.nanquantile)(
            curves[:, known], [LEVEL / 2.0, 1.0 - LEVEL / 2.0], axis=0
        )
        u[known] = (high - low) / (2 * 1.96)
    return errors.time_s, u


def right_rmse(verdict: Verdict, channel: int, ends_s: Array) -> Array:
    """RMSE, rad, that a model without error reaches in one trial between the two times ``ends_s``, s, in each draw on
    the observed branch, (k,), in the channel with index ``channel``; empty where nothing was drawn."""
    errors = verdict.errors
    if errors is None:
        return np.empty(0)
    here = errors.sample.branch[:, 0] == errors.sample.branch_found[0]
    inside = (errors.time_s >= ends_s[0]) & (errors.time_s <= ends_s[1])
    curves = errors.curves[here][:, inside, channel].astype(float)
    known = np.isfinite(curves).any(axis=1)
    return np.asarray(np.sqrt(np.nanmean(curves[known] ** 2, axis=1)))
