"""Which sets of changes are named, in which trials: made-up responses of known truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from types import SimpleNamespace

import numpy as np
import pytest

from validation.conventions import Array
from validation.infer.blocks import Block
from validation.infer.causes.explain import (
    ABOUT,
    BESIDE,
    SOFT,
    SOFT_APART,
    TOO_SOFT,
    Around,
    Explained,
    _contradicted,
    _main,
    _soft,
    decide,
)
from validation.infer.causes.responses import (
    ALL,
    CLOCK,
    ONE,
    STEP,
    TREND,
    Candidate,
    Point,
    Source,
    candidates,
)
from validation.infer.causes.search import BETWEEN, MEAN, Evidence, Followed, Search, contrasts, turned
from validation.infer.unknowns import FORCE_GAIN

M, TRIALS, SHAPES = 20, 3, 12
TIME = np.linspace(0.0, 0.2, M)
LISTED = tuple(Source(f"law {j}", "1", (f"law{j}",), 0.3, 1e-3, profiles=(ALL, TREND, STEP)) for j in range(SHAPES))
GAIN = (Source(FORCE_GAIN, "1", (), 0.05, 1e-3, profiles=(ALL, ONE, TREND, STEP)), *LISTED[1:])


def shapes() -> Array:
    """Derivatives (3 M, SHAPES): the last acts as the one before, but for a factor."""
    rng = np.random.default_rng(2)
    x = np.array([np.cumsum(rng.standard_normal((3, M)), axis=1).ravel() for _ in range(SHAPES)]).T * 2e-3
    x[:, -1] = 0.5 * x[:, -2]
    return x


@dataclass
class Bending:
    """Curves that bend with their parameters, as `Responses`; ``measured`` (trials, 3 M)."""

    measured: Array
    listed: tuple[Source, ...] = LISTED
    fold: float = 0.0
    strengths: Sequence[float] = 6 * (1.0,)

    @cached_property
    def candidates(self) -> tuple[Candidate, ...]:
        """As in `Responses`; trials are numbered from 1."""
        return candidates(self.listed, range(1, len(self.measured) + 1))

    def amounts(self, point: Point, t: int) -> Array:
        """Amount of each source in a trial."""
        out = np.zeros(SHAPES)
        for j, z in point.amounts:
            out[self.candidates[j].source] += z * self.candidates[j].weights[t]
        return out

    @staticmethod
    def curve(amounts: Array, fold: float = 0.0) -> Array:
        """Predicted curve (3 M,); what the first amount moves may fold."""
        total = shapes() @ amounts
        return np.asarray(total + 3.0 * total**2 + fold * np.sin(9.0 * amounts[0]) * np.sin(70.0 * np.tile(TIME, 3)))

    def differences(self, points: Sequence[Point]) -> list[Array | None]:
        """As in `Responses`."""
        each = list(zip(self.measured, self.strengths, strict=False))
        return [
            np.array([m - s * self.curve(self.amounts(p, t), self.fold) for t, (m, s) in enumerate(each)])
            for p in points
        ]

    def columns(self, asked: Sequence[tuple[Point, int, int]], here: Sequence[Array]) -> list[Array]:
        """As in `Responses`, exact."""
        out = []
        for point, t, j in asked:
            at = self.amounts(point, t)
            folded = 9.0 * self.fold * np.cos(9.0 * at[0]) * np.sin(70.0 * np.tile(TIME, 3)) * (j == 0)
            out.append(shapes()[:, j] * (1.0 + 6.0 * (shapes() @ at)) + folded)
        return out


def said(
    truth: dict[int, float],
    lacking: float = 0.0,
    seed: int = 1,
    trials: int = TRIALS,
    apart: dict[int, Sequence[float]] | None = None,
    listed: tuple[Source, ...] = LISTED,
    strange: tuple[float, float] = (0.0, 0.0),
    strengths: Sequence[float] = 6 * (1.0,),
    **how: bool,
) -> Explained:
    """What is said of trials with such a truth, and what each trial has apart; ``strange`` is how far answers fold, and
    what the last trial has that no cause makes; ``strengths`` are the trials'."""
    rng, (fold, odd) = np.random.default_rng(seed), strange
    extra = lacking * np.sin(40 * np.tile(TIME, 3)) * np.repeat([1.0, -2.0, 0.5], M)
    each = np.array([[truth.get(j, 0.0) for j in range(SHAPES)]] * trials)
    for j, own in (apart or {}).items():
        each[:, j] += own
    noise = 2e-5 * rng.standard_normal((trials, 3 * M))
    curves = np.array([s * Bending.curve(amounts, fold) for amounts, s in zip(each, strengths, strict=False)])
    responses = Bending(curves + extra + noise, listed, fold, strengths)
    responses.measured[-1] += odd * np.sin(40 * np.tile(TIME, 3))
    return decide(*searches(responses), range(1, trials + 1), **how)


def searches(responses: Bending) -> tuple[Around, Followed]:
    """The search around a set, and the model as it is."""
    listed = responses.listed
    (left,) = responses.differences([Point()])
    assert left is not None
    nothing = Followed((), np.zeros(0), left, np.zeros((3 * M, 0)))

    def around(start: Followed, at: Followed, before: Search | None, asked: int) -> Search:
        if at is start and at.members:
            (each,) = responses.differences([at.point])
            assert each is not None
            start = at = replace(at, each=each)
        columns = np.column_stack(responses.columns([(at.point, 0, j) for j in range(SHAPES)], []))
        columns[:, [s.added for s in listed]] = 0.0 if before is None else before.columns[:, [s.added for s in listed]]
        size = np.full((3, M), 5e-3)
        nil = np.zeros((3 * M, 0))
        block = Block(0, TIME, columns, nil, nil, nil, np.full(3 * M, 4e-10), size, np.zeros(M))
        evidence = Evidence(block, np.zeros(SHAPES), 1e-3 * np.eye(SHAPES), at.each)
        return Search(responses, evidence, (start, at), (columns, nil), asked)  # type: ignore[arg-type]

    return around, nothing


def named(found: Explained) -> set[frozenset[str]]:
    """Names of each set."""
    sets: dict[int, set[str]] = {}
    for row in found.changes:
        sets.setdefault(row.set, set()).add(row.cause)
    return {frozenset(one) for one in sets.values()}


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_one_change_is_named_alone_with_its_size_where_no_other_explains_it(seed: int) -> None:
    found = said({3: 1.2}, seed=seed)
    assert named(found) == {frozenset({"law 3"})}
    (row,) = found.changes
    assert abs(np.log(row.change) - 0.3 * 1.2) < 3 * row.u and row.u < 0.02
    assert (
        "this change explains the mean difference of trials 1, 2, 3 from the model" in found.sentence
        and "law 3 × 1.4" in found.sentence
    )


def test_a_single_trial_is_explained_as_several_are() -> None:
    found = said({3: 1.2}, trials=1)
    assert named(found) == {frozenset({"law 3"})} and "law 3 × 1.4" in found.sentence
    assert not said({}, trials=1).changes


def test_all_that_act_alike_are_named_and_none_alone() -> None:
    found = said({SHAPES - 2: 0.9})
    assert named(found) == {frozenset({f"law {SHAPES - 2}"}), frozenset({f"law {SHAPES - 1}"})}
    assert "cannot tell them apart" in found.sentence
    sizes = {row.cause: np.log(row.change) for row in found.changes}
    assert sizes[f"law {SHAPES - 1}"] == pytest.approx(2 * sizes[f"law {SHAPES - 2}"], rel=0.05)


def test_what_a_set_does_not_need_is_not_named_with_it(monkeypatch: pytest.MonkeyPatch) -> None:
    found, lost = Search.of_size, (SHAPES - 2,)  # as where no step from nothing leads to a single cause
    monkeypatch.setattr(Search, "of_size", lambda *asked: [s for s in found(*asked) if s.members != lost])
    assert named(said({SHAPES - 2: 1.2})) == {frozenset({f"law {SHAPES - 2}"}), frozenset({f"law {SHAPES - 1}"})}


@pytest.mark.parametrize(("short", "both"), [(20.0, True), (150.0, False)])
def test_another_that_leaves_noise_too_is_named_where_little_less_speaks_for_it(monkeypatch, short, both) -> None:
    known, twin = Search.log_evidence, (SHAPES - 1,)
    monkeypatch.setattr(Search, "log_evidence", lambda *a, **how: known(*a, **how) - short * (a[1].members == twin))
    assert (frozenset({f"law {SHAPES - 1}"}) in named(said({SHAPES - 2: 1.2}))) == both


@pytest.mark.parametrize(("short", "both"), [(20.0, True), (150.0, False)])
def test_so_is_another_of_what_some_trials_differ_by(monkeypatch, short, both) -> None:
    known, twin = Search.log_evidence, SHAPES - 1

    def odds(search: Search, one: Followed, **how: bool) -> float:
        return known(search, one, **how) - short * any(
            search.responses.candidates[j].source == twin for j in one.members
        )

    monkeypatch.setattr(Search, "log_evidence", odds)
    step = np.where(np.arange(6) > 2, 1.2, 0.0)
    found = said({}, trials=6, apart={SHAPES - 2: step})
    assert {row.cause for row in found.changes if row.profile == STEP} >= {f"law {SHAPES - 2}"}
    assert (f"law {SHAPES - 1}" in {row.cause for row in found.changes}) == both


def test_a_change_is_not_singled_out_where_a_set_that_holds_it_explains_as_well() -> None:
    found = said({3: 1.2, 5: 0.005})
    assert named(found) == {frozenset({"law 3"}), frozenset({"law 3", "law 5"})}
    assert "no other that was tried" not in found.sentence and "cannot tell them apart" in found.sentence


@pytest.mark.parametrize("truth", [{1: 1.0, 5: -0.8}, {0: -0.7, 4: 0.9, 8: 1.1}])
def test_changes_that_explain_it_only_together_are_named_together(truth: dict[int, float]) -> None:
    found = said(truth)
    assert named(found) == {frozenset(f"law {j}" for j in truth)}
    assert f"these {len(truth)} changes together explain" in found.sentence


def test_none_is_named_where_the_model_lacks_something_or_more_have_changed() -> None:
    for found in (said({3: 1.0}, lacking=4e-3), said({0: 0.9, 2: -0.8, 4: 1.0, 6: -1.1, 8: 0.7})):
        assert not found.changes
        assert found.sentence.startswith("none of the causes that were tried explains the mean difference")


def test_nothing_need_have_changed_within_the_noise() -> None:
    found = said({})
    assert not found.changes and "no part of the model need have changed" in found.sentence


EFFECT = Source("added part.size", "m", (), 1.0, 0.0, step=1.0, scaled=(("part.size", 2e-3, -1.0),))
WITH_EFFECT = (*LISTED[:4], EFFECT, *LISTED[5:])


def test_an_effect_that_the_model_lacks_is_named_with_its_size() -> None:
    found = said({4: 0.5}, listed=WITH_EFFECT)
    assert named(found) == {frozenset({EFFECT.name})} and "added part.size = 0.004 m" in found.sentence
    (row,) = found.changes
    assert abs(row.change - 4e-3) < 3 * row.u and row.u < 1e-4


def test_there_is_no_less_than_none_of_an_effect_and_it_is_not_tried_for_nothing() -> None:
    assert EFFECT.name not in {row.cause for row in said({4: -0.5}, listed=WITH_EFFECT).changes}
    for truth in ({}, {4: -0.5}):
        sentence = said(truth, listed=WITH_EFFECT).sentence
        assert (EFFECT.name in sentence) == bool(truth)


def test_an_effect_that_cannot_come_near_what_was_found_is_not_followed(monkeypatch: pytest.MonkeyPatch) -> None:
    followed: list[tuple[int, ...]] = []
    follow = Search._follow

    def told(self: Search, started: Sequence[Followed], broad: bool = False) -> list[Followed]:
        followed.extend(one.members for one in started)
        return follow(self, started, broad)

    monkeypatch.setattr(Search, "_follow", told)
    for truth, tried in (({3: 1.2}, False), ({4: 0.5}, True)):
        followed.clear()
        said(truth, listed=WITH_EFFECT)
        assert ((4,) in followed) == tried


EVENLY = [-0.4 * k for k in range(6)]  # 5 % of a gain is one: 2 % per trial


@pytest.mark.parametrize("lacking", [0.0, 4e-3])
@pytest.mark.parametrize(
    "apart, words, kind, trial",
    [
        (EVENLY, "force gain drifts by −2 % per trial, × 0.90", "force gain", None),
        ([0.0, 0.0, 0.0, 0.8, 0.0, 0.0], "force gain × 1.04", "force gain", 4),
    ],
)
def test_a_fault_of_some_trials_is_a_finding_whatever_the_model_lacks(
    apart: list[float], words: str, kind: str, trial: int | None, lacking: float
) -> None:
    found = said({}, lacking, trials=6, apart={0: apart}, listed=GAIN)
    (finding,) = found.findings
    assert finding.kind == kind and words in finding.text and "no other cause that was tried does" in finding.text
    assert (trial is None and finding.trial != finding.trial) or finding.trial == trial
    assert found.sentence.startswith("beside that, ") and "not a fault of the session" not in found.sentence


@pytest.mark.parametrize(
    ("profile", "size", "fold"),
    [(ONE, -1.6, 1e-3), (TREND, 1.3, 1e-3), (ONE, 2.0, 2e-3), (TREND, 2.6, 2e-3), (STEP, -1.6, 2e-3)],
)
def test_a_fault_that_no_step_from_nothing_leads_to_is_found(profile: str, size: float, fold: float) -> None:
    shares = {ONE: [0, 0, 0, 1, 0, 0], TREND: [0.2 * k for k in range(6)], STEP: [0, 0, 0, 1, 1, 1]}[profile]
    found = said({}, trials=6, apart={0: [size * share for share in shares]}, listed=GAIN, strange=(fold, 0.0))
    assert [(row.cause, row.profile) for row in found.changes] == [(FORCE_GAIN, profile)]
    assert found.changes[0].change == pytest.approx(np.exp(0.05 * size), rel=2e-3)


def test_an_amplifier_may_be_further_off_than_a_part() -> None:
    (row,) = said({}, trials=6, apart={0: [0.0, 0.0, 0.0, 5.0, 0.0, 0.0]}, listed=GAIN).changes
    assert row.cause == FORCE_GAIN and row.change == pytest.approx(np.exp(0.05 * 5.0), rel=2e-3)
    assert not said({}, trials=6, apart={0: [0.0, 0.0, 0.0, 5.0, 5.0, 5.0]}).changes


def test_faults_of_the_session_are_tried_at_many_amounts_however_little_they_show() -> None:
    responses = Bending(np.array([Bending.curve(np.eye(SHAPES)[0])] * TRIALS), GAIN)
    around, nothing = searches(responses)
    search = around(nothing, nothing, None, MEAN)
    shows = np.diag(search._around(nothing, 0)[0])
    assert np.sum(shows > shows[0]) >= 2  # others show more
    assert [(one.members, one.z) for one in search._faults()] == [((0,), 1.0)]


@pytest.mark.parametrize("met", [True, False])
def test_a_fault_is_followed_from_where_it_was_met_best_though_another_cause_leaves_noise(monkeypatch, met) -> None:
    monkeypatch.setattr("validation.infer.causes.search.BRANCHES", 2)
    responses = Bending(np.array([Bending.curve(np.eye(SHAPES)[0])] * TRIALS), GAIN)
    around, nothing = searches(responses)
    search = around(nothing, nothing, None, MEAN)
    monkeypatch.setattr(Search, "_ranked", lambda *asked: [(3,)])  # its derivative hides it
    monkeypatch.setattr(Search, "fits", lambda self, one: met)
    assert {one.members: one.z for one in search.of_size(1, nothing)}[(0,)] == pytest.approx(1.0, abs=0.01)


def test_what_does_the_same_in_the_same_trials_is_found_from_where_a_cause_lies() -> None:
    responses = Bending(np.array([Bending.curve(np.eye(SHAPES)[-1] * 1.4 * (t > 2)) for t in range(6)]))
    around, nothing = searches(responses)
    search = around(nothing, nothing, None, BETWEEN)
    step = {c.source: j for j, c in enumerate(responses.candidates) if c.profile == STEP and c.first == 4}
    (one,) = search._follow([search._started((step[SHAPES - 2],), search.start)])
    assert one.z == pytest.approx(0.7, rel=1e-3)
    twin = {s.members: s for s in search.twins(one)}[(step[SHAPES - 1],)]
    assert twin.z == pytest.approx(1.4, rel=1e-3) and search.left(twin) < 1e-6


def test_odds_say_little_where_another_cause_that_leaves_far_more_is_as_likely() -> None:
    responses = Bending(np.array([Bending.curve(np.eye(SHAPES)[3] * 1.4 * (t > 2)) for t in range(6)]))
    around, nothing = searches(responses)
    search = around(nothing, nothing, None, BETWEEN)
    step = [j for j, c in enumerate(responses.candidates) if c.profile == STEP and c.first == 4]
    best, other = search._follow([search._started((step[j],), search.start) for j in (3, 5)])
    later = replace(other, members=(step[3] + 1,))  # the same cause from another trial on is no other one
    assert not _contradicted(search, {0: [nothing], 1: [best, other]}, [best])  # far less likely
    search._known[id(other), False] = other, search.log_evidence(best) - 50.0
    search._known[id(later), False] = later, search.log_evidence(best) - 50.0
    assert _contradicted(search, {0: [nothing], 1: [best, other]}, [best])
    assert not _contradicted(search, {0: [nothing], 1: [best, later]}, [best])


def test_no_set_is_named_that_leaves_far_more_of_what_all_share_than_another_no_larger() -> None:
    responses = Bending(np.array([Bending.curve(np.eye(SHAPES)[3])] * TRIALS))
    around, nothing = searches(responses)
    search = around(nothing, nothing, None, MEAN)
    right, worse = search._follow([search._started((j,), search.start) for j in (3, 5)])
    assert search.left(right) < 0.05 < search.left(worse)
    sets = {0: [nothing], 1: [right, worse]}
    assert _contradicted(search, sets, [worse]) and not _contradicted(search, sets, [right])
    assert not _contradicted(search, {0: [nothing], 1: [worse], 2: [right]}, [worse])  # a larger one leaves less
    search._known[id(worse), False] = worse, search.log_evidence(right) + 1.0
    assert not _contradicted(search, sets, [right, worse])  # it is named, too


def test_one_cause_is_named_beside_less_that_none_explains_and_none_beside_more() -> None:
    little, much = (
        said({3: 1.2}, trials=6, apart={0: EVENLY}, listed=GAIN, strange=(0.0, odd)) for odd in (3e-3, 1e-1)
    )
    assert [row.profile for row in little.changes] == [TREND, ALL]
    assert little.changes[0].change == pytest.approx(0.905, abs=2 * little.changes[0].u)
    assert "% of its square, which is scatter or was not tried" in little.findings[0].text
    assert not much.changes and "what trials 1, 2, 3, 4, 5, 6 differ by among themselves" in much.sentence
    assert "what all share is not looked for" in much.sentence


@pytest.mark.parametrize(("listed", "rival", "told"), [(GAIN, 50.0, True), (GAIN, 150.0, False), (LISTED, 50.0, False)])
def test_a_fault_of_the_session_is_named_where_nothing_in_its_place_gains_a_tenth(
    monkeypatch: pytest.MonkeyPatch, listed: tuple[Source, ...], rival: float, told: bool
) -> None:
    responses = Bending(np.array([Bending.curve(np.eye(SHAPES)[0] * (t > 2)) for t in range(6)]), listed)
    around, nothing = searches(responses)
    search = around(nothing, nothing, None, BETWEEN)
    step = [j for j, c in enumerate(responses.candidates) if c.profile == STEP and c.first == 4]
    one, other = search._follow([search._started((step[j],), search.start) for j in (0, 5)])
    later = replace(one, members=(step[0] + 1,))  # the same fault in other trials is no other cause
    for found, odds in ((nothing, 0.0), (one, 1000.0), (other, rival), (later, 800.0)):
        search._known[id(found), False] = found, odds
    monkeypatch.setattr(Search, "promised", lambda *_: 400.0)  # far more is left than noise
    assert _main(search, {0: [nothing], 1: [one, other, later]}, one) == ([one] if told else [])


def test_what_a_channel_scatters_by_is_in_the_u_of_its_drift() -> None:
    scattering = (replace(GAIN[0], scatter=0.06), *GAIN[1:])  # 0.3 % of the force
    u = [said({}, trials=6, apart={0: EVENLY}, listed=listed).changes[0].u for listed in (GAIN, scattering)]
    assert u[0] < 0.001 and u[1] == pytest.approx(0.003 / np.sqrt(0.7), rel=0.01)  # (0, 0.2, … 1) less their mean


def test_a_law_that_jumps_between_trials_is_no_fault_of_a_channel() -> None:
    (finding,) = said({}, trials=6, apart={5: [0.0, 0.0, 0.0, 1.0, 1.0, 1.0]}, listed=GAIN).findings
    assert (finding.kind, finding.trial) == ("changed condition", 4.0) and "law 5 × 1.3" in finding.text


def test_a_drift_and_a_change_of_the_model_are_both_named() -> None:
    found = said({3: 1.2}, trials=6, apart={0: EVENLY}, listed=GAIN)
    assert [f.kind for f in found.findings] == ["force gain"]
    assert [(row.cause, row.profile) for row in found.changes] == [(FORCE_GAIN, TREND), ("law 3", ALL)]
    assert found.changes[1].change == pytest.approx(np.exp(0.3 * 1.2), rel=0.02)


@pytest.mark.parametrize(("shared", "apart"), [(3, 5), (7, 2)])
def test_a_change_of_some_trials_is_named_though_strokes_of_unlike_strength_answer_a_larger_one_of_all_unlike(
    monkeypatch: pytest.MonkeyPatch, shared: int, apart: int
) -> None:
    def told() -> Explained:
        step = {apart: [0.0, 0.0, 0.0, 1.0, 1.0, 1.0]}
        return said({shared: 2.0}, trials=6, apart=step, strengths=(1.0, 0.95, 0.95, 0.75, 1.2, 1.1))

    step, common = told().changes
    assert [(row.cause, row.profile) for row in (step, common)] == [(f"law {apart}", STEP), (f"law {shared}", ALL)]
    assert [row.change for row in (step, common)] == pytest.approx(np.exp([0.3, 0.6]), rel=0.02)
    monkeypatch.setattr("validation.infer.causes.explain._beside_shared", lambda *given: given[-1])
    assert not told().changes


def test_what_all_share_is_asked_for_only_beside_a_finding_where_that_is_wanted() -> None:
    assert said({3: 1.2}, trials=6, listed=GAIN, between=True) == Explained()
    both = said({3: 1.2}, trials=6, apart={0: EVENLY}, listed=GAIN, between=True)
    assert len(both.changes) == 2 and both == said({3: 1.2}, trials=6, apart={0: EVENLY}, listed=GAIN)


def test_what_trials_scatter_by_is_no_finding() -> None:
    for seed in range(3):
        assert not said({3: 1.0}, lacking=1e-3, seed=seed, trials=6).findings
    assert not said({}, trials=6, apart={0: [0.0, 0.0, 0.1, 0.0, 0.0, 0.0]}, listed=GAIN).findings  # 0.5 %


def test_one_trial_of_three_is_not_told_from_the_others() -> None:
    assert {c.profile for c in candidates(GAIN, [1, 2, 3])} == {ALL}
    told = candidates(GAIN, [4, 1, 9, 12])
    assert {c.weights for c in told if c.source == 0 and c.profile == TREND} == {(3 / 11, 0.0, 8 / 11, 1.0)}
    assert sum(np.exp(-c.rarity) for c in told) == pytest.approx(1.0)


@pytest.mark.parametrize("session, prefix", [(True, "about the session, not the model: "), (False, ABOUT)])
def test_who_is_blamed_is_said_of_what_won(session: bool, prefix: str) -> None:
    assert said({0: 1.0} if session else {3: 1.0}, trials=4, listed=GAIN).sentence.startswith(prefix)
    if not session:  # a fault of one trial is not in the search
        few = said({3: 1.0}, listed=GAIN).sentence
        assert few.startswith("about the model: ") and "fewer than four" in few
    alike = (*GAIN[:-1], replace(GAIN[0], name=CLOCK))  # acts as the law before it
    assert said({SHAPES - 2: 0.9}, listed=alike).sentence.startswith("about the model or the session: ")


def test_contrasts_hold_what_trials_differ_by_and_not_their_mean() -> None:
    each = np.random.default_rng(0).standard_normal((4, 5))
    apart = contrasts(each)
    assert apart == pytest.approx(contrasts(each + 7.0))
    assert np.sum(apart**2) == pytest.approx(np.sum((each - each.mean(axis=0)) ** 2))
    assert contrasts(each[:1]).shape == (0, 5)


def test_evidence_of_a_set_is_that_of_its_joint_density() -> None:
    """Against the density of the stacked trials with one size of the noise."""
    rng = np.random.default_rng(4)
    columns = shapes()[:, :2]
    block = Block(
        0, TIME, columns, np.zeros((3 * M, 0)), np.zeros((3 * M, 0)), np.zeros((3 * M, 0)), np.full(3 * M, 1e-8),
        np.full((3, M), 1e-9), np.zeros(M),
    )  # fmt: skip
    each = rng.standard_normal((TRIALS, 3 * M)) * 1e-4 + columns @ np.array([0.5, 0.1])
    evidence = Evidence(block, np.zeros(2), np.zeros((2, 2)), each)

    for weights in ([1.0] * TRIALS, [0.0, 0.0, 1.0]):

        def density(which: list[int], weights: list[float] = weights) -> float:
            x = np.kron(np.array(weights)[:, None], columns[:, which])
            v = x @ x.T + 1e-8 * np.eye(3 * M * TRIALS)
            return -0.5 * float(each.ravel() @ np.linalg.solve(v, each.ravel()) + np.linalg.slogdet(v)[1])

        spread = turned(np.array(weights)[:, None])[:, :, None] * columns
        found = []
        for which in ([0, 1], []):
            z, _ = evidence.amounts(turned(each), spread[..., which], np.zeros(len(which)))
            found.append(evidence.log_evidence(turned(each), spread[..., which], z))
        assert found[0] - found[1] == pytest.approx(density([0, 1]) - density([]), rel=1e-4)


def test_of_soft_strokes_no_cause_of_what_all_share_is_named_and_findings_say_how_sure_they_are() -> None:
    told = said({3: 1.2}, trials=6, apart={0: EVENLY}, listed=GAIN, soft=True)
    assert told.soft and "not said of strokes as soft as these" in told.sentence and told.sentence.startswith(BESIDE)
    assert [row.profile for row in told.changes] == [TREND] and told.findings[0].text.endswith(SOFT)
    few = said({3: 1.2}, soft=True)
    assert few.soft and not few.changes and few.sentence.startswith(TOO_SOFT.format(where="trials 1, 2, 3"))
    nothing = said({}, soft=True)
    assert nothing.nothing and not nothing.soft and "no part of the model need have changed" in nothing.sentence


def test_laws_are_not_named_of_some_trials_of_soft_strokes_nor_where_they_leave_most() -> None:
    step = {3: [0.0, 0.0, 0.0, 1.2, 1.2, 1.2]}
    assert [row.cause for row in said({}, trials=6, apart=step).changes] == ["law 3"]
    told = said({}, trials=6, apart=step, soft=True)
    apart = Explained(SOFT_APART.format(where="trials 1, 2, 3, 4, 5, 6"), soft=True)
    assert told == apart
    most = said({}, trials=6, apart=step, strange=(0.0, 1e-2))
    assert not most.changes and "what trials 1, 2, 3, 4, 5, 6 differ by among themselves" in most.sentence
    assert said({}, trials=6, apart=step, strange=(0.0, 1e-2), soft=True) == apart


def test_what_no_cause_explains_of_some_trials_is_said_to_be_as_soft_strokes_differ() -> None:
    gains = {0: [0.0, 0.0, 0.0, 1.2, 1.2, 1.2]}
    loud = said({}, trials=6, apart=gains, listed=GAIN, strange=(0.0, 1e-1))
    assert loud.sentence.startswith("none of the causes that were tried explains what") and not loud.changes
    soft = said({}, trials=6, apart=gains, listed=GAIN, strange=(0.0, 1e-1), soft=True)
    assert soft == Explained(SOFT_APART.format(where="trials 1, 2, 3, 4, 5, 6"), soft=True)


@pytest.mark.parametrize(("speed", "soft"), [(14.0, True), (16.0, False)])
def test_strokes_are_soft_by_the_speed_of_the_hammer(speed: float, soft: bool) -> None:
    turns = {"hammer": speed * TIME, "key": 20.0 * TIME}
    trial = SimpleNamespace(time_s=TIME, column=turns.__getitem__)
    assert _soft([trial]) is soft  # type: ignore[list-item]
