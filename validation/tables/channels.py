"""Table *channels*: repeatability of every channel, paired difference between model and trials, and their scores.

Conventions: SI and rad; differences are model − trial, paired by trial; samples left out of the scores are NaN. What
cannot be stated is NaN, and the column ``state`` says why. Two kinds of stroke have no mean and no band; their
repeatability is that within each kind.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np
import pandas as pd

from validation.conventions import CHANNEL_GROUPS, CONFIDENCE, Array, rms
from validation.findings.finding import LeftOut, describe_left_out, select_counted
from validation.numbers import DASH, between, degrees, number
from validation.prediction.joint_draws import CHANNELS
from validation.scores.curve_scores import compute_pair_rmse
from validation.scores.traces import SessionTraces
from validation.statistics.repeatability import curve_repeatability, interpolate_to_base
from validation.statistics.repeatability_band import FEWEST_FOR_BAND, repeatability_band
from validation.statistics.skill import CALLED
from validation.tables.comparison import Comparison
from validation.tables.table import CHANNEL, Column, Page, Row, Table
from validation.verdict.estimate import quantile_by_rank
from validation.verdict.verdict import Verdict, curve_errors, right_rmse, undecided_verdict


def _trials(row: Row) -> str:
    return f"{row['n_trials']}" + (f" ({row['state']})" if row["state"] else "")


def _interval(row: Row) -> str:
    return between(degrees(row["s_r_low_rad"]), degrees(row["s_r_high_rad"]))


def _skill(row: Row) -> str:
    ends = between(number(row["skill_low"], 2), number(row["skill_high"], 2))
    return number(row["skill"], 2) + ("" if ends == DASH else f" ({ends})")


COLUMNS = (
    CHANNEL,
    Column("source", "", "Sensor: encoder or film", str),
    Column("n_trials", "1", "Trials with this channel", int, head="trials", text=_trials),
    Column("rmse_rad", "rad", "Root mean square over trials of their RMSE", head="RMSE"),
    Column("range_rad", "rad", "Range of the angle, mean over trials", head="range"),
    Column("rmse_over_range", "1", "rmse_rad / range_rad", head="RMSE of range", shown=("%", 100.0), digits=2),
    Column("s_r_rad", "rad", "Repeatability standard deviation, pooled over the window", head="sᵣ"),
    Column("rmse_over_s_r", "1", "rmse_rad / s_r_rad"),
    Column("s_r_low_rad", "rad", "Lower end of the 95 % interval of s_r at one instant", head="95 % interval of sᵣ",
           text=_interval),
    Column("s_r_high_rad", "rad", "Upper end of it"),
    Column("s_r_largest_rad", "rad", "Largest s_r(t) in the window", head="largest sᵣ"),
    Column("limit_rad", "rad", "Repeatability limit: two trials differ by less in 95 % of cases (ISO 5725, with the "
           "factor for few trials)", head="limit"),
    Column("band_factor", "1", "Critical value of the simultaneous 95 % band of the mean"),
    Column("trial_to_trial_rmse_rad", "rad", "RMSE of one trial against another", head="trial to trial"),
    Column("pairs", "1", "Pairs of trials behind it", int, optional=True),
    Column("mean_difference_rad", "rad", "Root mean square of the mean paired difference model − trial (of the judged "
           "trials, at most five)"),
    Column("u_difference_rad", "rad", "Standard uncertainty of the mean paired difference, root mean square over the "
           "window"),
    Column("resolved_share", "1", "Share of the window in which the mean difference is larger than 1.96 u of that "
           "instant", head="beyond 95 %", shown=("%", 100.0), digits=2),
    Column("rmse_right_rad", "rad", "RMSE of a model that is right within the declared uncertainties, median over "
           "draws", head="expected"),
    Column("rmse_right_95_rad", "rad", "What 95 % of such models stay below", head="95 % below"),
    Column("state", "", "Why there is no repeatability (one trial, not filmed …); empty when there is", str),
    Column("null_rmse_rad", "rad", "RMSE of the null model"),
    Column("iso_overall", "1", "ISO-style overall score, mean over trials", head="ISO-style", digits=2),
    Column("iso_ceiling", "1", "The same of a perfect model, median over draws", head="of a perfect model", digits=2),
    Column("iso_null", "1", "The same of the null model"),
    Column("best_rival", "", "Rival with the least error: null, unfitted, polynomial, fir or fir_lags; empty where "
           "there is none", str, head="best rival",
           text=lambda row: CALLED.get(row["best_rival"], DASH).removeprefix("the ")),
    Column("skill", "ratio", "1 − error over that of the best rival, trials paired", head="skill", text=_skill),
    Column("skill_low", "ratio", "Lower end of its 95 % interval; null with fewer than four trials"),
    Column("skill_high", "ratio", "Upper end"),
)  # fmt: skip
NAMES = (
    "range_rad", "s_r_rad", "s_r_low_rad", "s_r_high_rad", "s_r_largest_rad", "limit_rad", "band_factor",
    "trial_to_trial_rmse_rad", "pairs", "mean_difference_rad", "u_difference_rad", "resolved_share", "rmse_right_rad",
    "rmse_right_95_rad",
)  # fmt: skip
NOT_MADE = undecided_verdict("the uncertainties were not drawn")


def rows(comparison: Comparison) -> pd.DataFrame:
    """Table with the columns `COLUMNS`, a row for each channel: repeatability, difference from the model, scores, and
    skill against the best rival."""
    skill = comparison.rivals.skill
    table = add_scores(
        summary(comparison)[0], comparison.scored.scores, comparison.table("scorecard"), comparison.without
    )
    found = [skill.get(str(channel)) for channel in table["channel"]]
    return table.assign(
        best_rival=[one.rival if one else "" for one in found],
        skill=[one.skill if one else np.nan for one in found],
        skill_low=[one.low if one else np.nan for one in found],
        skill_high=[one.high if one else np.nan for one in found],
    )


def summary(comparison: Comparison) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Table of the channels without scores, a row each, and table of mean, s_r, bands and difference of every channel
    over time, rad; made once and kept in ``comparison.made``."""
    c = comparison
    if "spread" not in c.made:
        u_sample = c.table("uncertainty").groupby("channel")["u_rad"].mean().to_dict()
        made = channel_tables(c.scored.traces, u_sample, c.without, c.verdict, c.findings.conditions)
        c.made["channel summary"], c.made["spread"] = made
    return c.made["channel summary"], c.made["spread"]


SPREAD = ("mean", "s_r", "band95", "difference", "difference_u95")


def channel_tables(
    traces: SessionTraces,
    u_sample: Mapping[str, float],
    without: LeftOut = (),
    verdict: Verdict = NOT_MADE,
    kinds: Sequence[Collection[int]] = (),
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Table of the channels without scores, a row each, and table of each one's mean, s_r, bands and difference over
    time, rad; ``u_sample``: by channel, rad, ``without``: pairs (trial, channel) not pooled, ``kinds``: trial numbers
    of each kind of stroke.

    ``u_sample`` is the standard uncertainty of one sample; ``verdict`` holds what the difference may be by chance;
    ``kinds`` is given where there are two or more.
    """
    base = traces.base_s
    rows: list[dict[str, object]] = []
    spread: dict[str, Array] = {"time_s": base}
    for names, source in CHANNEL_GROUPS:
        every = traces.select_source(source)
        for name in names:
            frames, state = select_counted(every, name, without), describe_left_out(every, name, without)
            if not frames:
                head = {"channel": name, "source": source, "n_trials": 0}
                rows.append({**head, **dict.fromkeys(NAMES, np.nan), "state": state or "not filmed"})
                if every:  # recorded, and wired wrong in all trials
                    spread |= {f"{name}_{part}_rad": np.full(base.shape, np.nan) for part in SPREAD}
                continue
            row, columns = _summarise_channel(name, base, frames, u_sample.get(name, 0.0), verdict, kinds)
            row["source"] = source
            row["state"] = "; ".join(text for text in (str(row["state"]), state) if text)
            rows.append(row)
            spread |= columns
    return pd.DataFrame(rows), pd.DataFrame(spread)


def _summarise_channel(
    name: str,
    base: Array,
    frames: dict[int, pd.DataFrame],
    u: float,
    verdict: Verdict,
    kinds: Sequence[Collection[int]],
) -> tuple[dict[str, object], dict[str, Array]]:
    """Row by column of one channel, and its curves (n,), rad, for the table over time; ``base``: times (n,), s,
    ``frames``: traces by trial number, ``u``: of a sample, rad, ``kinds``: trial numbers of each kind of stroke."""
    curves = interpolate_to_base(base, frames, f"{name}_measured_rad")
    apart = interpolate_to_base(base, frames, f"{name}_predicted_rad") - curves
    mean, u_mean, judged = _mean_difference(base, apart, verdict, name)
    label = [next((k for k, part in enumerate(kinds) if number in part), -1) for number in frames]
    mixed = len(set(label)) > 1
    r = curve_repeatability(curves, label)
    # curves of two kinds have no mean that a band could hold
    band = repeatability_band(np.full_like(curves, np.nan) if mixed else curves, u_sample=u)
    low, high = r.interval
    ceiling, pairs = compute_pair_rmse(curves, kinds=label)
    extent = [float(np.ptp(c[np.isfinite(c)])) if np.isfinite(c).any() else np.nan for c in curves.T]
    spread = {
        f"{name}_mean_rad": r.mean,
        f"{name}_s_r_rad": r.s_r,
        f"{name}_band95_rad": band.half_width,
        f"{name}_difference_rad": mean,
        f"{name}_difference_u95_rad": COVERAGE * u_mean,
    }
    row: dict[str, object] = {
        "channel": name,
        "source": "",
        "n_trials": r.n_trials,
        "range_rad": float(np.mean(extent)),
        "s_r_rad": r.pooled,
        "s_r_low_rad": low,
        "s_r_high_rad": high,
        "s_r_largest_rad": r.largest,
        "limit_rad": r.limit,
        "band_factor": band.factor,
        "trial_to_trial_rmse_rad": ceiling,
        "pairs": pairs,
        **judged,
        "state": "several kinds of stroke or conditions: compared within each, no band"
        if mixed
        else _explain_missing(curves),
    }
    return row, spread


COVERAGE = 1.96


def _mean_difference(base: Array, apart: Array, verdict: Verdict, name: str) -> tuple[Array, Array, dict[str, object]]:
    """Mean (n,), rad, over trials of ``apart``, model − trial (n, trials), at times ``base`` (n,), s, its standard
    uncertainty (n,), and cells of the channel ``name`` by column; NaN where not known, u wherever nothing was drawn."""
    known = np.isfinite(apart).any(axis=1)
    mean, u = np.full((2, base.size), np.nan)
    row: dict[str, object] = dict.fromkeys(NAMES[-5:], np.nan)
    if not known.any():
        return mean, u, row
    count = np.isfinite(apart).sum(axis=1)
    mean[known] = np.nanmean(apart[known], axis=1)
    row["mean_difference_rad"] = rms(mean[known])
    time, u_common = curve_errors(verdict, CHANNELS.index(name))
    drawn = np.isfinite(u_common)
    if not drawn.any():
        return mean, u, row
    several = known & (count > 1)
    scatter = np.zeros(base.size)
    scatter[several] = np.nanstd(apart[several], axis=1, ddof=1) / np.sqrt(count[several])
    u = np.where(known, np.hypot(np.interp(base, time[drawn], u_common[drawn]), scatter), np.nan)
    right = right_rmse(verdict, CHANNELS.index(name), base[[0, -1]])
    row |= {
        "u_difference_rad": rms(u),
        "resolved_share": float(np.mean(np.abs(mean[known]) > COVERAGE * u[known])),
        "rmse_right_rad": float(np.median(right)),
        "rmse_right_95_rad": quantile_by_rank(right, CONFIDENCE),
    }
    return mean, u, row


def _explain_missing(curves: Array) -> str:
    """Reason why ``curves`` (n_samples, n_trials) have no repeatability or band: no frame tracked, one trial, too few
    for a band; empty where they have both."""
    if not np.isfinite(curves).any():
        return "no frame tracked"
    n = curves.shape[1]
    if n == 1:
        return "one trial"
    return f"{n} trials: too few for a band, {FEWEST_FOR_BAND} needed" if n < FEWEST_FOR_BAND else ""


def add_scores(
    channels: pd.DataFrame, scores: pd.DataFrame, scorecard: pd.DataFrame, without: LeftOut = ()
) -> pd.DataFrame:
    """Copy of the table ``channels`` with RMSE, ISO-style score, those of null and perfect model, and RMSE over range
    and over s_r, from the tables ``scores`` and ``scorecard``; pairs (trial, channel) ``without`` do not count."""
    counts = [pair not in without for pair in zip(scores["trial"], scores["channel"], strict=True)]
    rms = scores[counts].groupby("channel")["rmse_rad"].agg(lambda v: float(np.sqrt(np.mean(np.square(v)))))
    overall = scorecard[scorecard["score"] == "iso_overall"].set_index("channel")
    rmse = scorecard[scorecard["score"] == "rmse_rad"].set_index("channel")
    out = channels.copy()
    out["rmse_rad"] = out["channel"].map(rms)
    out["null_rmse_rad"] = out["channel"].map(rmse["null"])
    out["iso_overall"] = out["channel"].map(overall["value"])
    out["iso_ceiling"] = out["channel"].map(overall["ceiling"])
    out["iso_null"] = out["channel"].map(overall["null"])
    out["rmse_over_range"] = out["rmse_rad"] / out["range_rad"]
    out["rmse_over_s_r"] = out["rmse_rad"] / out["s_r_rad"].where(out["s_r_rad"] > 0)
    return out


REPEATED = (
    "sᵣ: repeatability standard deviation over the window, its 95 % interval at one instant and its largest value; "
    "limit: two trials differ by less in 95 % of cases (ISO 5725); trial to trial: RMSE of one trial against another.",
)
SCORED = (
    "RMSE: over all trials. Expected: what a model without error reaches within the declared uncertainties of force, "
    "sensors and parameters, its median and what 95 % stay below. Beyond 95 %: share of the window in which the mean "
    "difference exceeds 1.96 standard uncertainties of that instant. Skill: 1 − error over that of the best rival "
    "(null model, values before a fit, black boxes of the force), below 0 the rival is nearer.",
)
TABLE = Table(
    "channels",
    "channel: repeatability and summary",
    COLUMNS,
    rows,
    (
        Page(
            "repeatability",
            "Repeatability of the angles",
            REPEATED,
            (
                "channel", "n_trials", "range_rad", "s_r_rad", "s_r_low_rad", "s_r_largest_rad", "limit_rad",
                "trial_to_trial_rmse_rad",
            ),
        ),
        Page(
            "scores",
            "Scores of every channel",
            SCORED,
            (
                "channel", "rmse_rad", "rmse_over_range", "rmse_right_rad", "rmse_right_95_rad", "resolved_share",
                "iso_overall", "iso_ceiling", "best_rival", "skill",
            ),
        ),
    ),
)  # fmt: skip
