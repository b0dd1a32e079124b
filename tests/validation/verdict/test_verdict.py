"""What the verdict says: the five outcomes in their order, the quantities of the claim, and what is not tested."""

from __future__ import annotations

import shutil
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

import model
import validation
from rig.session import Session
from validation.errors import ValidationInputError
from validation.events.definitions import EVENTS, Event
from validation.events.detect import make_absent_event
from validation.events.session_events import Window
from validation.result import AGREES, CANNOT_TELL, DIFFERS, DIFFERS_LITTLE, DIFFERS_PERHAPS
from validation.verdict.error_draws import INPUTS, Condition, SessionErrors
from validation.verdict.estimate import ErrorSample
from validation.verdict.quantities import (
    ANGLES,
    INDEX,
    IS_PRIMARY,
    QUANTITIES,
    branch_mask,
    branch_of,
    branch_words,
    event_values,
    phase_masks,
    relevance_limits,
)
from validation.verdict.verdict import (
    decide_outcome,
    describe_halving,
    detectable_words,
    format_interval,
    is_another_fall,
    judge_model,
    reading_of,
    undecided_verdict,
)


def table(**rows: tuple[float, float, bool]) -> pd.DataFrame:
    """Primary quantities with their 95 % interval in units of their limit, and whether they are resolved."""
    made = []
    for name, (low, high, resolved) in rows.items():
        middle = 0.5 * (low + high)
        ends = {"low_90": middle + 0.84 * (low - middle), "high_90": middle + 0.84 * (high - middle)}
        ends |= {"difference": np.nan_to_num(middle), "low": low, "high": high, "limit": 1.0}
        made.append({"quantity": name, "primary": True, "resolved": resolved, **ends})
    return pd.DataFrame(made)


@pytest.mark.parametrize(
    ("rows", "outcome"),
    [
        ({"a": (1.1, 1.9, True), "b": (-0.2, 0.3, False)}, DIFFERS),
        ({"a": (-1.9, -1.1, True), "b": (0.2, 0.3, True)}, DIFFERS),
        ({"a": (0.2, 0.9, True), "b": (-0.2, 0.3, False)}, DIFFERS_LITTLE),
        ({"a": (0.2, 1.1, True), "b": (0.1, 0.2, True)}, DIFFERS_PERHAPS),
        ({"a": (-0.9, 0.8, False), "b": (-0.2, 0.3, False)}, AGREES),
        ({"a": (-1.05, 0.9, False), "b": (-0.2, 0.3, False)}, AGREES),  # the 90 % interval decides
        ({"a": (-1.5, 0.9, False), "b": (-0.2, 0.3, False)}, CANNOT_TELL),
        ({"a": (1.1, 1.9, False), "b": (-0.2, 0.3, False)}, CANNOT_TELL),  # alone, and not resolved
        ({"a": (np.nan, np.nan, False), "b": (-0.2, 0.3, False)}, CANNOT_TELL),
    ],
)
def test_outcomes_are_decided_in_their_order(rows, outcome) -> None:  # type: ignore[no-untyped-def]
    assert decide_outcome(table(**rows)) == outcome


def test_a_branch_that_a_right_model_does_not_take_differs() -> None:
    assert decide_outcome(table(a=(-0.2, 0.3, False)), is_branch_resolved=True) == DIFFERS


def test_nothing_can_be_told_without_a_quantity() -> None:
    assert decide_outcome(table(a=(-0.2, 0.3, False)).iloc[:0]) == CANNOT_TELL
    assert undecided_verdict("nothing was drawn").sentence == "cannot tell: nothing was drawn."


def row(force: float, sensors: float, parameters: float, scatter: float, n: int = 4) -> SimpleNamespace:
    return SimpleNamespace(u_force=force, u_sensors=sensors, u_parameters=parameters, u_repeat=scatter, n_trials=n)


def test_what_would_halve_an_error_that_can_be_shown() -> None:
    assert describe_halving(row(2.0, 0.0, 0.0, 0.0)) == "the uncertainty of the force divided by 2 would halve it"
    assert describe_halving(row(0.0, 0.0, 0.0, 2.0)) == "16 trials instead of 4 would halve it"
    assert describe_halving(row(2.0, 0.0, 1.9, 0.0)).startswith("to halve it, both")


@pytest.mark.parametrize(
    ("quantity", "low", "high", "words"),
    [
        ("check_height", -4.0e-3, 4.2e-3, "4.2"),
        ("let_off_distance", -0.6e-3, 2.4e-3, "−0.6 or +2.4"),
        ("key_in_check", -0.01, 0.02, "−1.1 or +0.57"),  # the thesis counts a key's turn downwards
    ],
)
def test_an_error_that_would_be_shown_is_given_for_both_signs_where_they_differ(quantity, low, high, words) -> None:  # type: ignore[no-untyped-def]
    row = SimpleNamespace(quantity=quantity, detectable_low=low, detectable_high=high)
    assert detectable_words(row) == words


def test_a_quantity_of_which_only_a_huge_error_would_be_shown_is_not_tested() -> None:
    one = SimpleNamespace(primary=True, resolved=False, alone=False, limit=0.5e-3, low=-9e-3, high=9e-3)
    one.low_90, one.high_90 = -8e-3, 8e-3
    one.detectable_low, one.detectable_high = -4e-3, 4.9e-3
    assert reading_of(one) == "not resolved"
    one.detectable_high = 5.1e-3  # more than ten limits
    assert reading_of(one) == "not tested"
    one.resolved = True
    assert reading_of(one) == "differs, whether by enough to matter cannot be told"


def test_where_no_draw_takes_the_branch_of_the_trials_no_quantity_has_an_interval() -> None:
    v, draws, rng = len(QUANTITIES), 199, np.random.default_rng(1)
    sample = ErrorSample(
        found=np.zeros(v), n_trials=np.full(v, 3), residuals=1e-4 * rng.standard_normal((3, v)),
        common=1e-4 * rng.standard_normal((draws, v)), own=1e-4 * rng.standard_normal((20, v)),
        condition=np.zeros(v, dtype=int), branch=np.zeros((draws, 1), dtype=int), branch_found=np.array([1]),
        inputs=rng.standard_normal((draws, len(INPUTS))), floor=np.full(v, 1e-7), primary=IS_PRIMARY,
    )  # fmt: skip
    condition = Condition((1, 2, 3), 1, 15, {q.channel: 0.1 for q in QUANTITIES if q.channel}, np.ones(v), 1)
    errors = SessionErrors(sample, (condition,), {}, 0, np.zeros(1), np.zeros((draws, 1, 5), np.float32), [{}] * draws)
    verdict = judge_model(errors, relevance_limits({}))
    assert verdict.outcome == DIFFERS  # a branch that none of 199 draws takes
    assert verdict.quantities["low"].isna().all()
    seldom = replace(sample, branch=np.ones((draws, 1), dtype=int) * (np.arange(draws)[:, None] < 5))
    verdict = judge_model(replace(errors, sample=seldom), relevance_limits({}))
    assert verdict.outcome == CANNOT_TELL
    assert verdict.sentence.startswith("cannot tell: no quantity of the claim has an interval")


def test_falls_of_the_hammer_are_compared_only_where_neither_is_over_before_the_other_begins() -> None:
    values = np.full(len(QUANTITIES) - len(ANGLES), np.nan)
    values[[INDEX["drop"] - len(ANGLES), INDEX["landing"] - len(ANGLES)]] = 0.40, 0.46
    condition = Condition((1,), 1, 15, {}, values, 1)
    for drop, landing, is_another in ((0.01, -0.02, False), (0.05, 1.2, False), (1.2, 1.2, True), (-0.2, -0.07, True)):
        found = np.full(len(QUANTITIES), np.nan)
        found[[INDEX["drop"], INDEX["landing"]]] = drop, landing
        assert is_another_fall(condition, found) is is_another, (drop, landing)
    assert not is_another_fall(condition, np.full(len(QUANTITIES), np.nan))  # a model that never drops the hammer


@pytest.mark.parametrize(
    ("middle", "half", "words"),
    [
        (-4.13, 1.23, "−4.1 ± 1.2 mm"),
        (-0.02, 0.6, "0.0 ± 0.6 mm"),
        (12.4, 11.2, "+12 ± 11 mm"),
        (0.0123, 0.0456, "+0.01 ± 0.05 mm"),
        (4.0, 3.4, "+4 ± 3 mm"),
    ],
)
def test_an_interval_is_given_to_the_digits_of_its_half_width(middle: float, half: float, words: str) -> None:
    assert format_interval(middle, half, "mm") == words


def test_every_quantity_has_a_name_of_its_own() -> None:
    assert len(INDEX) == len(QUANTITIES)


def test_limits_of_relevance_have_defaults_and_refuse_what_is_none() -> None:
    assert relevance_limits({"check_height": 1e-3})["check_height"] == 1e-3
    assert relevance_limits({})["let_off"] == 0.5e-3
    with pytest.raises(ValidationInputError, match="'height' is no limit; allowed travel, check_height"):
        relevance_limits({"height": 1e-3})
    with pytest.raises(ValidationInputError, match="time is 0; a limit must be above 0"):
        relevance_limits({"time": 0.0})


def events(**times: float) -> dict[str, Event]:
    return {
        name: Event(name, times[name], 1e-4, "found") if name in times else make_absent_event(name) for name in EVENTS
    }


def test_phases_end_at_the_trial_s_own_events_and_go_on_where_one_is_missing() -> None:
    time, window = np.linspace(0, 1, 101), Window(0.1, 0.9, "test", "test")
    found = phase_masks(time, events(string_impact=0.3, key_release=0.6), window)
    counts = {name: int(mask.sum()) for name, mask in found.items()}
    assert counts == {"attack": 20, "check": 30, "release": 31}
    no_strike = phase_masks(time, events(key_release=0.6), window)
    assert {name: int(mask.sum()) for name, mask in no_strike.items()} == {"attack": 50, "check": 0, "release": 31}
    ends_held = phase_masks(time, events(string_impact=0.3), window)
    assert {name: int(mask.sum()) for name, mask in ends_held.items()} == {"attack": 20, "check": 61, "release": 0}
    early = phase_masks(time, events(string_impact=0.3, key_release=0.2), window)
    assert {name: int(mask.sum()) for name, mask in early.items()} == {"attack": 20, "check": 0, "release": 61}
    nothing = phase_masks(time, events(), window)
    assert {name: int(mask.sum()) for name, mask in nothing.items()} == {"attack": 81, "check": 0, "release": 0}


def test_let_off_is_the_way_to_where_the_string_turns_the_hammer() -> None:
    time = np.linspace(0, 0.2, 2001)
    height = np.abs(0.1 - time) * 0.5 + 1e-4
    motion: Any = SimpleNamespace(time_s=time, hammer_height_m=height)
    values = event_values(motion, events(let_off=0.098, string_impact=0.1))
    assert values[0] == pytest.approx(1e-3, rel=1e-3)
    nothing = event_values(motion, events())
    assert np.isnan(nothing).all()


def test_branches_are_told_in_words_and_by_usable_encoders_only() -> None:
    caught = branch_of(events(string_impact=0.1, check_height=0.01, key_bottom=0.09))
    assert branch_words(caught) == "the hammer strikes, it strikes once, it is caught, the key is down"
    assert branch_words(branch_of(events())) == "the hammer does not strike, the key does not come down"
    # a sensor of the hammer alone says nothing of the key
    assert branch_words(caught, branch_mask(["hammer"])) == "the hammer strikes, it strikes once, it is caught"
    assert branch_words(0, 0) == "no event is known"
    assert caught & branch_mask(["key", "whippen"]) == branch_of(events(key_bottom=0.09))


def test_a_back_check_wire_1_mm_off_differs(recorded, tmp_path, fewer_draws) -> None:  # type: ignore[no-untyped-def]
    session, truth = shutil.copytree(recorded[0].path, tmp_path / "forte"), recorded[1].action
    path = "contact04.second.x"
    wrong = truth.with_values({path: truth[path] + 1e-3})
    kept = {**OPTIONS, "keep_predictions": True}
    result = validation.compare(session, wrong, **kept)
    assert result.outcome == DIFFERS
    height = result.quantities.set_index("quantity").loc["check_height"]
    assert height.resolved
    assert height.high < -2e-3
    assert "check height −" in result.sentence
    assert result.verdict_lines[0].endswith(result.sentence)
    lenient = validation.compare(session, wrong, relevant={"check_height": 0.02, "travel": 0.5}, **kept)
    assert lenient.outcome == DIFFERS_LITTLE


def play(make, folder, specimens, late_s=0.0) -> Session:  # type: ignore[no-untyped-def]
    """A session of one forte a specimen, its encoders late by ``late_s``."""
    session = Session.create(folder, make.info())
    for number, specimen in enumerate(specimens, start=1):
        time, force, moved = make.play(specimen, 1.0 + 0.01 * (number % 3))
        late = np.vstack([np.zeros((round(late_s * make.rate_hz), 3)), moved])[: time.size]
        session.add_trial(make.trial(number, time, force, late))
    return session


OPTIONS: dict[str, Any] = {"keep_predictions": False, "rivals": (), "explain": False}


def test_trials_before_and_after_a_change_are_not_pooled(make, tmp_path, fewer_draws) -> None:  # type: ignore[no-untyped-def]
    printed, let_off = model.load_action(), "contact08.second.y"
    changed = printed.with_values({let_off: printed[let_off] + 0.9e-3})
    result = validation.compare(play(make, tmp_path / "s", 3 * [printed] + 3 * [changed]), printed, **OPTIONS)
    assert "from trial 4 on" in " ".join(result.findings.set_index("kind").loc[["changed condition"], "text"])
    rows = result.quantities.set_index(["quantity", "trials"])
    before, after = (rows.loc[("let_off_distance", f"trials {numbers}")] for numbers in ("1, 2, 3", "4, 5, 6"))
    assert before.low < 0.0 < before.high and not before.resolved
    assert after.resolved and before.n_trials == after.n_trials == 3
    assert "let-off of trials 4, 5, 6" in result.sentence
    assert "2 conditions, each estimated by itself: trials 1, 2, 3; trials 4, 5, 6" in result.sentence
    assert "Nothing is resolved in trials 1, 2, 3" in result.sentence


def test_sessions_delayed_by_a_little_more_or_less_get_the_same_outcome(make, tmp_path, fewer_draws) -> None:  # type: ignore[no-untyped-def]
    printed = model.load_action()
    delays = 0.8e-3, 1.2e-3
    sessions = [play(make, tmp_path / f"{late}", 3 * [printed], late) for late in delays]
    found = [validation.compare(session, printed, **OPTIONS) for session in sessions]
    assert len({result.outcome for result in found}) == 1
    impact = [result.quantities.set_index("quantity").loc["string_impact"] for result in found]
    assert [row.difference for row in impact] == pytest.approx([-late for late in delays], abs=2e-4)
    assert all(row.resolved for row in impact)


def test_a_session_that_ends_before_let_off_has_not_tested_it_and_says_so(make, tmp_path, fewer_draws) -> None:  # type: ignore[no-untyped-def]
    session, truth = make.session(tmp_path / "press", n_trials=2, filmed=(), strength=(0.05, 0.051))
    result = validation.compare(session, truth.action, **OPTIONS)
    rows = result.quantities.set_index("quantity")
    let_off, check = rows.loc["let_off_distance"], rows.loc["hammer_in_check"]
    assert np.isnan(let_off.difference) and let_off.state == "not in the trials"
    assert "Let-off is not tested: no trial reaches it." in result.verdict_lines[0]
    assert check.state == "not recorded" and np.isnan(check.low)
    assert result.quantities["primary"].sum() > 6


def test_a_session_that_reaches_let_off_has_tested_it(compared) -> None:  # type: ignore[no-untyped-def]
    rows = compared.quantities.set_index("quantity")
    known = rows.loc[["let_off_distance", "hammer_in_check"], ["difference", "low"]].to_numpy(dtype=float)
    assert np.isfinite(known).all()
    assert "Let-off is not tested" not in compared.verdict_lines[0]
