"""Checks between trials, of films and of regulation: each fault at three sizes."""

from __future__ import annotations

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from validation.events.key_lift import KeyLift
from validation.findings.encoders import find_capstan_gaps
from validation.findings.film import check_camera_clock, find_miswired_film
from validation.findings.find_faults import _check_capstan
from validation.findings.finding import SessionFinding
from validation.findings.let_off_and_check import compare_check_height, compare_let_off, find_let_off_and_check
from validation.findings.outlying_trials import find_outlying_residuals, make_residuals
from validation.findings.stroke_kinds import find_mixed_strokes, find_single_strokes, group_strokes
from validation.findings.trial_records import find_duplicates


def scaled_force(m, by):
    above = m.force.preload_n + by * (m.force.force_n - m.force.preload_n)
    return replace(m, force=replace(m.force, force_n=above))


def test_a_copy_of_a_trial_is_found_and_strokes_alike_are_none(stage):
    assert find_duplicates(stage.trials) == []
    copy = replace(stage.trials[1], number=7, raw_force_n=stage.trials[1].raw_force_n + 1e-3)
    (found,) = find_duplicates([*stage.trials, copy])
    assert (found.trial, found.value) == (7, 2)
    assert "counts as in trial 2" in found.text
    touched = copy.change_rad.copy()
    touched[500] += copy.resolution_rad
    assert find_duplicates([*stage.trials, replace(copy, change_rad=touched)]) == []  # detectable are whole copies


@pytest.mark.parametrize("by", [3.0, 1.4])
def test_two_kinds_of_stroke_are_told_apart(stage, by):
    trials = [m if i % 2 else scaled_force(m, by) for i, m in enumerate(stage.trials)]
    kinds = group_strokes(trials)
    assert kinds == ((1, 3, 5), (2, 4, 6))
    (found,) = find_mixed_strokes(trials, kinds)
    assert "trials 2, 4, 6" in found.text
    assert "trials 1, 3, 5" in found.text
    assert find_single_strokes(trials, kinds) == []


def test_one_odd_stroke_and_a_small_difference_are_no_two_kinds(stage):
    every = (1, 2, 3, 4, 5, 6)
    assert group_strokes(stage.trials) == (every,)
    odd = [scaled_force(m, 2.0 if m.number == 4 else 1.0) for m in stage.trials]
    kinds = group_strokes(odd)
    assert find_mixed_strokes(odd, kinds) == []
    (found,) = find_single_strokes(odd, kinds)
    assert found.trial == 4
    assert group_strokes([scaled_force(m, 1.0 + 0.15 * (m.number > 3)) for m in stage.trials]) == (every,)
    spread = [scaled_force(m, 1.2**m.number) for m in stage.trials]  # all different, and each near the next
    assert group_strokes(spread) == (every,)


def moved(residuals, where, by):
    shape = np.linspace(0, 1, len(residuals.by_channel["key"]))
    return replace(residuals, by_channel={c: r + by * np.outer(shape, where) for c, r in residuals.by_channel.items()})


def uncertain(m):
    """A trial whose zero of the force is hardly known: its force may move it anywhere."""
    return replace(m, force=replace(m.force, hum=replace(m.force.hum, u_offset_n=0.2)))


def test_an_odd_residual_is_found_only_where_the_force_does_not_explain_it(stage):
    trials = {m.number: m for m in stage.trials}
    residuals = make_residuals(stage.predicted, stage.events, stage.trials)
    assert find_outlying_residuals(stage.tested, trials, residuals) == []
    odd = np.array(residuals.numbers) == 5
    for by in (0.5, 0.05):
        (found,) = find_outlying_residuals(stage.tested, trials, moved(residuals, odd, by))
        assert found.trial == 5
    assert find_outlying_residuals(stage.tested, trials, moved(residuals, odd, 2e-3)) == []
    loose = trials | {5: uncertain(trials[5])}
    assert find_outlying_residuals(stage.tested, loose, moved(residuals, odd, 0.05)) == []


def filmed(stage):
    (m,) = [m for m in stage.trials if m.film is not None]
    return m, stage.predictions(m.number)


def test_a_mirrored_film_and_swapped_bodies_are_named(stage):
    m, p = filmed(stage)
    assert find_miswired_film(m, p, whippen_sound=True) == []
    film = m.film
    turned = {name: -x for name, x in film.change_rad.items()}
    mirrored = replace(m, film=replace(film, change_rad=turned, whippen_rad=-film.whippen_rad))
    assert [f.kind for f in find_miswired_film(mirrored, p, whippen_sound=True)] == ["film mirrored"]
    alone = replace(m, film=replace(film, change_rad=turned, whippen_rad=None))
    assert [f.kind for f in find_miswired_film(alone, p, whippen_sound=True)] == ["film mirrored"]
    # the encoder's own sign flip is not the film's
    flipped = replace(m, change_rad=m.change_rad * [1, -1, 1])
    assert find_miswired_film(flipped, p, whippen_sound=False) == []
    swapped = {"jack": film.change_rad["repetition"], "repetition": film.change_rad["jack"]}
    found = find_miswired_film(replace(m, film=replace(film, change_rad=swapped)), p, whippen_sound=True)
    assert [f.kind for f in found] == ["film bodies swapped"]


@pytest.mark.parametrize("factor", [1.5, 0.9])
def test_film_and_encoder_of_different_scale_are_named_together(stage, factor):
    m, p = filmed(stage)
    (found,) = find_miswired_film(
        replace(m, film=replace(m.film, whippen_rad=factor * m.film.whippen_rad)), p, whippen_sound=True
    )
    assert found.kind == "film travel difference"
    assert found.value == pytest.approx(factor, rel=0.01)
    other = replace(m, film=replace(m.film, whippen_rad=1.02 * m.film.whippen_rad))
    assert find_miswired_film(other, p, whippen_sound=True) == []
    assert check_camera_clock(other) == []  # a scale is no clock


@pytest.mark.parametrize("lost, rate", [(20, 1.01), (4, 1.005)])
def test_lost_frames_and_a_wrong_rate_are_named_together(stage, lost, rate):
    m, _ = filmed(stage)
    film = m.film
    middle = film.time_s.size // 2
    keep = np.r_[0:middle, middle + lost : film.time_s.size]
    short = replace(
        film,
        time_s=film.time_s[: keep.size],
        whippen_rad=film.whippen_rad[keep],
        change_rad={n: x[keep] for n, x in film.change_rad.items()},
        u_rad={n: x[keep] for n, x in film.u_rad.items()},
    )
    (found,) = check_camera_clock(replace(m, film=short))
    assert found.kind == "film time drift"
    assert found.value == pytest.approx(-lost / 2000, abs=2e-4)
    assert f"or {lost} frames" in found.text
    fast = replace(film, time_s=film.time_s[0] + rate * (film.time_s - film.time_s[0]))
    (found,) = check_camera_clock(replace(m, film=fast))
    stated = float(re.search(r": ([0-9.]+) % of the time between", found.text)[1])
    assert stated == pytest.approx(100 * (rate - 1), rel=0.1)
    assert check_camera_clock(m) == []
    slow = replace(film, time_s=film.time_s[0] + 1.0001 * (film.time_s - film.time_s[0]))
    assert check_camera_clock(replace(m, film=slow)) == []


def test_let_off_without_faults_is_the_models(stage):
    for m in stage.trials:
        own, theirs = stage.events.trial[m.number], stage.events.model[m.number]
        d, u = compare_let_off(m, stage.predictions(m.number), own, theirs, stage.geometry(m))
        assert abs(d) < 0.3e-3 and 0.02e-3 < u < 0.4e-3
        assert abs(compare_check_height(own, theirs)[0]) < 1e-3


def test_let_off_and_check_are_said_of_exactly_the_trials_that_have_them():
    def differences(by_trial, u=1e-4):
        return {n: (d, u) for n, d in by_trial.items()}

    none = dict.fromkeys(range(1, 7), float("nan"))
    for d in (-2e-3, 1e-3):
        (found,) = find_let_off_and_check(differences({n: d + 5e-5 * n for n in none}), differences(none))
        assert (found.kind, found.channel) == ("let-off", "let_off")
        assert found.value == pytest.approx(d, abs=2e-4) and "mm (standard uncertainty 0.11 mm)" in found.text
    small = differences(dict.fromkeys(none, 4e-4)), differences(dict.fromkeys(none, 1.5e-3))
    assert find_let_off_and_check(*small) == []
    both = differences({1: 3e-3, 2: -3e-3, 3: 3e-3, 4: -2e-3, 5: 0.0, 6: 4e-3})
    further, closer = find_let_off_and_check(both, differences(none))
    assert (further.trials, closer.trials) == ((1, 3, 6), (2, 4))
    assert "further from the string than in the model in trials 1, 3, 6 (3 of 6 trials)" in further.text
    assert find_let_off_and_check(differences({1: 4e-3, 2: 5e-3}, u=3e-3), differences(none)) == []
    (found,) = find_let_off_and_check(differences(none), differences(dict.fromkeys(none, -3e-3) | {2: 0.0}))
    assert found.kind == "check height"
    assert "in trials 1, 3, 4, 5, 6 (5 of 6 trials)" in found.text and "model" in found.text


@pytest.mark.parametrize(
    "largest_at_s, lift_m, named",
    [(0.320, 0.12e-3, False), (0.320, 0.25e-3, True), (0.304, 0.12e-3, True)],
)
def test_a_lift_that_is_largest_after_the_release_is_a_late_one_wherever_its_edge_is(largest_at_s, lift_m, named):
    lift = KeyLift(0.3035, 0.33, largest_at_s, 5 * lift_m, lift_m, 0.0, "")
    assert bool(find_capstan_gaps({2: [lift]}, {2: 0.305})) == named


@pytest.mark.parametrize("kind, named", [("reversed force", False), ("sign flip", False), ("hum", True)])
def test_no_lift_is_named_where_a_channel_or_the_prediction_is_spoilt(kind, named):
    lift = KeyLift(0.1, 0.2, 0.15, 1e-3, 3e-4, 0.0, "")
    events = SimpleNamespace(lifts={1: [lift]}, trial={1: {"key_release": SimpleNamespace(value=0.5)}})
    assert bool(_check_capstan(events, [SessionFinding(kind, 1, "force", -1.0, 0.3, "")])) == named
