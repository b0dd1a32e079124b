"""Models paired by trial: closed forms, the floor that few trials put under p, and no claim beyond it."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from validation.events.session_events import Window
from validation.statistics.model_comparison import compare_pairs, evidence_table
from validation.statistics.sign_flip_test import joint_sign_flip, sign_flip_p


def result(name, rmse_rad, *, session="forte", window=(0.0, 1.0), n=1000, tolerance_rad=1e-5, common=0.0):
    """What the comparison of models needs of a result; ``rmse_rad``: channel → one value per trial.

    ``common``: what one standard uncertainty of the errors common to all trials makes of a score.
    """
    rows = [
        {
            "trial": trial,
            "channel": channel,
            "rmse_rad": value,
            "before_impact_rmse_rad": np.nan,
            "iso_overall": 1 - 10 * value,
            "n": n,
        }
        for channel, values in rmse_rad.items()
        for trial, value in enumerate(values, start=1)
    ]
    drawn = [
        {**{k: row[k] for k in ("trial", "channel")}, "draw": draw}
        | {k: row[k] + z * common for k in ("rmse_rad", "before_impact_rmse_rad", "iso_overall")}
        for row in rows
        for draw, z in enumerate(np.linspace(-2, 2, 19))
    ]
    return SimpleNamespace(
        nuisance=pd.DataFrame(drawn),
        session_name=session,
        action_name=name,
        scores=pd.DataFrame(rows),
        window=Window(*window, "test", "test"),
        traces={1: pd.DataFrame({"time_s": np.arange(5) * 2e-4})},
        provenance={"tolerance_rad": tolerance_rad},
    )


def claims(first, second):
    pairs = compare_pairs([first, second])
    return pairs[pairs["score"] == "rmse_rad"].set_index("channel")


FIVE = np.array([0.010, 0.012, 0.011, 0.013, 0.009])
GAIN = np.array([0.003, 0.004, 0.0035, 0.0045, 0.003])


def test_five_trials_may_not_claim_what_they_cannot_show():
    row = claims(result("a", {"hammer": FIVE}), result("b", {"hammer": FIVE - GAIN})).loc["hammer"]
    assert row["difference"] == pytest.approx(-GAIN.mean())
    assert row["u_difference"] == pytest.approx(GAIN.std(ddof=1) / np.sqrt(5))
    low, high = stats.t.interval(0.95, 4, loc=-GAIN.mean(), scale=stats.sem(GAIN))
    assert (row["low"], row["high"]) == pytest.approx((low, high))
    assert (row["first_closer"], row["second_closer"], row["n_trials"]) == (0, 5, 5)
    assert row["p"] == row["p_least"] == 0.0625
    assert row["claim"] == "b closer on average; 5 trials cannot show it at 5 % (smallest p 0.0625)"


def test_eight_trials_may_and_a_higher_score_is_the_better_one():
    first, gain = np.linspace(0.01, 0.02, 8), np.linspace(0.003, 0.004, 8)
    pairs = compare_pairs([result("a", {"key": first}), result("b", {"key": first - gain})]).set_index("score")
    assert pairs.loc["rmse_rad", "claim"] == "b closer (5 %, all channels together)"
    assert pairs.loc["rmse_rad", "p"] == 2 / 2**8
    iso = pairs.loc["iso_overall"]
    assert iso["difference"] > 0
    assert iso["second_closer"] == 8
    assert iso["claim"] == "b closer (5 %, all channels together)"
    assert "before_impact_rmse_rad" not in pairs.index  # nothing known of it


def test_proportional_channels_cost_no_evidence():
    """Six trials reach 1/32, in three channels as in one: their signs flip together."""
    rng = np.random.default_rng(3)
    first = {c: 0.01 + 0.001 * rng.random(6) for c in ("key", "whippen", "hammer")}
    second = {c: v - 0.002 for c, v in first.items()}
    second = {c: v + 1e-4 * rng.random(6) for c, v in second.items()}
    rows = claims(result("a", first), result("b", second))
    assert rows["p"].tolist() == rows["p_joint"].tolist() == [1 / 32] * 3
    assert set(rows["claim"]) == {"b closer (5 %, all channels together)"}
    # a channel of one trial is no test and costs nothing
    one = claims(result("a", {**first, "jack": [0.1]}), result("b", {**second, "jack": [0.2]}))
    assert one.loc["key", "p_joint"] == pytest.approx(1 / 32)
    assert one.loc["jack", "claim"] == "no claim: one trial"
    assert np.isnan(one.loc["jack", "u_difference"])


def test_what_errors_common_to_all_trials_explain_is_no_claim():
    first, gain = np.linspace(0.01, 0.02, 8), np.linspace(0.003, 0.004, 8)
    a = result("a", {"key": first})
    sure = claims(a, result("b", {"key": first - gain}, common=5e-4)).loc["key"]
    unsure = claims(a, result("b", {"key": first - gain}, common=2e-3)).loc["key"]
    assert sure["claim"] == "b closer (5 %, all channels together)"
    assert unsure["claim"] == "no claim: the 95 % interval holds zero" and unsure["p_joint"] < 0.05
    assert unsure["u_nuisance"] == pytest.approx(2e-3 * np.sqrt(np.mean(np.linspace(-2, 2, 19) ** 2)))
    b = result("b", {"key": first - gain})
    b.nuisance = b.nuisance.iloc[:0]
    assert "was not drawn" in claims(a, b).loc["key", "claim"]


def test_claims_of_different_models_before_impact_and_over_the_window_are_a_contradiction():
    first, gain = np.linspace(0.01, 0.02, 8), np.linspace(0.003, 0.004, 8)
    a, b = result("a", {"key": first}), result("b", {"key": first - gain})
    for r, early in ((a, first), (b, first + gain)):
        r.scores["before_impact_rmse_rad"] = early
        r.nuisance["before_impact_rmse_rad"] = np.repeat(early, 19)
    pairs = compare_pairs([a, b]).set_index("score")["claim"]
    said = "contradiction: over the whole window b is closer, before the impact a (5 % each); neither model is closer"
    assert pairs["rmse_rad"].startswith(said) and pairs["before_impact_rmse_rad"].startswith(said)
    assert pairs["iso_overall"] == "b closer (5 %, all channels together)"


def test_no_claim_where_there_is_nothing_to_claim():
    a = result("a", {"key": FIVE})
    assert claims(a, result("b", {"key": FIVE})).loc["key", "claim"] == "no difference"
    tiny = claims(a, result("b", {"key": FIVE + 1.5e-5})).loc["key", "claim"]
    assert tiny == "no claim: within the tolerance of the predictions"
    mixed = FIVE + GAIN * [1, -1, 1, -1, 1]
    assert claims(a, result("b", {"key": mixed})).loc["key", "claim"] == "no claim: the 95 % interval holds zero"
    moved = claims(a, result("b", {"key": FIVE - GAIN}, window=(0.0, 1.1)))
    assert moved.loc["key", "claim"].startswith("no claim: scored in different windows (0.0000 to 1.0000 s, 0.0000")
    fewer = claims(a, result("b", {"key": FIVE - GAIN}, n=900))
    assert fewer.loc["key", "claim"] == "no claim: different samples are left out"


def test_only_trials_of_both_and_only_models_of_one_session_are_paired():
    a, b = result("a", {"key": FIVE}), result("b", {"key": FIVE[:3] - GAIN[:3]})
    assert claims(a, b).loc["key", "n_trials"] == 3
    c = result("a", {"key": FIVE}, session="piano")
    assert compare_pairs([a, c]).empty
    assert (
        list(zip(*(compare_pairs([a, b, c])[k] for k in ("session", "first", "second")), strict=True))
        == [("forte", "a", "b")] * 2
    )


def test_sign_flip_p_is_exact_and_holds_its_level():
    d = np.array([1.0, 2.0, -0.5, 3.0])
    sums = [np.dot(d, [1 - 2 * (k >> i & 1) for i in range(4)]) for k in range(16)]
    assert sign_flip_p(d) == np.mean(np.abs(sums) >= abs(d.sum()) - 1e-12)
    assert sign_flip_p(d) == sign_flip_p(-d)
    assert sign_flip_p(np.zeros(5)) == sign_flip_p(np.array([3.0])) == 1.0
    rng = np.random.default_rng(11)
    rejected = [sign_flip_p(row) <= 0.05 for row in rng.normal(size=(1500, 7))]
    assert np.mean(rejected) <= 0.05 + 4 * np.sqrt(0.05 * 0.95 / 1500)
    assert sign_flip_p(np.arange(1.0, 15.0)) == 2 / 2**14  # 14 trials: still all arrangements, none drawn
    many = np.abs(rng.normal(size=40)) + 0.1
    assert sign_flip_p(many) == pytest.approx(1 / 20001)


def test_joint_sign_flip_holds_its_level_under_correlated_channels_and_loses_nothing():
    rng = np.random.default_rng(12)
    rejected, alone = 0, 0
    for _ in range(1500):
        one = rng.normal(size=(7, 1))
        d = one * [1.0, 2.0, 9.0] + 0.3 * rng.normal(size=(7, 3))
        rejected += joint_sign_flip(d).min() <= 0.05
        alone += sign_flip_p(d[:, 0]) <= 0.05
    assert rejected / 1500 <= 0.05 + 4 * np.sqrt(0.05 * 0.95 / 1500)
    assert rejected > 0.4 * alone
    assert joint_sign_flip(np.zeros((5, 2))).tolist() == joint_sign_flip(np.ones((1, 2))).tolist() == [1.0, 1.0]
    d = rng.normal(1.0, 1.0, size=(6, 1))
    assert joint_sign_flip(d) == pytest.approx(sign_flip_p(d[:, 0]))


def test_the_evidence_is_against_the_first_model_and_no_surer_than_its_uncertainty():
    def judged(name, log_evidence, *, u=0.5, rejected=False, trials=(1, 2), rhs=1000.0):
        one = result(name, {"hammer": FIVE})
        facts = {"judged": True, "trials": list(trials), "rejected": rejected, "p": 0.5}
        one.judgement = facts | {"log_evidence": log_evidence, "u_log_evidence": u}
        one.provenance["cost"] = {"right_hand_sides": rhs, "seconds": 0.01}
        return one

    bar = judged("bar", 50.0)
    others = [
        judged("string", 54.0, rhs=1500.0),  # 4 less 2 u, 2.6
        judged("joints", 40.0),
        judged("unsure", 54.0, u=3.0),
        judged("elsewhere", 54.0, trials=(1, 3)),
    ]
    table = evidence_table([[bar, *others], [bar]]).set_index("model")
    assert len(table) == 5 and table.loc["string", "log_bayes_factor"] == 4.0
    assert table.loc["string", "cost_ratio"] == 1.5
    assert list(table["reading"]) == [
        "the one compared with",
        "positive for it",
        "very strong against it",
        "not worth more than a bare mention",
        "no claim: judged on different trials",
    ]
    both = evidence_table([[judged("a", 1.0, rejected=True), judged("b", 9.0, rejected=True)]])
    assert both["reading"][1] == "very strong for it; both are rejected, so this only says which is less far off"
    bar.judgement = {"judged": False, "reason": "the uncertainty budget was not made"}
    assert evidence_table([[bar, others[0]]])["reading"][1] == "no claim: the uncertainty budget was not made"
