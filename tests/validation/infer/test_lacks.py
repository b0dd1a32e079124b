"""What strokes say in spite of what the model lacks: fits with one change let in, laid together."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np

import model
from tests.validation.infer import toy
from validation.conventions import ENCODER_BODIES
from validation.infer import lacks
from validation.infer.estimates import IDENTIFIED
from validation.infer.fit import fit
from validation.infer.further import Candidate, Prospect
from validation.infer.lacks import LetIn, Supported, describe_lack_phase, find_supported_estimates, measure_separation
from validation.infer.sentences import describe_separating_stroke
from validation.infer.sources import IdentifyOptions, collect
from validation.infer.unknowns import parameter_of, single_names

TRUTH = np.array([0.4, -0.3, 0.2])
ACTION, EXAMPLE = model.load_action(), Path(__file__).parents[3] / "sessions" / "example_forte"


def let_in(change: float, gain: float = 0.0) -> LetIn:
    """A fit that is as good as another, its first value so much larger."""
    problem = toy.problem(toy.made(TRUTH, 5, np.random.default_rng(3)))
    found = fit(problem)
    return LetIn(None, problem, replace(found, z=found.z + change * np.array([1.0, 0.0, 0.0])), gain)


def test_an_interval_holds_those_of_all_fits_that_explain_as_well() -> None:
    one, other = let_in(0.0), let_in(0.1, -1.0)
    (alone, *_), _ = lacks._combine_estimates([one])
    (both, rest, *_), _ = lacks._combine_estimates([one, other])
    assert alone.verdict == both.verdict == rest.verdict == IDENTIFIED
    assert both.low == alone.low and both.high > alone.high and both.value == alone.value


def test_a_value_that_fits_disagree_on_is_not_known() -> None:
    estimates, _ = lacks._combine_estimates([let_in(0.0), let_in(2.5)])
    assert [e.verdict == IDENTIFIED for e in estimates] == [False, True, True]
    assert "one thing or another" in estimates[0].verdict


def test_where_a_lack_shows_is_told_by_the_blow() -> None:
    problem = toy.problem(toy.made(TRUTH, 3, np.random.default_rng(3)))
    hammer = np.abs(problem.trials[0].change_rad[:, 2])
    blow = int(np.argmax(hammer > 0.95 * hammer.max()))
    after = np.zeros((toy.M, 3))
    after[blow + 3 :, 0] = 1e-3
    after[-1, 0] = 2e-3
    step = 1e3 * (toy.TIME[1] - toy.TIME[0])
    said = f"shows from {3 * step:.0f} ms after the blow on, most {step * (toy.M - 1 - blow):.0f} ms after the blow"
    assert describe_lack_phase(problem, 3 * [after]) == said
    assert describe_lack_phase(problem, 3 * [0.0 * after]) == "is below the sensors' noise"


def test_what_a_film_lost_does_not_say_where_a_lack_shows() -> None:
    problem = toy.problem(toy.made(TRUTH, 3, np.random.default_rng(3)))
    noise, lack = np.full((toy.M, 3), 1e-5), np.zeros((toy.M, 3))
    lack[[5, 9], 1] = [1e-3, 2e-3]
    plain = describe_lack_phase(problem, 3 * [lack])
    noise[2, 0] = np.nan
    filmed = replace(problem, trials=tuple(replace(t, u_white_rad=noise) for t in problem.trials))
    assert describe_lack_phase(filmed, 3 * [lack]) == plain


def test_the_stroke_in_which_fits_differ_most_tells_best_what_is_lacking() -> None:
    first, second, *_ = collect([EXAMPLE], ACTION, IdentifyOptions(phases=20)).fitted
    soft = replace(second, force_n=second.preload_n + 0.5 * (second.force_n - second.preload_n))
    lost = np.outer(np.arange(20) != 7, np.ones(3))
    filmed = replace(first, u_white_rad=np.where(lost, [1e-5, 2e-5, 3e-5], np.nan))
    both = let_in(0.0), let_in(2.5)
    apart = []
    for trial in (filmed, soft):
        curves = []
        for one in both:
            moved = [p.values(ACTION, z) for p, z in zip(one.problem.unknowns.asked, one.fitted.z, strict=True)]
            action = ACTION.with_values({path: v for values in moved for path, v in values.items()})
            rest = model.rest_state(action, force_n=trial.preload_n)
            run = model.simulate(
                action, trial.force_time_s, trial.force_n, tolerance=1e-7, output_time_s=trial.time_s, initial=rest
            )
            curves.append((run.angle_rad - rest.angle_rad)[:, ENCODER_BODIES])
        apart.append(np.sqrt(np.nanmean(((curves[0] - curves[1]) / trial.u_white_rad) ** 2)))
    np.testing.assert_allclose(measure_separation(both, [filmed, soft]), apart, rtol=1e-3)
    ranked = [Prospect("hammer encoder known twice as well", {})]
    ranked += [Prospect(name, {}, Candidate(name, t), 5) for name, t in (("forte", filmed), ("piano", soft))]
    found = SimpleNamespace(details=SimpleNamespace(supported=Supported(both, (), (), 7, "")))
    best = int(np.argmax(apart))
    (said,) = describe_separating_stroke(found, ranked)  # type: ignore[arg-type]
    assert f"told best by 5 {('forte', 'piano')[best]}: " in said and f"by {apart[best]:.0f} times" in said


def test_the_felt_of_a_contact_that_is_promising_otherwise_is_let_in_too() -> None:
    """A felt twice as stiff promises nothing in a linear model, its memory or its place a good deal."""

    def rows(**gains: float) -> list[lacks.Promise]:
        return [(g, parameter_of(ACTION, n, names[n]), ACTION) for n, g in gains.items()]  # type: ignore[list-item]

    names = single_names(ACTION)
    held = rows(**{"contact10.second.x": 40.0, "key.joint_friction.A": 30.0, "contact01": 2.0, "contact10": -2.0})
    effects = [(44.0, replace(held[0][1], name="contact01.stulov.tau"), ACTION)]
    chosen = [row[1].name for row in lacks._rank_changes([held, effects], 0.03)]
    assert chosen == ["contact10.second.x", "key.joint_friction.A", "contact01.stulov.tau", "contact01", "contact10"]
    small = [row[1].name for row in lacks._rank_changes([held, effects], 0.003)]
    assert small == chosen[:3]  # for what is small a linear model will do
    assert [row[1].name for row in lacks._rank_changes([held[1:], []], 0.03)] == ["key.joint_friction.A"]


def test_a_model_that_no_force_drives_is_not_asked() -> None:
    one = let_in(0.0)
    assert find_supported_estimates(one.problem, one.fitted, lambda text: None) is None
