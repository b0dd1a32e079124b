"""What to record next: predicted shrinks are realised, ranks are right, a plan is written that can be played."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import model
import rig
from tests.validation.infer import toy
from validation.conventions import Array
from validation.errors import ValidationInputError
from validation.infer.blocks import rows
from validation.infer.fit import Fitted, fit
from validation.infer.further import (
    Candidate,
    Prospect,
    add_trials,
    block_of,
    prospects,
    remaining_u,
    scale_profile_force,
    u_from_noise_sizes,
    write_plan,
)
from validation.infer.observations import ObservedTrial
from validation.infer.problem import Problem, make_problem_at_start
from validation.infer.response import ModelResponse, Own
from validation.infer.sources import IdentifyOptions, collect
from validation.infer.unknowns import unknowns

TRUTH = np.array([0.8, -0.5, 0.3])
EXAMPLE = Path(__file__).parents[3] / "sessions" / "example_forte"
AGAIN = 6


class Other(toy.Toy):
    """Another kind of stroke, in which the third parameter does five times as much."""

    def parts(self, z: Array) -> Array:
        return super().parts(z) * np.array([1.0, 1.0, 5.0])


class Mixed(toy.Toy):
    """Strokes of the usual kind in session 0, of the other kind in session 1."""

    def of(self, trial: ObservedTrial) -> toy.Toy:
        return Other([trial]) if trial.session else toy.Toy([trial])

    def curves(self, points: Sequence[Array], own: Sequence[Sequence[Own]] | None = None) -> list[list[Array] | None]:
        return [
            [self.of(t).curve(at) for t, at in zip(self.trials, self.places(z, o), strict=True)]
            for z, o in zip(points, len(points) * [None] if own is None else own, strict=True)
        ]

    def slope_of(self, k: int, z: Array) -> Array:
        return self.of(self.trials[k]).slope(z)


def first(rng: np.random.Generator, n: int = 8) -> tuple[Problem, Fitted]:
    """A fit of the usual strokes."""
    p = toy.problem(toy.made(TRUTH, n, rng))
    return p, fit(p)


@pytest.fixture(scope="module")
def usual() -> tuple[Problem, Fitted]:
    """A fit of the usual strokes, for all who only read it."""
    return first(np.random.default_rng(12))


def test_a_fixed_law_acts_in_a_stroke_to_come_as_it_does_where_the_fit_ended() -> None:
    """Its column was that of the values before the fit."""
    start = model.load_action()
    free = unknowns(start, ["contact07.friction"], ["*"])
    law = next(p for p in free.held if p.name == "hammer.joint_friction.A")
    (trial, *_) = collect([EXAMPLE], start, IdentifyOptions(phases=15)).fitted
    runs = ModelResponse(start, (*free.moved, law), [trial], 1e-8)
    z = np.array([3.0, 0.0, 0.0, 0.0])
    problem, _ = make_problem_at_start(start, replace(free, held=(law,)), [trial], runs)
    block = block_of(problem, z, trial, lambda some: runs)
    steps = [(runs.curves([np.append(at, s)])[0] or [])[0] for at in (z, 0 * z) for s in (0.02, -0.02)]
    there, before = (rows(a - b) / 0.04 for a, b in (steps[:2], steps[2:]))
    size = np.max(np.abs(there))
    assert np.max(np.abs(block.held[:, 0] - there)) < 0.03 * size < 0.1 * size < np.max(np.abs(before - there))


def test_what_is_predicted_is_realised_within_a_fifth() -> None:
    rng = np.random.default_rng(11)
    p, before = first(rng)
    other = Candidate("other", toy.trial(0, Other([]).curve(before.z), 1))
    ranked, refused = prospects(p, before, [other], AGAIN, Mixed)
    assert not refused
    (predicted,) = [one for one in ranked if one.name == "other"]
    new = [
        toy.trial(k, Other([]).curve(TRUTH + 0.05 * rng.standard_normal(3)) + 1e-5 * rng.standard_normal((toy.M, 3)), 1)
        for k in range(AGAIN)
    ]
    both = replace(p, trials=(*p.trials, *new), response=Mixed([*p.trials, *new]))
    after = fit(both)
    realised = np.sqrt(np.diag(after.covariance) / np.diag(before.covariance))[:3]
    assert np.array(list(predicted.shrink.values())) == pytest.approx(realised, rel=0.2)
    for name, found in zip(predicted.shrink, realised, strict=True):
        low, high = predicted.range(name)
        assert low < found < high and 1.1 < high / low < 10.0  # the strokes teach about the scatter, too


def test_limits_close_where_the_sizes_of_noise_are_known() -> None:
    """Twenty-four trials know the scatter that three do not."""
    wide = []
    for n in (3, 24):
        p, before = first(np.random.default_rng(5), n)
        block = block_of(p, before.z, toy.trial(0, Other([]).curve(before.z)), Other)
        wide.append(float(u_from_noise_sizes(before, add_trials(before, block, AGAIN)).max()))
    assert wide[1] < 0.5 * wide[0]


class Forked(Other):
    """A kind of stroke that answers a scatter of the first parameter by its square, too."""

    def __init__(self, trials: Sequence[ObservedTrial], at: Array, bend: float) -> None:
        super().__init__(trials)
        self.at, self.bend = at, bend

    def curve(self, z: Array) -> Array:
        far = float((z - self.at)[0] / 0.05) ** 2
        return np.asarray(super().curve(z) + self.bend * np.outer(np.sin(13 * toy.TIME), [0.5, 1.0, 2.0]) * far)


def test_a_stroke_near_a_fork_is_told_from_one_that_answers_linearly(usual: tuple[Problem, Fitted]) -> None:
    """What the Fisher information promises alike, a rehearsal does not; the limits hold both."""
    p, before = usual
    told = {}
    for name, bend in (("straight", 0.0), ("forked", 1e-3)):

        def respond(trials: Sequence[ObservedTrial], bend: float = bend) -> toy.Toy:
            return Forked(trials, before.z, bend) if trials[0].session else toy.Toy(trials)

        one = Candidate(name, toy.trial(0, Forked([], before.z, bend).curve(before.z), 1))
        ranked, _ = prospects(p, before, [one], AGAIN, respond)
        told[name] = next(q for q in ranked if q.name == name)
    straight, forked = told["straight"], told["forked"]
    assert list(forked.fisher.values()) == pytest.approx(list(straight.fisher.values()))
    assert list(straight.shrink.values()) == pytest.approx(list(straight.fisher.values()), rel=0.1)
    assert forked.mean > 1.15 * straight.mean
    for name, linear in forked.fisher.items():
        low, high = forked.range(name)
        assert low < linear < high and low < forked.shrink[name] < high


def test_a_stroke_that_cannot_be_rehearsed_keeps_its_prediction(usual: tuple[Problem, Fitted]) -> None:
    class Stuck(Other):
        """Cannot run but at one point."""

        def curves(self, points: list[Array]) -> list[list[Array] | None]:  # type: ignore[override]
            return [None for _ in points]

    p, before = usual
    stuck = Candidate("stuck", toy.trial(0, Other([]).curve(before.z), 1))
    ranked, _ = prospects(p, before, [stuck], AGAIN, lambda t: Stuck(t) if t[0].session else toy.Toy(t))
    found = next(q for q in ranked if q.name == "stuck")
    assert found.shrink == found.fisher and min(found.u_sizes.values()) > 0.0


class Blind(toy.Toy):
    """A stroke that says next to nothing of the third parameter."""

    def parts(self, z: Array) -> Array:
        return super().parts(z) * np.array([1.0, 1.0, 0.002])


def test_a_stroke_that_says_what_is_unknown_is_preferred_to_more_of_the_same() -> None:
    trials = [toy.trial(k, Blind([]).curve(TRUTH) + 1e-5 * rng_of(k).standard_normal((toy.M, 3))) for k in range(6)]
    p = replace(toy.problem(trials), response=Blind(trials))
    before = fit(p)
    usual = Candidate("usual", toy.trial(0, toy.Toy([]).curve(before.z), 1))
    ranked, _ = prospects(p, before, [usual], AGAIN, lambda t: toy.Toy(t) if t[0].session else Blind(t))
    by_name = {q.name: q for q in ranked}
    assert ranked[0].name == "usual"
    third = toy.ASKED[2]
    assert by_name["usual"].shrink[third] < 0.2 < by_name["more of toy 0"].shrink[third]
    assert all(q.mean <= 1.02 for q in ranked)  # a rehearsal may learn that scatter is larger


def rng_of(k: int) -> np.random.Generator:
    return np.random.default_rng([12, k])


def prospect(name: str = "forte", level: float = 1.4) -> Prospect:
    profile = scale_profile_force(rig.load_profile(name), level)
    candidate = Candidate(profile.name, toy.trial(0, np.zeros((toy.M, 3))), profile)
    return Prospect(profile.name, {"hammer.joint_friction.A": 0.5}, candidate, 4)


@pytest.mark.parametrize("level", [1.0, 1.4])
def test_the_plan_is_one_that_record_plays(tmp_path: Path, level: float) -> None:
    sensor = Prospect("load cell's gain known twice as well", {"hammer.joint_friction.A": 0.4})
    doubts = ["the fit did not settle"] if level > 1.0 else []
    files = write_plan([sensor, prospect(level=level), prospect("piano")], tmp_path / "next.toml", doubts)
    plan = rig.load_plan(files["next.toml"])
    assert len(plan.entries) == 4
    (played,) = plan.profiles.values()
    np.testing.assert_allclose(played.force_n, level * rig.load_profile("forte").force_n)
    assert "twice as well" in files["next.toml"].read_text("utf-8")
    assert ("# In doubt: the fit did not settle.\n" in files["next.toml"].read_text("utf-8")) == bool(doubts)


def test_a_plan_without_a_stroke_or_in_a_wrong_place_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValidationInputError, match="no profile can be recommended"):
        write_plan([Prospect("sensor", {"a": 0.9})], tmp_path / "next.toml")
    with pytest.raises(ValidationInputError, match="allowed .toml"):
        write_plan([prospect()], tmp_path / "next.csv")
    assert not list(tmp_path.iterdir())


def test_one_more_calibration_leaves_the_rounding_of_a_zero() -> None:
    trial = replace(
        toy.trial(1, np.zeros((toy.M, 3))),
        u_zero_rad=np.array([3e-6, 0.0, 5e-6]),
        u_steady_rad=np.array([5e-6, 2e-6, 5e-6]),
    )
    left = [remaining_u(trial, f"{name} encoder zero") for name in ("key", "whippen", "hammer")]
    assert left == pytest.approx([np.hypot(3e-6, 0.5 * 4e-6) / 5e-6, 0.5, 1.0])
    assert remaining_u(trial, "hammer encoder scale") == remaining_u(trial, "jack film scale") == 0.5
