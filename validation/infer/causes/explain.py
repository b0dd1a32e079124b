"""Which causes explain the differences of a session: the answer, as sentences, rows of a table and findings.

Conventions: trials of one kind without faults, until the key is let go. Causes are faults of the session, changes of
the model and effects that it lacks alike. First is asked what the trials differ by among themselves (one trial, a
trend, a step), where nothing is named also with the change in place that comes nearest what all share; then what all
share, beside that. Named are all sets of the smallest size that is as good as any larger one to a factor of `ODDS`, and
sets with one change more that hold none of these and are as good; where that is one set of what all share, also those
that hold it with one or two changes more and are as good. None where "the model lacks something else" is better than
all of them by that factor (docs/explanation/differences.md).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace

import numpy as np

import model
from validation.conventions import Array
from validation.errors import ValidationInputError
from validation.findings.finding import SessionFinding
from validation.infer.blocks import make_blocks
from validation.infer.causes.responses import (
    ADDED,
    ALL,
    ENCODER_SCALES,
    FEWEST_TOLD_APART,
    LEAST_ADDED,
    ONE,
    SESSION_ERRORS,
    TREND,
    Responses,
    known_root,
    sources,
)
from validation.infer.causes.search import BETWEEN, HALF, MEAN, Evidence, Followed, Search
from validation.infer.observations import ENCODERS, ObservedTrial, observe
from validation.infer.unknowns import FORCE_DELAY, FORCE_GAIN, FORCE_LEVEL
from validation.measurement.measure_session import representative
from validation.measurement.trial import MeasuredTrial, trials_in_words
from validation.prediction.joint_draws import chosen_trials
from validation.prediction.model_under_test import ModelUnderTest
from validation.prediction.posterior import TABLE

ODDS = 20.0
LOOK = 20.0  # log odds that the linear model promises, from which on is looked for what some trials differ by
SURE = 100.0
"""Log odds from which on a cause is named: near a fork of the motion what blows scatter by bends more than the noise of
the odds knows, and effects too small to be told leave as much."""
MOST_LAWS = 3
MOST_APART = 2  # changes that some trials have
MOST_NAMED = 6
MOST_TRIALS = 12
ENOUGH = 0.05  # of the squared difference between trials: a set that leaves less needs no further change
SMALLEST_CHANGE = 0.5  # of how far off a value may be: 2.5 % of the force, 15 % of a law; less is scatter of the blows
SMALLEST_DIFFERENCE = 4e-3  # of the range of a channel, root mean square: below, nothing is looked for
MINOR = 0.1  # of the log odds that a cause gains: what others gain beside it
MORE_LEFT = 2.0  # times what the best set leaves of a squared difference
FAR = 3.0  # times the margin: a fourth change that promises so much is not looked at more closely
ABOUT = "about the model, not a fault of the session: "
MODEL = "about the model: "
SESSION = "about the session, not the model: "
EITHER = "about the model or the session: "
BESIDE = "beside that, "
SLOWEST_RAD_S = 15.0  # of the hammer: slower strokes lie nearer a fork of the motion
SOFT = "; of strokes as soft as these one such finding in ten was wrong where that was tried"
TOO_SOFT = (
    "until the key is let go, {where} and model differ by more than stated uncertainties; which causes may explain "
    "that is not said of strokes as soft as these, since half of such answers were wrong where that was tried"
)
SOFT_APART = (
    "{where} differ among themselves by more than force and sensors may, as soft strokes do; which cause may explain "
    "that is not said of strokes as soft as these, since such answers were wrong where nothing was planted"
)
FINDINGS = {FORCE_GAIN: "force gain", FORCE_LEVEL: "force level", FORCE_DELAY: "force delay"}
FINDINGS |= dict.fromkeys(ENCODER_SCALES, "encoder scale")


@dataclass(frozen=True)
class CompatibleChange:
    """One change of a set that explains the trials."""

    # number of the set: those of what trials differ by, then of what all share; smaller sets first, then by evidence
    set: int
    changes: int  # how many changes the set has
    cause: str  # parameter, felt, or error of a channel of the session
    change: float  # factor, or what is added in ``unit``; of a trend that of the last trial
    u: float  # its standard uncertainty; relative where ``unit`` is 1
    unit: str  # SI; 1 means a factor
    log_odds: float  # natural logarithm of the set's evidence over that of the best of the smallest sets
    left: float  # share of the squared difference that is left with it: of the trials' mean, or of what they differ by
    profile: str = ALL  # ``all`` trials, ``one``, a ``trend`` that grows evenly, a ``step``
    # first, last: numbers of the first and last trial that has it
    first: int = 0
    last: int = 0

    @property
    def words(self) -> str:
        """The change for a reader."""
        when = {ALL: "", ONE: f" in trial {self.first}", TREND: ""}.get(self.profile, f" from trial {self.first} on")
        drift = f" from trial {self.first} to trial {self.last}"
        if self.cause.startswith(ADDED) and self.unit != "1":
            return f"{self.cause} = {self.change:.3g} {self.unit} (u {self.u:.1g})"
        if self.unit == "1":
            places = max(2, 1 - math.floor(math.log10(max(self.u * self.change, 1e-9))))
            size = f"× {self.change:.{places}f}"
            known = f"(u {100 * self.u:.2g} %)"
            if self.profile == TREND:
                rate = 100 * (self.change ** (1 / (self.last - self.first)) - 1)
                return f"{self.cause} drifts by {rate:+.2g} % per trial, {size}{drift} {known}".replace("-", "−")
            return f"{self.cause} {size}{when} {known}"
        factor, unit = {"m": (1e3, "mm"), "s": (1e3, "ms")}.get(self.unit, (1.0, self.unit))
        sign = "−" if self.change < 0 else "+"
        known = f"(u {factor * self.u:.1g})"
        if self.profile == TREND:
            rate = abs(factor * self.change) / (self.last - self.first)
            return f"{self.cause} drifts by {sign}{rate:.2g} {unit} per trial{drift} {known}"
        return f"{self.cause} {sign}{abs(factor * self.change):.2g} {unit}{when} {known}"

    @property
    def of_session(self) -> bool:
        """Whether it is a fault of the session: of a channel or a clock."""
        return self.cause in SESSION_ERRORS


@dataclass(frozen=True)
class Explained:
    """What explains the differences."""

    sentence: str = ""  # of what all trials share; empty where nothing was looked for
    changes: tuple[CompatibleChange, ...] = ()  # rows of the sets named
    nothing: bool = False  # whether no part of the model need have changed
    findings: tuple[SessionFinding, ...] = ()  # what some of the trials differ from the others by
    soft: bool = False  # whether no cause of what all trials share is named since the strokes are too soft


def explain_difference(
    tested: ModelUnderTest, sound: Sequence[MeasuredTrial], effects: bool = True, between: bool = False
) -> Explained:
    """Sets of causes that explain what trials and model, and the trials among themselves, differ by.

    Parameters
    ----------
    tested : known results are reused from its store
    sound : without faults, of one kind of stroke
    effects : whether effects that the model lacks are tried; each compiles a scene of its own once
    between : whether what all trials share is only asked for where something is found that they differ by
    """
    if not sound:
        return Explained()
    try:
        trials = observe("validate", 0, _chosen(sound))
    except ValidationInputError:  # no span in common
        return Explained()
    return explain_observed(tested, trials, effects, between)


def explain_observed(
    tested: ModelUnderTest, trials: Sequence[ObservedTrial], effects: bool = True, between: bool = False
) -> Explained:
    """`explain_difference` for trials of one kind as they are compared, at the same times, each driven by its force."""
    stated = {path: q.u for path, q in model.quantities_of(tested.action).items()}
    effects = effects and tested.own_model  # a stand-in knows no scenes
    inputs = tested.identity, trials, stated, dict(tested.action.identification.get(TABLE, {})), (effects, between)
    found = tested.store.value("compatible changes", inputs, lambda: asdict(_explain(tested, trials, effects, between)))
    names = [f.name for f in fields(CompatibleChange)]
    changes = tuple(CompatibleChange(**{name: row[name] for name in names}) for row in found["changes"])
    findings = tuple(SessionFinding(**row) for row in found["findings"])
    return Explained(found["sentence"], changes, found["nothing"], findings, found["soft"])


def _soft(trials: Sequence[ObservedTrial]) -> bool:
    """Whether the hammer stays below `SLOWEST_RAD_S` in most trials."""
    fastest = [np.abs(np.diff(t.column("hammer")) / np.diff(t.time_s)).max() for t in trials]
    return bool(np.median(fastest) < SLOWEST_RAD_S)


def _chosen(sound: Sequence[MeasuredTrial]) -> list[MeasuredTrial]:
    """The trial that stands for all, then the others; so many, evenly chosen, where there are more."""
    first = representative(list(sound))
    others = [m for m in sound if m is not first]
    return [first, *chosen_trials(others, most=MOST_TRIALS - 1)]


def _explain(tested: ModelUnderTest, trials: Sequence[ObservedTrial], effects: bool, between: bool) -> Explained:
    listed = [s for s in sources(tested.action, trials[0]) if effects or not s.added]
    responses = Responses(tested, trials, listed)
    each = responses.base
    if each is None or _small(trials, each):
        return Explained()
    nothing = Followed((), np.zeros(0), each, np.zeros((each.shape[1], 0)))

    def around(start: Followed, at: Followed, before: Search | None, asked: int) -> Search:
        return linearised(tested, responses, (start, at), before, asked)

    return decide(around, nothing, [t.number for t in trials], between, _soft(trials))


def _small(trials: Sequence[ObservedTrial], each: Array) -> bool:
    """Whether the mean difference, and what the trials differ by, are both too small to be looked at."""
    extent = np.repeat(np.ptp(trials[0].change_rad, axis=0), trials[0].time_s.size)
    if np.any(extent == 0.0):
        return True
    mean = each.mean(axis=0)
    apart = np.sqrt(np.mean(((each - mean) / extent) ** 2, axis=1)).max() if len(each) >= FEWEST_TOLD_APART else 0.0
    return bool(max(apart, np.sqrt(np.mean((mean / extent) ** 2))) < SMALLEST_DIFFERENCE)


def linearised(
    tested: ModelUnderTest,
    responses: Responses,
    points: tuple[Followed, Followed],
    before: Search | None,
    asked: int,
) -> Search:
    """Derivatives of everything around a set, and the noise they make up there.

    Parameters
    ----------
    tested, responses : what runs
    points : what is taken for granted, and the set
    before : that around another set: derivatives are found again of what is noise there; others, and what the force's
        noise does, are kept. Around the same set all are.
    """
    (start, at), listed, trials = points, responses.listed, responses.trials
    wanted = [j for j, s in enumerate(listed) if not s.added]  # these: `Search.with_effects`
    if before is not None:
        wanted = [] if before.around.members == at.members else before.noise
    exact = responses.exact(at.point) if at.members and (wanted or at is start) else None
    if exact is not None:
        start, at = (replace(one, each=exact) if one is at else one for one in points)
    columns = np.zeros((at.each.shape[1], len(listed))) if before is None else before.columns.copy()
    found = responses.columns([(at.point, 0, j) for j in wanted], len(wanted) * [at.each])
    for j, column in zip(wanted, found, strict=True):
        columns[:, j] = column
    if before is not None and not wanted:
        before.evidence.settle()
        return Search(responses, before.evidence, (start, at), (columns, before.force), asked)
    laws, scatter = np.array([s.law for s in listed]), np.array([s.scatter for s in listed])
    shaped = np.moveaxis(columns.reshape(len(ENCODERS), -1, len(listed)), 0, 1)
    force = responses.force_columns(at.point, at.each) if before is None else before.force
    (block,) = make_blocks(trials[:1], [shaped], [force], laws)
    evidence = Evidence(block, scatter, known_root(tested.action, listed), at.each)
    return Search(responses, evidence, (start, at), (columns, force), asked)


@dataclass(frozen=True)
class Answer:
    """What one part of the search found."""

    # sets named, with their log odds; none where nothing need be sought or nothing explains it
    near: tuple[tuple[Followed, float], ...]
    search: Search  # the last one
    nothing: bool = False  # whether nothing need be sought
    gained: float = 0.0  # log odds of the best set over none


Around = Callable[[Followed, Followed, Search | None, int], Search]
Sets = dict[int, list[Followed]]


def decide(
    around: Around, nothing: Followed, numbers: Sequence[int], between: bool = False, soft: bool = False
) -> Explained:
    """Which sets are named.

    Parameters
    ----------
    around : given what is taken for granted, a set, the last search and what is asked: the search with derivatives and
        noise found around the set
    nothing : the model as it is
    numbers : of the trials
    between : whether what all share is only asked for where they are found to differ
    soft : whether the strokes are too soft for causes of what all share to be named
    """
    where = trials_in_words(sorted(numbers))
    told = Answer((), around(nothing, nothing, None, BETWEEN), nothing=True)
    if len(numbers) >= FEWEST_TOLD_APART:
        told = _answer(around, told.search, MOST_APART)
    if soft and any(not row.of_session for row in _changes(told)):
        return Explained(SOFT_APART.format(where=where), soft=True)
    told = _telling(told)
    if not soft and not told.near and told.gained > SURE:
        told = _beside_shared(around, nothing, told)
    apart = _changes(told)
    found = findings_of(apart, where, told.search.tried)
    if soft:
        found = tuple(replace(f, text=f.text + SOFT) for f in found)
    if between and not found:
        return Explained()
    if not told.near and told.gained > SURE:  # the mean of trials that differ, and no one knows by what, is no trial's
        if soft:
            return Explained(SOFT_APART.format(where=where), soft=True)
        return Explained(
            f"none of the causes that were tried explains what {where} differ by among themselves; what all share is "
            f"not looked for; tried were {told.search.tried}, each in one trial, from one on, or as a drift"
        )
    granted = told.search.alone(told.near[0][0]) if told.near else nothing
    search = around(granted, granted, told.search, MEAN)
    if soft:
        shared = Answer((), search, nothing=search.fits(granted) or search.promised(granted) < LOOK)
    else:
        shared = _answer(around, search, MOST_LAWS)
    rows = _changes(shared, len(told.near) + 1)
    withheld = soft and not shared.nothing
    sentence = TOO_SOFT.format(where=where) if withheld else _sentence(rows, where, shared)
    if apart:
        sentence = BESIDE + sentence.replace(ABOUT, MODEL)
    elif not told.nothing or told.search.promised(nothing) > math.log(ODDS):  # they may differ, by less than is named
        sentence = sentence.replace(ABOUT, MODEL)
    if len(numbers) < FEWEST_TOLD_APART:
        sentence = sentence.replace(ABOUT, MODEL) + "; a fault of single trials was not looked for in fewer than four"
    return Explained(sentence, (*apart, *rows), shared.nothing and not apart, found, withheld)


def _changes(answer: Answer, first: int = 1) -> list[CompatibleChange]:
    """The changes of all sets named, these numbered from ``first``."""
    return [row for n, (one, odds) in enumerate(answer.near, first) for row in _rows(answer.search, n, one, odds)]


def _telling(told: Answer) -> Answer:
    """What some trials differ by; nothing where a law leaves most of it."""
    most = any(row.left > HALF for row in _changes(told) if not row.of_session)
    return replace(told, near=()) if most else told


def _beside_shared(around: Around, nothing: Followed, told: Answer) -> Answer:
    """What trials differ by with the one change in place that comes nearest what all share, where none was named.

    Trials of unlike strength answer what all share unlike. Of the change only its answer counts: it need not be right.
    """
    search, sets = _sought(around, around(nothing, nothing, told.search, MEAN), 1)
    shared, _, scores = _weighed(search, sets)
    if search.log_evidence(shared) < max(scores[0]) + SURE:
        return told
    beside = _telling(_answer(around, around(shared, shared, search, BETWEEN), MOST_APART))
    return beside if beside.near else told


def _sought(around: Around, search: Search, most: int) -> tuple[Search, Sets]:
    """The last search, and the sets it found by size, up to so many changes."""
    margin, start, asked = math.log(ODDS), search.start, search.asked
    sets: Sets = {0: [start]}
    best, _, scores = _weighed(search, sets)
    for size in range(1, most + 1):
        first = size == 1 and (asked == BETWEEN or search.fits(start))
        if search.promised(best) < (LOOK if first else margin):
            break
        found = _large(search, search.of_size(size, best))
        if not found:
            break
        sets[size] = found
        if size == 1 and asked == MEAN:
            search = search.with_effects()
            sets[1] += search.effects(sets[1])
        best, _, scores = _pared(search, sets)
        if asked == BETWEEN and search.own(best.members) and search.log_evidence(best) > max(scores[0]) + SURE:
            n = len(search.own(best.members))
            sets[n] = search.better([*sets[n], *_large(search, search.twins(best))])
            best, _, scores = _pared(search, sets)
        enough = asked == BETWEEN and search.left(best) < ENOUGH
        if size == most and search.promised(best) > FAR * margin:
            break
        if search.own(best.members):  # what is known, and the sizes of the changes, look otherwise from there
            search = around(start, best, search, asked)
            sets = {n: _large(search, moved) if n else moved for n, moved in search.again(sets).items()}
            best, _, scores = _weighed(search, sets)
        if enough:
            break
    return search, sets


def _answer(around: Around, search: Search, most: int) -> Answer:
    """The sets that explain what is asked, up to so many changes."""
    margin, start, asked = math.log(ODDS), search.start, search.asked
    search, sets = _sought(around, search, most)
    best, lacks, scores = _pared(search, sets)
    top = max(max(score) for score in scores.values() if score)
    gained = top - max(scores[0])
    if search.promised(best) >= (SURE if asked == BETWEEN else margin) and len(search.own(best.members)) == most:
        lacks = math.inf  # more would be named; of fewer, what is promised beyond them has been run
    if search.own(best.members) and not (search.fits(best) or (asked == BETWEEN and search.left(best) < ENOUGH)):
        lacks = math.inf  # the best of bad ones
    if lacks > top + margin or best.rough > SURE:
        return Answer(tuple((one, 0.0) for one in _main(search, sets, best)), search, gained=gained)
    margin = max(margin, best.rough)  # a fork of the motion is near: no set is better by what runs scatter by there

    def slack(n: int) -> float:  # what a larger set must be better by
        if n == 0:
            return SURE
        score, one = max(zip(scores[n], sets[n], strict=True), key=lambda pair: pair[0])
        minor = MINOR * (score - max(scores[0]))
        if asked == BETWEEN:
            return max(SURE, minor, margin)
        return max(margin, min(SURE, minor)) if search.fits(one) else margin

    size = next(n for n, score in sorted(scores.items()) if score and max(score) >= top - slack(n))
    if size == 0:
        return Answer((), search, nothing=asked == BETWEEN or top == max(scores[0]) or search.fits(start))
    best_of = max(scores[size])
    most_left = MORE_LEFT * search.left(max(sets[size], key=search.log_evidence))

    def near_it(s: Followed) -> bool:  # no worse by what its own runs scatter by, nor by little where it leaves noise
        short = best_of - search.log_evidence(s)
        minor = short <= min(SURE, MINOR * gained) and search.fits(s) and search.left(s) <= most_left
        return search.shown(s) and (minor or short <= max(margin, min(s.rough, SURE)))

    near = list(filter(near_it, sets[size]))
    if not near or _contradicted(search, sets, near):
        return Answer((), search, gained=gained)
    if size < most:  # a larger set that holds none of these is no less compatible for being larger
        larger = _large(search, search.without(size + 1, [s.members for s in near]))
        pared = [one for s in larger if not search.shown(s) for one in search.subsets(s)]  # of what it does not need
        near = search.better([*near, *filter(near_it, pared)])
        near += [s for s in larger if search.shown(s) and not any(set(n.members) < set(s.members) for n in near)]
    plain = [search.log_evidence(s) + search.chosen(s.members) for s in near]
    smallest = len(start.members) + size
    best_of = max(score for score, s in zip(plain, near, strict=True) if len(s.members) == smallest)
    kept = [
        (s, score - best_of)
        for score, s in zip(plain, near, strict=True)
        if score >= best_of - margin or len(s.members) == smallest
    ]
    if asked == MEAN and len(kept) == 1:  # none is singled out that others hold and explain as well
        (one, _), least = kept[0], search.log_evidence(kept[0][0]) - margin
        larger = [s for n, found in sets.items() for s in found if n > size and set(one.members) < set(s.members)]
        larger = search.better([*search.holding(one, margin), *filter(search.shown, larger)])
        more = [(s, held) for s in larger if (held := search.log_evidence(s)) >= least]
        kept += [  # what a set adds to another of them is not needed
            (s, held + search.chosen(s.members) - best_of)
            for s, held in more
            if not any(set(other.members) < set(s.members) for other, _ in more)
        ]
    return Answer(tuple(sorted(kept, key=lambda pair: (len(pair[0].members), -pair[1]))), search, gained=gained)


def _contradicted(search: Search, sets: Mapping[int, Sequence[Followed]], near: Sequence[Followed]) -> bool:
    """Whether odds say little of the best of the sets that are near: other causes that leave far more of what trials
    differ by are no less likely; or a set that is not near, and no larger, leaves far less of what all share."""
    best = max(near, key=search.log_evidence)
    left = search.left(best)
    if search.asked == MEAN:
        others = [s for n, found in sets.items() if 0 < n <= len(search.own(best.members)) for s in found]
        named = {id(s) for s in near}
        return left > ENOUGH and any(MORE_LEFT * search.left(s) < left for s in others if id(s) not in named)
    own = {search.responses.candidates[j].source for j in search.own(best.members)}
    least = search.log_evidence(best) - SURE
    others = [s for n, found in sets.items() if n for s in found if search.log_evidence(s) > least]
    return any(
        search.left(s) > MORE_LEFT * left and own.isdisjoint(search.responses.candidates[j].source for j in s.members)
        for s in others
    )


def _main(search: Search, sets: Mapping[int, Sequence[Followed]], best: Followed) -> list[Followed]:
    """The one cause by far of what some trials differ by, though more is left than noise: every set near the best has
    it, and a tenth of what it explains, or more, nothing gains beside it; or, of a fault of the session, in its
    place."""
    if search.asked == MEAN or not sets.get(1):
        return []
    odds = {id(s): search.log_evidence(s) for found in sets.values() for s in found}
    one = max(sets[1], key=lambda s: odds[id(s)])
    here, least, source = odds[id(one)], odds[id(search.start)], search.source(search.own(one.members)[0])
    rivals = [s for found in sets.values() for s in found if not set(one.members) <= set(s.members)]
    alone = all(odds[id(s)] < here - (SURE if len(s.members) <= len(one.members) else 0.0) for s in rivals)
    beside = max(odds.values()) - here + max(search.promised(best), 0.0)
    if source.of_session:
        others = [odds[id(s)] for s in rivals if all(search.source(j) is not source for j in search.own(s.members))]
        beside = min(beside, max(others, default=least) - least)
    alone = alone and one.rough < SURE and search.shown(one)
    return [one] if alone and beside < MINOR * (here - least) else []


def _large(search: Search, found: Sequence[Followed]) -> list[Followed]:
    """Sets of which every change, as run and as told, is more than blows scatter by, where some trials may have one."""
    if search.asked == MEAN:
        return list(found)
    told = [search.evidence.amounts(*search.linear(s), s.z, search.asked)[0] for s in found]
    sizes = [np.minimum(np.abs(s.z), np.abs(z)) for s, z in zip(found, told, strict=True)]
    return [s for s, size in zip(found, sizes, strict=True) if np.all(size[search.at(s)] > SMALLEST_CHANGE)]


def _weighed(search: Search, sets: Mapping[int, Sequence[Followed]]) -> tuple[Followed, float, dict[int, list[float]]]:
    """The best set; the largest log evidence that the model lacks something beside one; log evidence of all by size."""
    scores = {n: [search.log_evidence(s) for s in found] for n, found in sets.items()}
    every = [(score, s) for n, found in sets.items() for score, s in zip(scores[n], found, strict=True)]
    best = max(every, key=lambda pair: pair[0])[1]
    if search.asked == BETWEEN:  # what the model lacks is in all trials
        return best, -math.inf, scores
    return best, max(search.log_evidence(s, lacking=True) for _, s in every), scores


def _pared(search: Search, sets: Sets) -> tuple[Followed, float, dict[int, list[float]]]:
    """`_weighed`, sets added that the best was found together with what they do not need."""
    found = _weighed(search, sets)
    while (size := len(search.own((best := found[0]).members))) > 1:
        sets[size - 1] = search.better([*sets[size - 1], *search.subsets(best)])
        found = _weighed(search, sets)
        if found[0] is best:
            break
    return found


def _rows(search: Search, number: int, one: Followed, log_odds: float) -> list[CompatibleChange]:
    """The changes of a set beside what is taken for granted."""
    z, covariance = search.evidence.amounts(*search.linear(one), one.z, search.asked)
    out, own, left = [], search.own(one.members), search.left(one)
    for j, at, u in zip(one.members, z, np.sqrt(np.diag(covariance)), strict=True):
        if j not in own:
            continue
        c = search.responses.candidates[j]
        s = search.source(j)
        size, u = s.size(max(float(at), LEAST_ADDED) if s.added else float(at), math.hypot(u, search.scatter(j)))
        change = CompatibleChange(number, len(own), s.name, size, u, s.unit, log_odds, left)
        out.append(replace(change, profile=c.profile, first=c.first, last=c.last))
    return out


def _sets(rows: Sequence[CompatibleChange]) -> list[list[CompatibleChange]]:
    listed: dict[int, list[CompatibleChange]] = {}
    for row in rows:
        listed.setdefault(row.set, []).append(row)
    return list(listed.values())


def _in_words(sets: Sequence[Sequence[CompatibleChange]]) -> str:
    words = "; ".join(" with ".join(change.words for change in one) for one in sets[:MOST_NAMED])
    return words + (f"; and {len(sets) - MOST_NAMED} more (table compatible_changes)" if len(sets) > MOST_NAMED else "")


def findings_of(rows: Sequence[CompatibleChange], where: str, causes: str) -> tuple[SessionFinding, ...]:
    """What is found where some trials differ from the others: one finding for each change of the only set, else one."""
    sets = _sets(rows)
    if not sets:
        return ()
    tried = f"tried were {causes}, each in one trial, from one on, or as a drift"
    if len(sets) > 1:
        size = "" if max(map(len, sets)) == 1 else "sets of "
        text = (
            f"each of these {size}changes explains what {where} differ by among themselves, and the trials cannot tell "
            f"them apart: {_in_words(sets)}; {tried}"
        )
        return (_finding(rows, text),)
    (one,) = sets
    beside = "" if len(one) == 1 else ", with the other,"
    left = f", but for {100 * one[0].left:.0f} % of its square, which is scatter or was not tried"
    left = left if one[0].left >= ENOUGH else ""
    what = f"explains what {where} differ by among themselves{left}, and no other cause that was tried does"
    return tuple(_finding([row], f"{row.words}: this{beside} {what}; {tried}") for row in one)


def _finding(rows: Sequence[CompatibleChange], text: str) -> SessionFinding:
    """A finding that is named for what all rows have in common."""
    kinds = {FINDINGS.get(row.cause, "") for row in rows}
    profiles, first = {row.profile for row in rows}, {row.first for row in rows}
    named = len(kinds) == 1 and kinds != {""}
    kind = kinds.pop() if named else "outlying residual" if profiles == {ONE} else "changed condition"
    trial = float(first.pop()) if len(first) == 1 and TREND not in profiles else math.nan
    channel = rows[0].cause.split()[0] if named else ""
    return SessionFinding(kind, trial, channel, rows[0].change, 1.0 if rows[0].unit == "1" else 0.0, text)


def _sentence(rows: Sequence[CompatibleChange], where: str, shared: Answer) -> str:
    """What is said of what all trials share."""
    sets = _sets(rows)
    mean = "mean difference" if where.startswith("trials") else "difference"  # of some trials alone it shows here, too
    what = f"the {mean} of {where} from the model until the key is let go"
    if shared.nothing:
        return (
            f"until the key is let go, {where} and model differ by no more than force, sensors and stated "
            "uncertainties of the parameters may: no part of the model need have changed"
        )
    tried = f"tried were {shared.search.tried}, in all trials"
    if not sets:
        return f"none of the causes that were tried explains {what}, alone or up to {MOST_LAWS} together; {tried}"
    of_session = {row.of_session for row in rows}
    about = EITHER if len(of_session) == 2 else SESSION if of_session == {True} else ABOUT
    size, largest = len(sets[0]), len(sets[-1])
    caution = f"sizes hold if all else is as stated; an effect the model does not have may look like it; {tried}"
    if len(sets) == 1:
        head = "this change explains" if size == 1 else f"these {size} changes together explain"
        return f"{about}{head} {what}, and no other that was tried does: {_in_words(sets)}; {caution}"
    each = "each of these changes alone" if largest == 1 else "each of these sets of changes"
    return f"{about}{each} explains {what}; the trials cannot tell them apart: {_in_words(sets)}; {caution}"
