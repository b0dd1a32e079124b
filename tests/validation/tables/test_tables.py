"""Tables and verdict of a comparison: closed forms, pairing, presence before timing, different rates."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from validation.cache.result_store import ResultStore
from validation.conventions import ENCODER_CHANNELS
from validation.errors import InputError
from validation.events.definitions import EVENTS, Event
from validation.events.detect import make_absent_event
from validation.events.session_events import Window, choose_window
from validation.findings.finding import select_counted_events
from validation.pipeline.verdict import verdict_lines
from validation.scores.score_session import score_curves
from validation.scores.traces import SessionTraces
from validation.statistics.repeatability import interpolate_to_base
from validation.tables.channels import add_scores, channel_tables
from validation.tables.event_summary import TABLE as SUMMARY
from validation.tables.event_summary import event_summary as summarised
from validation.tables.events import event_rows
from validation.tables.scorecard import scorecard
from validation.tables.scores import add_repeatability
from validation.tables.table import make_page_table
from validation.verdict.verdict import undecided_verdict

WINDOW = Window(0.0, 1.0, "test", "test")


def frames(time, scatter, model_offset=0.01, rate_of_last=None):
    """Five trials of three channels of distinct sizes; the model is off by a known share of the size."""
    rng = np.random.default_rng(9)
    out = {}
    for number in range(1, 6):
        t = time if number < 5 or rate_of_last is None else np.arange(0, 1.0, 1 / rate_of_last)
        frame = {"time_s": t}
        for size, name in ((1.0, "key"), (2.0, "whippen"), (3.0, "hammer")):
            shape = size * np.sin(2 * np.pi * t) * (1 + scatter * rng.normal())
            frame[f"{name}_measured_rad"] = shape
            frame[f"{name}_predicted_rad"] = shape + size * model_offset
        out[number] = pd.DataFrame(frame)
    return out


def tables(traces, u=1e-4):
    session = SessionTraces(traces, {}, WINDOW, {1: 0.25})
    channels, spread = channel_tables(session, {"key": u, "whippen": u, "hammer": u})
    u_encoder, compared = {n: np.full(3, u) for n in traces}, dict.fromkeys(traces, ENCODER_CHANNELS)
    scores = add_repeatability(score_curves(session, u_encoder, compared, ResultStore()), channels)
    card = pd.DataFrame(scorecard(scores, session))
    return add_scores(channels, scores, card).set_index("channel"), scores, spread


def test_channel_table_of_a_known_difference():
    channels, scores, spread = tables(frames(np.arange(0, 1, 2e-4), scatter=0.05))
    for size, name in ((1.0, "key"), (2.0, "whippen"), (3.0, "hammer")):
        row = channels.loc[name]
        assert row["rmse_rad"] == pytest.approx(0.01 * size)
        assert row["mean_difference_rad"] == pytest.approx(0.01 * size)
        assert row["trial_to_trial_rmse_rad"] == pytest.approx(np.sqrt(2) * row["s_r_rad"], rel=1e-9)
        assert row["rmse_over_s_r"] == pytest.approx(row["rmse_rad"] / row["s_r_rad"])
        assert np.isnan(row["resolved_share"])  # nothing was drawn
        assert row["pairs"] == 10
    assert set(channels.loc[["jack", "repetition"], "state"]) == {"not filmed"}
    assert channels.loc["jack"].isna()["rmse_rad"]
    assert scores.loc[0, "before_impact_rmse_rad"] == pytest.approx(0.01)
    assert spread["key_difference_rad"].to_numpy() == pytest.approx(0.01)


def test_two_kinds_of_stroke_are_compared_within_each_and_have_no_mean():
    traces = frames(np.arange(0, 1, 2e-4), scatter=0.0)
    strong = {n: f.assign(**{c: 3 * f[c] for c in f if c != "time_s"}) for n, f in traces.items() if n > 3}
    session = SessionTraces(traces | strong, {}, WINDOW, {1: 0.25})
    apart, spread = channel_tables(session, {"key": 1e-4}, kinds=[(1, 2, 3), (4, 5)])
    row = apart.set_index("channel").loc["hammer"]
    assert row["s_r_rad"] == pytest.approx(0.0, abs=1e-12)
    assert (row["trial_to_trial_rmse_rad"], row["pairs"]) == (pytest.approx(0.0, abs=1e-12), 4)
    assert row["state"] == "several kinds of stroke or conditions: compared within each, no band"
    assert np.isnan(row["band_factor"]) and spread["hammer_mean_rad"].isna().all()
    together = channel_tables(session, {"key": 1e-4})[0].set_index("channel").loc["hammer"]
    assert together["s_r_rad"] > 1.0


def test_trials_of_another_rate_are_put_on_the_first_one_s_base():
    time = np.arange(0, 1, 2e-4)
    traces = frames(time, scatter=0.0, rate_of_last=2000.0)
    curves = interpolate_to_base(time[:-10], traces, "hammer_measured_rad")
    assert np.abs(curves[:, 4] - curves[:, 0]).max() < 3 * (2 * np.pi) ** 2 * 5e-4**2 / 8 * 1.01
    channels, scores, _ = tables(traces)
    assert channels.loc["hammer", "n_trials"] == 5
    assert scores["n"].nunique() == 2


def test_a_trial_that_does_not_reach_the_window_is_nan_there():
    traces = {1: pd.DataFrame({"time_s": [0.0, 1.0], "x": [0.0, 1.0]})}
    out = interpolate_to_base(np.array([-0.5, 0.25, 1.5]), traces, "x")
    assert out[1, 0] == 0.25
    assert np.isnan(out[[0, 2], 0]).all()


NOT_DRAWN = undecided_verdict("the uncertainties were not drawn")


def lines_of(channels, summary, n, verdict=NOT_DRAWN, nearer=""):
    used = pd.DataFrame({"trial": range(1, n + 1), "used": True})
    return verdict_lines(
        "s", "m", {"trials": used, "channels": channels, "event_summary": summary}, verdict, (), nearer
    )


def test_draws_give_the_difference_its_uncertainty_at_each_instant():
    traces = frames(np.arange(0, 1, 2e-4), scatter=0.0)
    session = SessionTraces(traces, {}, WINDOW, {1: 0.25})
    rng = np.random.default_rng(14)
    time = np.arange(0, 1, 1e-2)
    curves = np.full((199, time.size, 5), np.nan)
    curves[..., :3] = 0.01 * np.array([1.0, 2.0, 3.0]) * rng.standard_normal((199, 1, 1))
    far = np.zeros((199, 1), dtype=int)
    far[:20] = 1
    curves[:20] *= 1000.0  # on another branch: no part of u
    sample = SimpleNamespace(branch=far, branch_found=np.zeros(1, dtype=int))
    errors = SimpleNamespace(sample=sample, time_s=time, curves=curves)
    channels, spread = channel_tables(session, {}, (), replace(NOT_DRAWN, errors=errors))
    row = channels.set_index("channel").loc["hammer"]
    assert row["u_difference_rad"] == pytest.approx(0.03, rel=0.2)
    assert row["mean_difference_rad"] == pytest.approx(0.03)
    assert row["resolved_share"] == 0.0
    assert row["rmse_right_rad"] == pytest.approx(0.03 * 0.6745, rel=0.2)  # median and 95 % of 0.03 |z|
    assert row["rmse_right_95_rad"] == pytest.approx(0.03 * 1.96, rel=0.2)
    assert row["rmse_right_95_rad"] < 0.1
    assert spread["hammer_difference_u95_rad"].to_numpy() == pytest.approx(1.96 * row["u_difference_rad"])


def test_the_headline_is_the_sentence_of_the_verdict():
    channels, _, _ = tables(frames(np.arange(0, 1, 2e-4), scatter=0.05))
    summary = event_summary({1: keystroke()}, {1: keystroke()})
    head = lines_of(channels.reset_index(), summary, 5, nearer="Nearer than the model: in hammer the null model.")[0]
    assert "against 5 trials of s" in head and head.endswith("Nearer than the model: in hammer the null model.")
    assert "cannot tell: the uncertainties were not drawn." in head


def event_summary(trial, model):
    return pd.DataFrame(summarised(trial, model))


def keystroke(**changes):
    found = {name: Event(name, 0.1 * (i + 1), 0.001, "found") for i, name in enumerate(EVENTS)}
    found["second_strike"] = make_absent_event("second_strike")
    return found | {name: event for name, event in changes.items()}


def test_a_spurious_second_strike_of_the_model_fails_before_any_timing():
    trials = {1: keystroke(), 2: keystroke()}
    models = {1: keystroke(), 2: keystroke(second_strike=Event("second_strike", 0.9, 0.001, "found"))}
    summary = event_summary(trials, models).set_index("event")
    assert not summary.loc["second_strike", "agree"]
    assert (summary.loc["second_strike", ["found_trial", "found_model"]] == [0, 1]).all()
    assert np.isnan(summary.loc["second_strike", "difference"])
    channels, _, _ = tables(frames(np.arange(0, 1, 2e-4), 0.05))
    lines = lines_of(channels.reset_index(), summary.reset_index(), 2)
    assert "1 kind of event happen in one but not in the other" in lines[0]
    assert "second strike (trials 0, model 1 of 2)" in " ".join(lines)


def test_event_differences_are_paired_and_their_uncertainty_holds_scatter_and_statement():
    def speed(value):
        return keystroke(hammer_speed=Event("hammer_speed", value, 0.03, "found"))

    trials = {1: speed(2.0), 2: speed(3.0), 3: speed(4.0)}
    models = {1: speed(2.1), 2: speed(3.2), 3: speed(4.3)}
    row = event_summary(trials, models).set_index("event").loc["hammer_speed"]
    assert row["difference"] == pytest.approx(0.2)
    assert row["difference_s"] == pytest.approx(0.1)
    assert row["trial_s"] == pytest.approx(1.0)
    assert row["u_difference"] == pytest.approx(np.hypot(0.03 * np.sqrt(2), 0.1 / np.sqrt(3)))
    assert len(list(event_rows(trials, models))) == 2 * 3 * len(EVENTS)


def test_absent_and_ambiguous_events_are_in_the_verdict():
    doubtful = Event("rest", 0.9, 0.02, "ambiguous", "…")
    no_check = {"check_time": make_absent_event("check_time"), "check_height": make_absent_event("check_height")}
    trials = {1: keystroke(rest=doubtful, **no_check)}
    models = {1: keystroke(**no_check)}
    channels, _, _ = tables(frames(np.arange(0, 1, 2e-4), 0.05))
    text = " ".join(lines_of(channels.reset_index(), event_summary(trials, models), 1))
    assert "Neither in the records nor in the model: check begins, check height." in text
    assert "Ambiguous: rest." in text
    assert "second strike" not in text.split("Neither in")[1]


def test_events_that_no_trial_counts_are_neither_absent_nor_in_agreement():
    trials = {n: keystroke() for n in (1, 2, 3)}
    counting = select_counted_events(trials, {(n, "hammer") for n in trials} | {(1, "key")})
    summary = event_summary(counting, trials)
    channels, _, _ = tables(frames(np.arange(0, 1, 2e-4), 0.05))
    text = " ".join(lines_of(channels.reset_index(), summary, 3))
    assert "Not counted (left out in all trials): let-off, " in text and "Neither in the records" not in text
    (page,) = SUMMARY.pages
    shown = {
        row[0]: row for row in make_page_table(SUMMARY, page, [("m", row) for row in summary.to_dict("records")]).rows
    }
    assert shown[EVENTS["let_off"].label][1] == "not counted (left out in all trials)"
    assert shown[EVENTS["key_bottom"].label][1] == "2 of 2"


def measured(number, onset, start=0.0, end=1.2):
    return SimpleNamespace(
        number=number,
        has_force=True,
        time_s=np.array([start, end]),
        force=SimpleNamespace(time_s=np.array([start - 0.002, end - 0.002])),
        quiet=SimpleNamespace(onset_s=onset),
    )


def test_the_window_is_one_for_all_trials_and_says_its_rule():
    trials = [measured(1, 0.40), measured(2, 0.38)]
    events = {1: keystroke(rest=Event("rest", 0.9, 0.0, "found")), 2: keystroke(rest=Event("rest", 1.0, 0.0, "found"))}
    window = choose_window(trials, events)
    assert (window.start_s, window.end_s) == pytest.approx((0.36, 1.05))
    assert "last trial came to rest" in window.end_rule
    np.testing.assert_array_equal(window.mask(np.array([0.35, 0.36, 1.05, 1.06])), [False, True, True, False])
    events[2]["rest"] = make_absent_event("rest")
    assert choose_window(trials, events).end_s == pytest.approx(1.198)
    assert "does not come to rest" in choose_window(trials, events).end_rule


def test_trials_that_do_not_overlap_are_refused():
    trials = [measured(1, 0.4, end=1.0), measured(2, 2.4, start=2.0, end=3.0)]
    with pytest.raises(InputError, match="do not overlap"):
        choose_window(trials, {1: keystroke(), 2: keystroke()})
