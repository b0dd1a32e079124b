"""Which part of the model explains the difference of a report: the answer, as a sentence and as rows of a table.

Conventions: up to three trials of a session without faults, until the key is let go. Named are all sets of the smallest
size that is as good as any larger one to a factor of `ODDS`, and sets with one change more that hold none of these and
are as good; none where "the model lacks something else" is better than all of them by that factor
(docs/explanation/differences.md).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields

import numpy as np

import model
from validation.conventions import Array
from validation.errors import ValidationInputError
from validation.identification.blocks import make_blocks
from validation.identification.difference.responses import Point, Responses, candidates, known_root
from validation.identification.difference.search import Evidence, Followed, Search
from validation.identification.observations import ENCODERS, ObservedTrial, observe
from validation.measurement.session import representative
from validation.measurement.trial import MeasuredTrial
from validation.prediction.joint_draws import chosen_trials
from validation.prediction.model_under_test import ModelUnderTest
from validation.prediction.posterior import TABLE

ODDS = 20.0
MOST_LAWS = 3
MOST_NAMED = 6
MOST_TRIALS = 3
SMALLEST_DIFFERENCE = 4e-3  # of the range of a channel, root mean square: below, nothing is looked for
FAR = 3.0  # times the margin: a fourth change that promises so much is not looked at more closely
ABOUT = "about the model, not a fault of the session: "


@dataclass(frozen=True)
class CompatibleChange:
    """One change of a set that explains the trials.

    Attributes
    ----------
    set : number of the set: smaller sets first, then by evidence
    changes : how many changes the set has
    cause : parameter, felt, or error of the force
    change : factor, or what is added in ``unit``
    u : its standard uncertainty; relative where ``unit`` is 1
    unit : SI; 1 means a factor
    log_odds : natural logarithm of the set's evidence over that of the best of the smallest sets
    left : share of the squared difference of the trials' mean that is left with it
    """

    set: int
    changes: int
    cause: str
    change: float
    u: float
    unit: str
    log_odds: float
    left: float

    @property
    def words(self) -> str:
        """The change for a reader."""
        if self.unit == "1":
            places = max(2, 1 - math.floor(math.log10(max(self.u * self.change, 1e-9))))
            return f"{self.cause} × {self.change:.{places}f} (u {100 * self.u:.2g} %)"
        factor, unit = {"m": (1e3, "mm"), "s": (1e3, "ms")}.get(self.unit, (1.0, self.unit))
        sign = "−" if self.change < 0 else "+"
        return f"{self.cause} {sign}{abs(factor * self.change):.2g} {unit} (u {factor * self.u:.1g})"


@dataclass(frozen=True)
class Explained:
    """What explains the difference.

    Attributes
    ----------
    sentence : empty where nothing was looked for
    changes : rows of the sets named
    nothing : whether no part of the model need have changed
    """

    sentence: str = ""
    changes: tuple[CompatibleChange, ...] = ()
    nothing: bool = False


def explain_difference(tested: ModelUnderTest, sound: Sequence[MeasuredTrial]) -> Explained:
    """Sets of changes of the model or the force that explain what trials and model differ by.

    Parameters
    ----------
    tested : ModelUnderTest
        Known results are reused from its store.
    sound : sequence of MeasuredTrial
        Without faults, of one kind of stroke.

    Returns
    -------
    Explained
    """
    if not sound:
        return Explained()
    try:
        trials = observe("validate", 0, _chosen(sound))
    except ValidationInputError:  # no span in common
        return Explained()
    return explain_observed(tested, trials)


def explain_observed(tested: ModelUnderTest, trials: Sequence[ObservedTrial]) -> Explained:
    """`explain_difference` for trials of one kind as they are compared, at the same times, each driven by its force."""
    stated = {path: q.u for path, q in model.quantities_of(tested.action).items()}
    inputs = tested.identity, trials, stated, dict(tested.action.identification.get(TABLE, {}))
    found = tested.store.value("compatible changes", inputs, lambda: asdict(_explain(tested, trials)))
    names = [f.name for f in fields(CompatibleChange)]
    changes = tuple(CompatibleChange(**{name: row[name] for name in names}) for row in found["changes"])
    return Explained(found["sentence"], changes, found["nothing"])


def _chosen(sound: Sequence[MeasuredTrial]) -> list[MeasuredTrial]:
    """A few trials, the one that stands for all first."""
    first = representative(list(sound))
    others = chosen_trials([m for m in sound if m is not first], most=MOST_TRIALS - 1)
    return [first, *others]


def _explain(tested: ModelUnderTest, trials: Sequence[ObservedTrial]) -> Explained:
    listed = candidates(tested.action, trials[0])
    responses = Responses(tested, trials, listed)
    (each,) = responses.differences([Point()])
    if each is None or _small(trials, each):
        return Explained()
    nothing = Followed((), np.zeros(0), each.mean(axis=0), each, np.zeros((each.shape[1], 0)))

    def around(at: Followed, before: Search | None) -> Search:
        return linearised(tested, responses, (nothing, at), before)

    numbers = sorted(t.number for t in trials)
    where = f"trial{'' if len(numbers) == 1 else 's'} {', '.join(map(str, numbers))}"
    return decide(around, nothing, where)


def _small(trials: Sequence[ObservedTrial], each: Array) -> bool:
    extent = np.repeat(np.ptp(trials[0].change_rad, axis=0), trials[0].time_s.size)
    return bool(np.any(extent == 0.0) or np.sqrt(np.mean((each.mean(axis=0) / extent) ** 2)) < SMALLEST_DIFFERENCE)


def linearised(
    tested: ModelUnderTest, responses: Responses, points: tuple[Followed, Followed], before: Search | None
) -> Search:
    """Derivatives of everything around a set, and the noise they make up there.

    Parameters
    ----------
    tested, responses : what runs
    points : the model as it is, and the set
    before : Search or None
        That around another set: derivatives are found again of what is noise there; others, and what the force's noise
        does, are kept.
    """
    (nothing, at), listed, trials = points, responses.listed, responses.trials
    wanted = range(len(listed)) if before is None else before.noise
    found = responses.columns([(at.point, j) for j in wanted], len(wanted) * [at.each])
    columns = np.zeros((at.each.shape[1], len(listed))) if before is None else before.columns.copy()
    columns[:, list(wanted)] = np.column_stack(found)
    laws = np.array([c.law for c in listed])
    shaped = np.moveaxis(columns.reshape(len(ENCODERS), -1, len(listed)), 0, 1)
    force = responses.force_columns(at.point, at.each) if before is None else before.force
    (block,) = make_blocks(trials[:1], [shaped], [force], laws)
    evidence = Evidence(block, laws, known_root(tested.action, listed), contrasts(at.each))
    return Search(responses, evidence, nothing, (columns, force))


def contrasts(each: Array) -> Array:
    """Orthonormal contrasts (trials - 1, n) of the rows (Helmert): what the trials differ by among themselves."""
    out = []
    for k in range(1, len(each)):
        out.append((each[:k].sum(axis=0) - k * each[k]) / math.sqrt(k * (k + 1)))
    return np.array(out).reshape(len(out), each.shape[1])


def decide(around: Callable[[Followed, Search | None], Search], nothing: Followed, where: str) -> Explained:
    """Which sets are named.

    Parameters
    ----------
    around : callable
        Given a set and the last search, the search with derivatives and noise found around the set.
    nothing : Followed
        The model as it is.
    where : which trials, in words
    """
    margin, search = math.log(ODDS), around(nothing, None)
    sets = {0: [nothing]}
    best, lacks, scores = _weighed(search, sets)
    for size in range(1, MOST_LAWS + 1):
        if search.promised(best) < margin:
            break
        sets[size] = search.of_size(size, best)
        best, lacks, scores = _weighed(search, sets)
        if len(best.members) > 1:  # found together with what it does not need
            sets[size - 1] = _one_each([*sets[size - 1], *search.subsets(best)], search)
            best, lacks, scores = _weighed(search, sets)
        if size == MOST_LAWS and search.promised(best) > FAR * margin:
            break
        if best.members:  # what is known, and the sizes of the changes, look otherwise from there
            search = around(best, search)
            best, lacks, scores = _weighed(search, sets)
    top = max(max(found) for found in scores.values())
    if search.promised(best) >= margin:
        lacks = math.inf  # more than three would be named
    if best.members and not search.fits(best):
        lacks = math.inf  # the best of bad ones
    if lacks > top + margin:
        return Explained(
            f"{ABOUT}no part of the model explains the difference of {where} until the key is let go, alone or up to "
            f"{MOST_LAWS} together: the cause is an effect the model does not have, or more changes than that"
        )
    size = next(n for n, found in sorted(scores.items()) if max(found) >= top - margin)
    if size == 0:
        return Explained(
            f"{ABOUT}until the key is let go, {where} and model differ by no more than force, sensors and stated "
            "uncertainties of the parameters may: no part of the model need have changed",
            nothing=True,
        )
    most = max(scores[size])
    near = [s for score, s in zip(scores[size], sets[size], strict=True) if score >= most - margin]
    if size < MOST_LAWS:  # a larger set that holds none of these is no less compatible for being larger
        near += search.without(size + 1, [s.members for s in near])
    plain = [search.evidence.log_evidence(s.linear, s.columns) for s in near]
    most = max(score for score, s in zip(plain, near, strict=True) if len(s.members) == size)
    kept = sorted(
        ((score, s) for score, s in zip(plain, near, strict=True) if score >= most - margin or len(s.members) == size),
        key=lambda pair: (len(pair[1].members), -pair[0]),
    )
    rows = [row for n, (score, s) in enumerate(kept) for row in _rows(search, n + 1, s, score - most)]
    return Explained(ABOUT + _sentence(rows, where), tuple(rows))


def _one_each(found: Sequence[Followed], search: Search) -> list[Followed]:
    """The better one of sets that were followed from two starts."""
    best: dict[tuple[int, ...], Followed] = {}
    for one in sorted(found, key=search.log_evidence):
        best[one.members] = one
    return list(best.values())


def _weighed(search: Search, sets: Mapping[int, Sequence[Followed]]) -> tuple[Followed, float, dict[int, list[float]]]:
    """The best set; the largest log evidence that the model lacks something beside one; log evidence of all by size."""
    scores = {n: [search.log_evidence(s) for s in found] for n, found in sets.items()}
    every = [(score, s) for n, found in sets.items() for score, s in zip(scores[n], found, strict=True)]
    best = max(every, key=lambda pair: pair[0])[1]
    lacks = max(search.log_evidence(s, lacking=True) for _, s in every)
    return best, lacks, scores


def _rows(search: Search, number: int, one: Followed, log_odds: float) -> list[CompatibleChange]:
    z, covariance = search.evidence.amounts(one.linear, one.columns)
    left = float(np.sum(one.difference**2) / np.sum(search.nothing.difference**2))
    out = []
    for j, at, u in zip(one.members, z, np.sqrt(np.diag(covariance)), strict=True):
        c = search.responses.listed[j]
        amount = math.exp(c.wrong * at) if c.unit == "1" else c.wrong * float(at)
        out.append(
            CompatibleChange(
                number, len(one.members), c.name, float(amount), float(c.wrong * u), c.unit, log_odds, left
            )
        )
    return out


def _sentence(rows: Sequence[CompatibleChange], where: str) -> str:
    listed: dict[int, list[CompatibleChange]] = {}
    for row in rows:
        listed.setdefault(row.set, []).append(row)
    sets = list(listed.values())
    words = "; ".join(" with ".join(change.words for change in one) for one in sets[:MOST_NAMED])
    more = f"; and {len(sets) - MOST_NAMED} more (table compatible_changes)" if len(sets) > MOST_NAMED else ""
    what = f"the difference of {where} until the key is let go"
    caution = "sizes hold if all else is as stated; an effect the model does not have may look like it"
    size, largest = len(sets[0]), len(sets[-1])
    if len(sets) == 1:
        head = "this change explains" if size == 1 else f"these {size} changes together explain"
        return f"{head} {what}, and no other that was tried does: {words}; {caution}"
    each = "each of these changes alone" if largest == 1 else "each of these sets of changes"
    return f"{each} explains {what}; the trials cannot tell them apart: {words}{more}; {caution}"
