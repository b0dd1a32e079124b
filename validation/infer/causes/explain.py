"""Which causes explain the differences of a session, as sentences, rows of a table and findings.

Trials are sound and of one kind of stroke, until the key is let go. Causes are errors of the session's channels,
changes of the model and effects that it lacks, in all trials, in one, from one on, or drifting. Named is what
`search.find_causes` finds where it leaves nothing that a further cause would explain: one cause or pair, at most
`MOST_NAMED` that the trials cannot tell apart, or what more of them have in common (docs/explanation/differences.md).
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields, replace

import numpy as np
from scipy.special import chdtri

import model
from validation.errors import ValidationInputError
from validation.findings.finding import SessionFinding
from validation.infer.causes.responses import Responses
from validation.infer.causes.score_test import LEVEL
from validation.infer.causes.search import Fit, Found, Search, find_causes
from validation.infer.channels import ERROR_BY_NAME
from validation.infer.hypotheses import ADDED, ALL, FEWEST_TOLD_APART, ONE, TREND, sources
from validation.infer.observations import ObservedTrial, observe
from validation.measurement.measure_session import select_representative
from validation.measurement.trial import MeasuredTrial, trials_in_words
from validation.prediction.joint_draws import chosen_trials
from validation.prediction.model_under_test import ModelUnderTest
from validation.prediction.posterior import TABLE

MOST_TRIALS = 12  # that are searched, by lot where there are more
MOST_NAMED = 3  # causes or pairs that the trials cannot tell apart; of more only what they have in common is named
FINDINGS = {name: error.kind or name for name, error in ERROR_BY_NAME.items()}


@dataclass(frozen=True)
class CompatibleChange:
    """One change of a set that explains the trials."""

    set: int  # number of the set: a cause or a pair, the most probable first
    changes: int  # how many changes the set has: more than are listed where the others are not told apart
    cause: str  # parameter, felt, or error of a channel of the session
    # factor, or what is added in ``unit``, of the last trial of a trend; of an effect with a unit its value
    change: float
    u: float  # its standard uncertainty; relative where ``unit`` is 1
    unit: str  # SI; 1 means a factor
    log_odds: float  # natural logarithm of the set's posterior odds to the most probable one
    left: float  # share of the difference, squared in standard uncertainties, that is left with it
    left_by_noise: float  # share that noise exceeds in one session of a hundred
    profile: str = ALL  # ``all`` trials, ``one``, a ``trend`` that grows evenly, a ``step``
    # first, last: numbers of the first and last trial that has it; of a trend, those between which it grows
    first: int = 0
    last: int = 0

    @property
    def identity(self) -> tuple[str, str, int]:
        """Cause, profile and first trial: what it is but for its size."""
        return self.cause, self.profile, self.first

    @property
    def words(self) -> str:
        """Text on the change: its cause, size, trials and standard uncertainty."""
        when = {ALL: "", ONE: f" in trial {self.first}", TREND: ""}.get(self.profile, f" from trial {self.first} on")
        drift = f" from trial {self.first} to trial {self.last}"
        if self.cause.startswith(ADDED) and self.unit != "1":
            factor, unit = (1e6, "µs") if self.unit == "s" else (1.0, self.unit)
            return (
                f"{self.cause} = {factor * self.change:.3g} {unit} (standard uncertainty {factor * self.u:.2g} {unit})"
            )
        if self.unit == "1":
            places = max(2, 1 - math.floor(math.log10(max(self.u * self.change, 1e-9))))
            size = f"× {self.change:.{places}f}"
            known = f"(standard uncertainty {100 * self.u:.2g} %)"
            if self.profile == TREND:
                rate = 100 * (self.change - 1) / (self.last - self.first)
                return f"{self.cause} drifts by {rate:+.2g} % per trial, {size}{drift} {known}".replace("-", "−")
            return f"{self.cause} {size}{when} {known}"
        factor, unit = {"m": (1e3, "mm"), "s": (1e3, "ms"), "rad": (math.degrees(1.0), "°")}.get(
            self.unit, (1.0, self.unit)
        )
        sign = "−" if self.change < 0 else "+"
        known = f"(standard uncertainty {factor * self.u:.2g} {unit})"
        if self.profile == TREND:
            rate = abs(factor * self.change) / (self.last - self.first)
            total = f"{sign}{abs(factor * self.change):.2g} {unit}"
            return f"{self.cause} drifts by {sign}{rate:.2g} {unit} per trial, {total}{drift} {known}"
        return f"{self.cause} {sign}{abs(factor * self.change):.2g} {unit}{when} {known}"

    @property
    def of_session(self) -> bool:
        """Whether it is a fault of the session: of a channel or a clock."""
        return self.cause in ERROR_BY_NAME


@dataclass(frozen=True)
class Explained:
    """What explains the differences."""

    sentence: str = ""  # empty where the model cannot run, and without trials that can be compared
    changes: tuple[CompatibleChange, ...] = ()  # rows of the sets named
    nothing: bool = False  # whether the difference does not exceed its null distribution
    findings: tuple[SessionFinding, ...] = ()  # causes that some of the trials have


def explain_difference(tested: ModelUnderTest, sound: Sequence[MeasuredTrial], effects: bool = True) -> Explained:
    """Search for causes of the differences between the model and ``sound`` trials of one kind (12 at most, by lot);
    ``effects``: also try effects that the model lacks. Empty `Explained` without trials or a common time span; the
    model's store keeps the result.

    Parameters
    ----------
    tested : known results are reused from its store
    sound : without faults, of one kind of stroke
    effects : whether effects that the model lacks are tried; each compiles a scene of its own once
    """
    if not sound:
        return Explained()
    try:
        trials = observe("validate", 0, choose_trials(sound))
    except ValidationInputError:  # no span in common, or an encoder that stands still
        return Explained()
    return explain_observed(tested, trials, effects)


def explain_observed(tested: ModelUnderTest, trials: Sequence[ObservedTrial], effects: bool = True) -> Explained:
    """Search for causes as `explain_difference` does, in all of ``trials`` as they are compared: of one kind, at the
    same phases, each driven by its force. The result is read from the model's store, or computed and kept there."""
    stated = {path: q.u for path, q in model.quantities_of(tested.action).items()}
    effects = effects and tested.own_model  # a stand-in knows no scenes
    inputs = tested.identity, trials, stated, dict(tested.action.identification.get(TABLE, {})), effects
    found = tested.store.value("causes", inputs, lambda: asdict(_explain(tested, trials, effects)))
    names = [f.name for f in fields(CompatibleChange)]
    changes = tuple(CompatibleChange(**{name: row[name] for name in names}) for row in found["changes"])
    findings = tuple(SessionFinding(**row) for row in found["findings"])
    return Explained(found["sentence"], changes, found["nothing"], findings)


def choose_trials(sound: Sequence[MeasuredTrial]) -> list[MeasuredTrial]:
    """The trial that stands for all, then the others; so many, by lot, where there are more."""
    first = select_representative(list(sound))
    others = [m for m in sound if m is not first]
    return [first, *chosen_trials(others, max_trials=MOST_TRIALS - 1)]


def _explain(tested: ModelUnderTest, trials: Sequence[ObservedTrial], effects: bool) -> Explained:
    listed = [s for s in sources(tested.action, trials[0]) if effects or not s.added]
    found = find_causes(Responses(tested, trials, listed), effects)
    return make_answer(found, [t.number for t in trials])


def make_answer(found: Found, numbers: Sequence[int]) -> Explained:
    """Sentence on what a search ``found`` in the trials ``numbers``, its table rows and findings (these two only where
    one to `MOST_NAMED` sets of causes explain the differences, or more have a cause in common). Empty where the model
    cannot run."""
    search = found.search
    if search is None:
        return Explained()
    where = trials_in_words(sorted(numbers))
    if not found.exceeds:
        return Explained(
            f"until the key is let go, {where} and model differ by no more than force, sensors and stated "
            "uncertainties of the parameters may: no part of the model need have changed",
            nothing=True,
        )
    beyond = _comparison_words(search, len(numbers))
    what = f"what {where} and model differ by until the key is let go"
    if not found.fits or found.left > 1.0:
        return Explained(f"none of the causes that were compared explains {what}, alone or in pairs; {beyond}")
    rows = [row for n, fit in enumerate(found.fits, 1) for row in _make_rows(search, n, fit, found.fits[0])]
    sets = group_by_set(rows)
    first: dict[frozenset[tuple[str, str, int]], list[CompatibleChange]] = {}
    for one in sets:
        first.setdefault(frozenset(row.identity for row in one), one)
    kinds = list(first.values())  # without those that differ in size only
    words = "; ".join(" with ".join(row.words for row in one) for one in sets)
    if len(kinds) > MOST_NAMED:
        return _name_common_cause(sets, kinds, what, beyond)
    alone = "this cause explains" if len(sets[0]) == 1 else "these two causes together explain"
    if len(sets) == 1:
        which = f"{alone} {what}, and no other that was compared does nearly as well"
    elif len(kinds) == 1:
        which = f"{alone} {what}, at either of these sizes, which the trials cannot tell apart"
    else:
        which = f"each of these explains {what}, and the trials cannot tell them apart"
    sentence = f"{_subject_words(rows, len(kinds))}{which}: {words}; {beyond}"
    return Explained(sentence, tuple(rows), findings=_make_findings(sets, where))


def _name_common_cause(
    sets: Sequence[Sequence[CompatibleChange]],
    kinds: Sequence[Sequence[CompatibleChange]],
    what: str,
    beyond: str,
) -> Explained:
    """Answer where more than `MOST_NAMED` sets of other causes, ``kinds``, explain ``what`` differs: the cause that all
    ``sets`` have in common, or none, as where two sets differ in size only."""
    most, common = "the most probable are: ", _find_common_cause(sets) if len(kinds) == len(sets) else None
    if common is None:
        words = "; ".join(" with ".join(row.words for row in one) for one in kinds[:MOST_NAMED])
        return Explained(
            f"{len(kinds)} causes or pairs of causes explain {what} about equally well, so that none is named; "
            f"{most}{words}; {beyond}"
        )
    beside = "; ".join(row.words for one in kinds[:MOST_NAMED] for row in one if row.identity != common.identity)
    other = f"one of {len(kinds)} causes that the trials cannot tell apart"
    told = f"this is a part of what explains {what}; the other part is {other}"
    findings = () if common.profile == ALL else (_make_finding([common], f"{common.words}: {told}"),)
    return Explained(f"{common.words}: {told}; {most}{beside}; {beyond}", (common,), findings=findings)


def _subject_words(rows: Sequence[CompatibleChange], kinds: int) -> str:
    subjects = {row.of_session for row in rows}
    if len(subjects) == 2:
        return f"about the model {'and' if kinds == 1 else 'or'} the session: "
    return _SUBJECTS[subjects.pop()]


_SUBJECTS = {True: "about the session, not the model: ", False: "about the model, not the session: "}


def _comparison_words(search: Search, trials: int) -> str:
    """Text on the kinds of causes that a search compared, on the trials that may have them (only all together where
    ``trials``, their number, is below four), and on what the answer assumes."""
    named = [search.source(i) for i in dict.fromkeys([*search.named, *(j for of in search.alike.values() for j in of)])]
    kinds = dict.fromkeys(re.sub(r"^\w+ encoder (\w+)$", r"\1 of the encoders", s.kind) for s in named if not s.added)
    lacking = len({s.name for s in named if s.added})
    if lacking:
        kinds[f"{lacking} effect{'s' if lacking > 1 else ''} that the model lacks"] = None
    how = "in all trials, and those that may change also in one, from one on or as a drift"
    if trials < FEWEST_TOLD_APART:
        how = "in all trials only, since fewer than four do not tell what single trials have"
    return f"sizes hold if all else is as stated; compared were {', '.join(kinds)}, {how}"


def _make_rows(search: Search, number: int, fit: Fit, best: Fit) -> list[CompatibleChange]:
    """One row for each cause of ``fit``: its size with u, the share of the squared difference that the fit leaves, and
    its log odds to the fit ``best``; ``number``: of the set, from 1."""
    out = []
    u = np.sqrt(np.diag(search.covariance(fit)))
    shared = all(search.responses.candidates[i].profile == ALL for i in fit.members)
    base = search.responses.base
    assert base is not None
    k = search.log_posterior(fit.each, fit.z)[1]
    white = [search.noise.whiten(k, search.turned(each))[: 1 if shared else None] for each in (base, fit.each)]
    before, after = (float(np.sum(part**2)) for part in white)
    left, by_noise = after / before, float(chdtri(white[0].size, LEVEL)) / before
    for i, z, u_z in zip(fit.members, fit.z, u, strict=True):
        c, s = search.responses.candidates[i], search.source(i)
        changed, u_size = s.size(float(z), float(u_z))
        odds = search.evidence(fit) - search.evidence(best)
        change = CompatibleChange(number, len(fit.members), s.name, changed, u_size, s.unit, odds, left, by_noise)
        out.append(replace(change, profile=c.profile, first=c.first, last=c.last))
    return out


def group_by_set(rows: Sequence[CompatibleChange]) -> list[list[CompatibleChange]]:
    """Rows of each set, the sets and their rows in the order that they have."""
    listed: dict[int, list[CompatibleChange]] = {}
    for row in rows:
        listed.setdefault(row.set, []).append(row)
    return list(listed.values())


def _find_common_cause(sets: Sequence[Sequence[CompatibleChange]]) -> CompatibleChange | None:
    """Row of the cause that all sets have, with the standard uncertainty of its size whichever set is right; None where
    they have none in common."""
    for row in sets[0]:
        same = [other for one in sets for other in one if other.identity == row.identity]
        if len(same) == len(sets):
            return _merge_sizes(same)
    return None


def _merge_sizes(same: Sequence[CompatibleChange]) -> CompatibleChange:
    """Row of one cause from its rows in several sets: its size, and its standard uncertainty whichever set is right."""
    share = np.exp([one.log_odds for one in same])
    share /= share.sum()
    factor = same[0].unit == "1"
    size = np.array([math.log(one.change) if factor else one.change for one in same])
    mean = float(share @ size)
    u = math.sqrt(float(share @ (np.array([one.u for one in same]) ** 2 + (size - mean) ** 2)))
    return replace(same[0], set=1, change=math.exp(mean) if factor else mean, u=u)


def _make_findings(sets: Sequence[Sequence[CompatibleChange]], where: str) -> tuple[SessionFinding, ...]:
    """Findings on causes that only some trials have: one for each such cause where all ``sets`` have the same; else a
    single one that names those of all, if each has some; none otherwise. ``where``: the trials, as text."""
    told = f"explains what {where} differ by among themselves"
    partial = [[row for row in one if row.profile != ALL] for one in sets]
    if not all(partial):
        return ()
    if len({frozenset(row.identity for row in rows) for rows in partial}) > 1:
        rows = [row for of in partial for row in of]
        words = "; ".join(dict.fromkeys(row.words for row in rows))
        text = f"each of these {told}, and the trials cannot tell them apart: {words}"
        return (_make_finding(rows, text),)
    out = []
    best = ", and no other cause that was compared does nearly as well" if len(sets) == 1 else ""
    for row in partial[0]:
        others = [other.cause for other in partial[0] if other is not row]
        beside = f"with {others[0]}, " if others else ""
        merged = _merge_sizes([other for rows in partial for other in rows if other.identity == row.identity])
        out.append(_make_finding([merged], f"{merged.words}: {beside}this {told}{best}"))
    return tuple(out)


def _make_finding(rows: Sequence[CompatibleChange], text: str) -> SessionFinding:
    """Finding with this ``text``: the kind and channel of the rows' common error (else *outlying residual* or *changed
    condition*, no channel), their common first trial (NaN for several or a drift), and the first row's size."""
    kinds = {FINDINGS.get(row.cause, "") for row in rows}
    profiles, first = {row.profile for row in rows}, {row.first for row in rows}
    named = len(kinds) == 1 and kinds != {""}
    kind = kinds.pop() if named else "outlying residual" if profiles == {ONE} else "changed condition"
    trial = float(first.pop()) if len(first) == 1 and TREND not in profiles else math.nan
    channel = rows[0].cause.split()[0] if named else ""
    return SessionFinding(kind, trial, channel, rows[0].change, 1.0 if rows[0].unit == "1" else 0.0, text)
