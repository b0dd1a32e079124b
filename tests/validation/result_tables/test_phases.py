"""Phases of a blow: bounded by the events of the trials, with the numbers of the one test."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from validation.conventions import ENCODER_CHANNELS
from validation.events.session_events import Window
from validation.result_tables.channels import BEGINS, PHASES, phase_intervals, phase_table
from validation.statistics.paired_difference import NOT_JUDGED, NOT_SHOWN, SHOWN, DifferenceDraws, Judgement, judge

WINDOW = Window(0.0, 1.0, "test", "test")
STARTS = {"string_impact": 0.1, "check_time": 0.2, "key_release": 0.5, "landing": 0.7}


def summary(found=5, **starts):
    rows = [
        {"event": name, "trial_mean": starts.get(name, value), "found_trial": found, "n_trials": 5}
        for name, value in STARTS.items()
    ]
    return pd.DataFrame(rows)


def channels(state=""):
    names = (*ENCODER_CHANNELS, "jack", "repetition")
    return pd.DataFrame({"channel": names, "state": state, "n_trials": [5, 5, 5, 0, 0]})


def judged(difference_of_time):
    """Judgement of a session in which the hammer alone is off by a known course over time."""
    rng = np.random.default_rng(3)
    time = np.linspace(0.0, 1.0, 101)
    found = np.full((5, time.size, 5), np.nan)
    found[..., :3] = 0.0
    found[..., 2] = difference_of_time(time)
    drawn = 0.01 * rng.standard_normal((59, 1, 1, 1)) * np.where(np.isfinite(found), 1.0, np.nan)
    return judge(DifferenceDraws(time, (1, 2, 3, 4, 5), found, drawn, np.full(5, 1e-9), 0))


def test_phases_begin_with_their_events_and_fill_the_window():
    found = phase_intervals(summary(), WINDOW)
    assert list(found) == list(PHASES)
    edges = [0.0, 0.1, 0.2, 0.5, 0.7, 1.0]
    assert list(found.values()) == list(zip(edges[:-1], edges[1:], strict=True))


@pytest.mark.parametrize("changes, without", [({"check_time": 0.6}, "release"), ({"landing": np.nan}, "landing")])
def test_a_phase_that_did_not_happen_or_not_in_order_leaves_its_time_to_the_one_before(changes, without):
    found = phase_intervals(summary(**changes), WINDOW)
    assert np.isnan(found[without]).all()
    known = [interval for interval in found.values() if np.isfinite(interval[0])]
    assert known[0][0] == 0.0 and known[-1][1] == 1.0
    assert all(a[1] == b[0] for a, b in zip(known, known[1:], strict=False))


def test_an_event_of_few_trials_begins_no_phase():
    assert [p for p, (start, _) in phase_intervals(summary(found=2), WINDOW).items() if np.isfinite(start)] == [
        "attack"
    ]


def test_the_largest_ratio_of_the_phases_is_the_channels_and_stands_where_the_error_is():
    judgement = judged(lambda t: np.where((t > 0.55) & (t < 0.65), 0.2, 0.001))
    table = phase_table(judgement, summary(), channels(), WINDOW)
    assert len(table) == 5 * len(PHASES)
    hammer = table[table["channel"] == "hammer"].set_index("phase")
    assert hammer["ratio"].idxmax() == "release"
    assert hammer.loc["release", "outcome"] == SHOWN
    assert set(hammer.drop("release")["outcome"]) == {NOT_SHOWN}
    assert hammer.loc["release", "difference_rad"] == pytest.approx(0.2)
    assert 0.55 < hammer.loc["release", "at_s"] < 0.65
    reached = judgement.channel("hammer", np.array([0.0]))[3]["largest_ratio"]
    assert hammer["ratio"].max() == reached  # one number for one quantity
    assert (table[table["channel"] == "key"]["ratio"] == 0).all()


def test_what_is_not_judged_is_empty_and_says_why():
    table = phase_table(Judgement(why="trials 4, 7 are faulty"), summary(), channels("not filmed"), WINDOW)
    assert table["ratio"].isna().all() and set(table["outcome"]) == {NOT_JUDGED}
    states = table.groupby("channel")["state"].first()
    assert states["hammer"] == "trials 4, 7 are faulty" and states["jack"] == "not filmed"
    assert set(BEGINS.values()) == set(STARTS)
