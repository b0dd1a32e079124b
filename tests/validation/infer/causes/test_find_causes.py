"""Which causes are named, in which trials, and how seldom one where there is none: made-up responses of known truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import model
from tests.validation.infer import toy
from validation.conventions import Array
from validation.infer.blocks import Block
from validation.infer.causes import score_test
from validation.infer.causes.explain import Explained, make_answer
from validation.infer.causes.responses import Point, Responses
from validation.infer.causes.score_test import BalancedNoise, ScoreTest, helmert
from validation.infer.causes.search import Fit, Search, find_causes
from validation.infer.channels import FORCE_GAIN
from validation.infer.hypotheses import ALL, ONE, STEP, TREND, Candidate, Source, candidates

M, SHAPES, NOISE_RAD = 20, 12, 3e-5
TIME = np.linspace(0.0, 0.2, M)
GAIN = Source(FORCE_GAIN, "1", (), 0.05, 0.0, profiles=(ALL, ONE, TREND, STEP))
LISTED = (
    GAIN,
    *(
        Source(f"law {j}", "1", (f"law{j}",), 0.3, 1e-3, law=True, profiles=(ALL, TREND, STEP))
        for j in range(1, SHAPES)
    ),
)
ACTION = model.load_action()
(MADE,) = toy.made(np.zeros(3), 1, np.random.default_rng(1))


def shapes() -> Array:
    """Derivatives (3 M, SHAPES): the last acts as the one before, but for a factor."""
    rng = np.random.default_rng(2)
    x = np.array([np.cumsum(rng.standard_normal((3, M)), axis=1).ravel() for _ in range(SHAPES)]).T * 2e-3
    x[:, -1] = 0.5 * x[:, -2]
    return x


@dataclass
class Curved:
    """Curves that bend with their amounts, as `Responses`; ``measured`` (trials, 3 M)."""

    measured: Array
    listed: tuple[Source, ...] = LISTED

    @property
    def tested(self) -> Any:
        return SimpleNamespace(action=ACTION)

    @property
    def trials(self) -> list[Any]:
        """Trials, numbered from 1."""
        turn = np.ones((M, 3))
        return [replace(MADE, number=k + 1, time_s=TIME, change_rad=turn) for k in range(len(self.measured))]

    @cached_property
    def candidates(self) -> tuple[Candidate, ...]:
        return candidates(self.listed, range(1, len(self.measured) + 1))

    @property
    def base(self) -> Array:
        return self.exact_differences([Point()])[0]

    def amounts(self, point: Point, t: int) -> Array:
        out = np.zeros(SHAPES)
        for j, z in point.amounts:
            c = self.candidates[j]
            out[c.source] += self.listed[c.source].share(z, c.weights[t])
        return out

    def curve(self, amounts: Array) -> Array:
        total = shapes() @ amounts
        return np.asarray(total + 3.0 * total**2)

    def exact_differences(self, points: Sequence[Point]) -> list[Array]:
        return [np.array([m - self.curve(self.amounts(p, t)) for t, m in enumerate(self.measured)]) for p in points]

    def differences(self, points: Sequence[Point]) -> list[Array]:
        return self.exact_differences(points)

    def columns(
        self,
        asked: Sequence[tuple[Point, int, int]],
        here: Sequence[Array],
        longest: Sequence[float] = (),
        central: bool = False,
    ) -> list[Array]:
        return [shapes()[:, j] * (1.0 + 6.0 * (shapes() @ self.amounts(p, t))) for p, t, j in asked]

    def force_columns(self, at: Point, t: int, here: Array) -> Array:
        return np.zeros((M, 3, 1))

    def curve_changes(self, amounts: Array, here: Array, at: Point) -> Array:
        there = [self.amounts(at, k % len(self.measured)) for k in range(len(amounts))]
        return np.array([self.curve(a + z) - self.curve(a) for a, z in zip(there, amounts, strict=True)])


def explain(
    amounts: Mapping[int, Sequence[float]], trials: int, seed: int = 1, other_rad: float = 0.0, made: type = Curved
) -> Explained:
    """The answer for trials with these amounts of each source; ``other_rad`` is what no cause makes, in all of them."""
    rng = np.random.default_rng(seed)
    each = np.zeros((trials, SHAPES))
    for j, of_trials in amounts.items():
        each[:, j] = of_trials
    other = other_rad * np.sin(40 * np.tile(TIME, 3)) * np.repeat([1.0, -2.0, 0.5], M)
    noise = NOISE_RAD * rng.standard_normal((trials, 3 * M))
    nothing = made(np.zeros((trials, 3 * M)))
    responses = made(np.array([nothing.curve(z) for z in each]) + other + noise)
    found = find_causes(responses, effects=any(source.added for source in responses.listed))
    return make_answer(found, range(1, trials + 1))


def sets(found: Explained) -> set[frozenset[tuple[str, str, int]]]:
    """Cause, profile and first trial of what each set holds."""
    out: dict[int, set[tuple[str, str, int]]] = {}
    for row in found.changes:
        out.setdefault(row.set, set()).add((row.cause, row.profile, row.first))
    return {frozenset(one) for one in out.values()}


@pytest.fixture(autouse=True)
def fewer_draws(monkeypatch: pytest.MonkeyPatch) -> None:
    """Enough for a point of 0.5 %."""
    monkeypatch.setattr(score_test, "DRAWS", 399)


@pytest.mark.parametrize(("seed", "trials"), [(1, 3), (2, 3), (3, 1), (4, 6)])
def test_one_cause_is_named_alone_with_its_size(seed: int, trials: int) -> None:
    found = explain({3: [1.2] * trials}, trials, seed)
    assert sets(found) == {frozenset({("law 3", ALL, 1)})} and not found.nothing and not found.findings
    (row,) = found.changes
    assert abs(np.log(row.change) - 0.3 * 1.2) < 3 * row.u and row.u < 0.05
    assert row.left < row.left_by_noise < 1.0
    assert "no other that was compared does nearly as well" in found.sentence and "law 3 ×" in found.sentence


def test_a_cause_of_eight_prior_standard_uncertainties_is_no_reason_for_another() -> None:
    """Beside itself a cause would gain half of its prior's penalty."""
    found = explain({0: [8.0] * 3}, 3)
    assert sets(found) == {frozenset({(FORCE_GAIN, ALL, 1)})}
    assert abs(np.log(found.changes[0].change) - 0.05 * 8.0) < 3 * found.changes[0].u


def test_causes_that_act_alike_are_both_named() -> None:
    found = explain({SHAPES - 2: [0.9] * 3}, 3)
    assert sets(found) == {frozenset({(f"law {j}", ALL, 1)}) for j in (SHAPES - 2, SHAPES - 1)}
    assert "cannot tell them apart" in found.sentence
    sizes = {row.cause: np.log(row.change) for row in found.changes}
    assert sizes[f"law {SHAPES - 1}"] == pytest.approx(2 * sizes[f"law {SHAPES - 2}"], rel=0.1)


@pytest.mark.parametrize(
    ("profile", "share", "first"),
    [(ONE, (0, 0, 0, 1, 0, 0), 4), (STEP, (0, 0, 0, 1, 1, 1), 4), (TREND, (0, 0.2, 0.4, 0.6, 0.8, 1), 1)],
)
def test_what_some_trials_have_is_told_with_the_trials(profile: str, share: Sequence[float], first: int) -> None:
    found = explain({0: [GAIN.share(1.5, s) for s in share]}, 6)
    assert sets(found) == {frozenset({(FORCE_GAIN, profile, first)})}
    (finding,) = found.findings
    assert finding.kind == "force gain" and finding.channel == "force" and found.changes[0].words in finding.text


class Extrapolated(Curved):
    """Responses that, short of runs of every trial, show that ``law 4`` leaves nearly nothing."""

    def differences(self, points: Sequence[Point]) -> list[Array]:
        out = self.exact_differences(points)
        laws = [{self.listed[self.candidates[j].source].name for j, _ in point.amounts} for point in points]
        return [0.1 * each if found == {"law 4"} else each for found, each in zip(laws, out, strict=True)]


def test_causes_are_compared_by_runs_of_every_trial() -> None:
    each = np.zeros((3, SHAPES))
    each[:, 3] = 1.2
    noise = NOISE_RAD * np.random.default_rng(1).standard_normal((3, 3 * M))
    responses = Extrapolated(np.array([Curved(noise).curve(z) for z in each]) + noise)
    found = make_answer(find_causes(cast(Responses, responses), effects=False), range(1, 4))
    assert sets(found) == {frozenset({("law 3", ALL, 1)})}


@pytest.mark.parametrize(("behind", "named"), [(0.0, 2), (5.2, 2), (5.4, 1)])  # exp(-5.3) is half a percent
def test_fits_named_have_all_but_half_a_percent_of_the_probability(behind: float, named: int) -> None:
    responses = Curved(np.zeros((3, 3 * M)))
    search = Search(cast(Responses, responses), Fit((), np.zeros(0), responses.base, np.zeros((3, 3 * M, 0))))
    best = search.start_fit((search.named[0],))
    fits = [replace(best, log_posterior=0.0), replace(best, log_posterior=-behind)]
    assert len(search.credible_set(fits)) == named


def test_two_causes_of_other_trials_are_named_together() -> None:
    found = explain({0: [0, 0, 0, 1.2, 1.2, 1.2], 5: [-0.9] * 6}, 6)
    assert sets(found) == {frozenset({(FORCE_GAIN, STEP, 4), ("law 5", ALL, 1)})}
    assert "these two causes together" in found.sentence and len(found.findings) == 1


class Alike(Curved):
    """Responses of which the last four laws act alike, but for a factor."""

    def curve(self, amounts: Array) -> Array:
        return super().curve(np.append(amounts[:-4], [amounts[-4:] @ [1.0, 0.9, 0.8, 0.7], *np.zeros(3)]))

    def columns(self, asked: Any, here: Any, longest: Any = (), central: bool = False) -> list[Array]:
        factor = np.append(np.ones(SHAPES - 4), [1.0, 0.9, 0.8, 0.7])
        found = super().columns([(p, t, min(j, SHAPES - 4)) for p, t, j in asked], here)
        return [factor[j] * column for (_, _, j), column in zip(asked, found, strict=True)]


def test_what_all_of_many_pairs_have_is_named_and_the_rest_is_not() -> None:
    found = explain({0: [0, 0, 0, 1.2, 1.2, 1.2], SHAPES - 4: [-0.9] * 6}, 6, made=Alike)
    assert sets(found) == {frozenset({(FORCE_GAIN, STEP, 4)})}
    (row,), (finding,) = found.changes, found.findings
    assert abs(np.log(row.change) - 0.05 * 1.2) < 3 * row.u and row.changes == 2
    assert row.words in finding.text and "the other part is one of 4 causes" in found.sentence
    assert sum(f"law {j} ×" in found.sentence for j in range(SHAPES - 4, SHAPES)) == 3


def test_of_many_causes_that_act_alike_none_is_named() -> None:
    found = explain({SHAPES - 4: [-0.9] * 6}, 6, made=Alike)
    assert not found.changes and not found.findings and "4 causes or pairs of causes" in found.sentence


@dataclass
class Peaked(Curved):
    """Responses with an effect that does most at amount 1, as much at 1/z as at z: a felt's loss over its memory."""

    listed: tuple[Source, ...] = (
        *LISTED[:4],
        Source(
            "added felt", "s", (), 1.0, 0.0,
            step=1.0, effects=("felt",), scaled=(("contact12.stulov.tau", 5e-5, 1.0),),
        ),
        *LISTED[5:],
    )  # fmt: skip

    def curve(self, amounts: Array) -> Array:
        bent = amounts.copy()
        bent[4] = 2.0 * amounts[4] / (1.0 + amounts[4] ** 2)
        return super().curve(bent)

    def columns(self, asked: Any, here: Any, longest: Any = (), central: bool = False) -> list[Array]:
        out = []
        for point, t, j in asked:
            at, step = self.amounts(point, t), 1e-4 * np.eye(SHAPES)[j]
            out.append((self.curve(at + step) - self.curve(at)) / 1e-4)
        return out


def test_two_amounts_of_one_effect_that_do_the_same_are_both_told() -> None:
    found = explain({4: [1.6] * 3}, 3, made=Peaked)
    assert sets(found) == {frozenset({("added felt", ALL, 1)})}
    below, above = sorted(found.changes, key=lambda row: row.change)
    assert below.change == pytest.approx(5e-5 / 1.6, abs=3 * below.u)
    assert above.change == pytest.approx(5e-5 * 1.6, abs=3 * above.u)
    assert "at either of these sizes, which the trials cannot tell apart" in found.sentence
    assert f"added felt = {1e6 * above.change:.3g} µs (standard uncertainty {1e6 * above.u:.2g} µs)" in found.sentence


@given(st.floats(-3.0, 3.0), st.floats(0.0, 1.0))
def test_a_share_of_a_change_is_that_share_of_what_is_added(z: float, w: float) -> None:
    for source in (GAIN, replace(GAIN, unit="m")):
        whole, part = (source.at(2.0, amount) - 2.0 for amount in (z, source.share(z, w)))
        assert part == pytest.approx(w * whole, abs=1e-12)
        slope = (source.share(z + 1e-5, w) - source.share(z - 1e-5, w)) / 2e-5
        assert source.share_slope(z, w) == pytest.approx(slope, abs=1e-8)


def test_a_drift_is_told_by_what_it_adds_in_each_trial() -> None:
    shares = [GAIN.share(4.0, k / 5) for k in range(6)]
    found = explain({0: shares}, 6)
    (row,) = found.changes
    assert row.profile == TREND and abs(np.log(row.change) - 0.2) < 3 * row.u
    assert f"drifts by +{100 * (row.change - 1) / 5:.2g} % per trial" in row.words


def test_what_two_pairs_have_in_common_is_told_once() -> None:
    found = explain({0: [0, 0, 0, 1.2, 1.2, 1.2], SHAPES - 2: [-0.9] * 6}, 6)
    gain = (FORCE_GAIN, STEP, 4)
    assert sets(found) == {frozenset({gain, (f"law {j}", ALL, 1)}) for j in (SHAPES - 2, SHAPES - 1)}
    assert found.sentence.startswith("about the model or the session: each of these explains")
    (finding,) = found.findings
    assert finding.kind == "force gain" and "cannot tell" not in finding.text and finding.text.count("force gain") == 1


def test_two_causes_of_some_trials_are_told_with_each_other() -> None:
    found = explain({0: [0, 0, 0, 1.2, 1.2, 1.2], 5: [0, -0.6, -0.6, -0.6, -0.6, -0.6]}, 6)
    assert sets(found) == {frozenset({(FORCE_GAIN, STEP, 4), ("law 5", STEP, 2)})}
    assert found.sentence.startswith("about the model and the session: these two causes together")
    assert sorted(f.text.split(": ")[1][:20] for f in found.findings) == [
        "with force gain, this"[:20],
        "with law 5, this expl"[:20],
    ]


def test_what_no_cause_makes_is_called_none_with_what_was_compared() -> None:
    found = explain({}, 3, other_rad=5e-3)
    assert found.sentence.startswith("none of the causes that were compared") and not found.changes
    assert "force gain, laws of friction, felt and springs" in found.sentence and "fewer than four" in found.sentence


def test_noise_around_a_cause_of_some_trials_is_that_of_trials_with_and_without_it() -> None:
    """The curves bend, so that a trial with the cause answers the scatter of a law by another amount."""
    responses = cast(Responses, Curved(np.tile(shapes()[:, 0], (6, 1))))
    step = next(i for i, c in enumerate(responses.candidates) if (c.source, c.profile, c.first) == (0, STEP, 4))
    each = np.zeros((6, 3 * M))
    least, most, mixed = (
        Search(responses, Fit((i,), np.array([z]), each, np.zeros((6, 3 * M, 1)))).noise
        for i, z in ((0, 0.0), (0, 1.5), (step, 1.5))
    )
    for k in range(len(score_test.DEVIATIONS)):
        first, second, both = (noise.between[k] @ noise.between[k].T for noise in (least, most, mixed))
        assert both == pytest.approx(0.5 * (first + second), rel=1e-6, abs=1e-12)
        assert np.trace(second) > 1.05 * np.trace(first)


def test_trials_that_agree_need_no_cause() -> None:
    found = explain({}, 6)
    assert found.nothing and not found.changes and "no part of the model need have changed" in found.sentence


def test_a_model_that_does_not_answer_is_not_asked_further() -> None:
    class Still(Curved):
        def columns(self, asked: Any, here: Any, longest: Any = (), central: bool = False) -> list[Array]:
            return [np.zeros(3 * M) for _ in asked]

    assert explain({3: [1.2] * 3}, 3, made=Still) == Explained()


def test_two_sizes_within_their_uncertainty_are_one() -> None:
    found = explain({4: [1.02] * 3}, 3, made=Peaked)  # where the effect does most
    assert len(found.changes) == 1 and "either of these sizes" not in found.sentence


@pytest.mark.parametrize("seed", [1, 3])
def test_a_pair_is_kept_where_neither_cause_of_it_leaves_noise(seed: int) -> None:
    found = explain({0: [1.5] * 3, 6: [-0.9] * 3}, 3, seed)
    assert sets(found) == {frozenset({(FORCE_GAIN, ALL, 1), ("law 6", ALL, 1)})}


def test_contrasts_are_orthonormal_and_beside_the_mean() -> None:
    turn = helmert(5)
    assert turn[0] == pytest.approx(np.full(5, 0.2))
    assert turn[1:] @ turn[1:].T == pytest.approx(np.eye(4)) and turn[1:].sum(axis=1) == pytest.approx(np.zeros(4))


SCATTER = np.where(np.arange(SHAPES) == 1, 0.05, 0.0)


def scattered_runs() -> np.ndarray:
    """Changes of the curves by the scatter of law 1."""
    return np.random.default_rng(1).standard_normal((200, SHAPES)) * SCATTER @ shapes().T


@pytest.fixture(scope="module")
def noise() -> BalancedNoise:
    """Noise of six trials of which law 1 scatters."""
    nil, columns = np.zeros((3 * M, 0)), shapes()
    size = np.full((3, M), 5e-3)
    block = Block(0, TIME, columns, nil, nil, nil, np.full(3 * M, NOISE_RAD**2), size, np.zeros(M))
    families = np.full(SHAPES, -1)
    return BalancedNoise([(1.0, block)], families, SCATTER, 1e-3 * np.eye(SHAPES), 6, np.zeros((4, 3 * M)))


def test_score_statistic_is_that_of_the_whole_covariance(noise: BalancedNoise) -> None:
    listed = candidates(LISTED, range(1, 7))
    test = ScoreTest(noise, shapes(), listed)
    turned = noise.draw(2, 1, np.random.default_rng(3), scattered_runs())[0]
    gains, k = test.gains(turned)
    roots = [noise.mean[k], *5 * [noise.between[k]]]
    for n in (0, 4, 30, len(listed) - 1):
        weights = helmert(6) @ np.array(listed[n].weights)
        x = [w * shapes()[:, listed[n].source] for w in weights]
        inverse = [np.linalg.inv(root @ root.T) for root in roots]
        g = sum(a @ c @ a for a, c in zip(x, inverse, strict=True))
        b = sum(a @ c @ r for a, c, r in zip(x, inverse, turned, strict=True))
        assert gains[n] == pytest.approx(b**2 / (1.0 + g), rel=1e-6)


def test_a_session_is_tested_as_the_drawn_ones_are(noise: BalancedNoise) -> None:
    """Its deviation is profiled with and without a cause: the best of all less the best of none."""
    test = ScoreTest(noise, shapes(), candidates(LISTED, range(1, 7)))
    turned = noise.draw(3, 1, np.random.default_rng(5), scattered_runs())[0]
    turned[0] += 0.5 * shapes()[:, 2]
    gains, k = test.gains(turned)
    single, pair = test.statistics(turned)
    assert single == pytest.approx(gains.max(), rel=1e-9) and single < pair
    null, one = noise.log_likelihoods(turned), [test.gram(k), test.products(k, noise.whiten(k, turned)[None])[0]]
    by_hand = null[k] + 0.5 * np.max(one[1] ** 2 / (1.0 + np.diag(one[0]))) - null.max()
    assert single == pytest.approx(2.0 * by_hand, rel=1e-9)


def test_what_no_session_tells_apart_is_one_group_and_what_cannot_show_none(noise: BalancedNoise) -> None:
    columns = shapes()
    columns[:, 4] *= 1e-7
    listed = candidates(LISTED, [1])
    test = ScoreTest(noise, columns, [replace(c, weights=(1.0,) * 6) for c in listed])
    groups = test.group_alike(2, np.full(SHAPES, 4.0))
    assert groups[SHAPES - 2] == {SHAPES - 1: pytest.approx(2.0)} and SHAPES - 1 not in groups  # half the column
    assert 4 not in groups and not any(4 in group for group in groups.values())
    assert sorted(groups) == [i for i in range(SHAPES - 1) if i != 4]


def test_threshold_is_exceeded_as_seldom_as_stated(noise: BalancedNoise) -> None:
    test = ScoreTest(noise, shapes(), candidates(LISTED, range(1, 7)))
    rng, runs = np.random.default_rng(4), scattered_runs()
    sessions = [noise.draw(int(k), 1, rng, runs)[0] for k in rng.integers(0, 3, 300)]
    threshold = test.find_threshold(sessions[0], runs)
    assert sum(test.gains(one)[0].max() > threshold.single for one in sessions) <= 7  # 1.5 expected at 0.5 %
    assert 10.0 < threshold.single < threshold.pair
