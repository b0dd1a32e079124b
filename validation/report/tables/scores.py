"""Tables of one result: scores beside their ceiling, differences, events and their budget, repeatability, trials."""

from __future__ import annotations

import math
from typing import Any

import pandas as pd

from validation.curves.signs import SIGN
from validation.events.definitions import EVENTS
from validation.report.tables.formatting import DASH, PageTable, between, degrees, number, percent, rms, with_u
from validation.result import ValidationResult
from validation.statistics.skill import CALLED, RIVALS

MOST_TRIALS = 10  # more columns than that nobody reads side by side


def score_matrix(result: ValidationResult) -> PageTable:
    """RMSE of every trial and channel, and of all trials together against range and repeatability."""
    trials = list(result.traces) if len(result.traces) <= MOST_TRIALS else []
    head = [
        "channel",
        *(f"trial {t}" for t in trials),
        "all",
        "of range",
        "sᵣ",
        "RMSE / sᵣ",
        "right model",
        "95 % below",
        "trial–trial",
    ]
    rows = []
    for c in result.channels.itertuples():
        scores = result.scores[result.scores["channel"] == c.channel].set_index("trial")["rmse_rad"]
        cells = [degrees(float(scores[t])) if t in scores.index else DASH for t in trials]
        state = f" ({c.state})" if c.state else ""
        rows.append(
            [
                f"{c.channel}{state}",
                *cells,
                degrees(c.rmse_rad),
                percent(c.rmse_over_range),
                degrees(c.s_r_rad),
                number(c.rmse_over_s_r, 2),
                degrees(c.rmse_right_rad),
                degrees(c.rmse_right_95_rad),
                degrees(c.trial_to_trial_rmse_rad),
            ]
        )
    notes = [
        "RMSE of model − trial in degrees inside the evaluation window; “all” is the root mean square over trials.",
        "sᵣ: repeatability standard deviation; right model: the RMSE of a model that is right within the declared "
        "uncertainties of force, sensors and parameters, its median and what 95 % of them stay below (at most five "
        "trials); trial–trial: the RMSE of one trial against another, which says how alike the blows were.",
    ]
    if not trials:
        notes.append(f"The RMSE of each of the {len(result.traces)} trials stands in tables/scores.csv.")
    return PageTable(
        "scores", "RMSE of every trial and channel (°)" if trials else "RMSE (°)", head, rows, notes, "scores"
    )


def rival_table(result: ValidationResult) -> PageTable:
    """RMSE of the model and its rivals by channel, over all trials, and the skill against the best of them."""
    rows = []
    pooled = result.rivals.merge(_pooled(result)[["trial", "channel"]], on=["trial", "channel"])
    skill = result.channels.set_index("channel")
    names = [name for name in RIVALS if pooled[f"{name}_rmse_rad"].notna().any()]
    for channel, part in pooled.groupby("channel", sort=False):
        own = skill.loc[channel]
        cells = [degrees(rms(part["rmse_rad"])), *(degrees(rms(part[f"{name}_rmse_rad"])) for name in names)]
        best = CALLED.get(own["best_rival"], DASH).removeprefix("the ")
        rows.append(
            [
                str(channel),
                *cells,
                best,
                number(own["skill"], 2),
                between(number(own["skill_low"], 2), number(own["skill_high"], 2)),
            ]
        )
    head = ["channel", "model", *(CALLED[name].removeprefix("the ") for name in names), "best rival", "skill", "95 %"]
    notes = [
        "RMSE in degrees, all trials. Skill: 1 − error over that of the best rival, strokes paired; below 0 the rival "
        "is nearer; an interval from four trials on. Polynomial and FIR filter are black boxes of the force: they know "
        "no other regulation, no inner forces and no touch."
    ]
    return PageTable("rivals", "The model beside its rivals (°)", head, rows, notes, "rivals")


def _pooled(result: ValidationResult) -> pd.DataFrame:
    """Scores that figures of several trials count."""
    return result.scores[result.scores["pooled"]]


def iso_table(result: ValidationResult) -> PageTable:
    """ISO 18571-style scores per channel: mean over trials, and what a perfect model would score."""
    rows = []
    ceiling = dict(zip(result.channels["channel"], result.channels["iso_ceiling"].astype(float), strict=True))
    for channel, part in _pooled(result).groupby("channel", sort=False):
        names = ("iso_overall", "iso_corridor", "iso_phase", "iso_magnitude", "iso_slope")
        means = [float(part[name].mean()) for name in names]
        shift = 1e3 * float(part["iso_shift_s"].abs().max())
        cells = [number(value, 3) if math.isfinite(value) else DASH for value in means]
        rows.append([str(channel), *cells, number(ceiling[str(channel)], 3), number(shift, 2)])
    head = ["channel", "overall", "corridor", "phase", "magnitude", "slope", "perfect model", "largest shift (ms)"]
    notes = [
        "From 0 to 1, mean over trials; perfect model: what it would score overall under the force as measured. "
        "The specification is made for forces and accelerations of vehicle safety; here it is a style of scoring. "
        "A curve with lost frames has no score."
    ]
    return PageTable("iso", "ISO/TS 18571-style scores", head, rows, notes, "scores")


def resolution_table(result: ValidationResult) -> PageTable:
    """Before the impact, bias, largest difference and stated uncertainty per channel."""
    rows = []
    shares = dict(zip(result.channels["channel"], result.channels["resolved_share"].astype(float), strict=True))
    for channel, part in _pooled(result).groupby("channel", sort=False):
        worst = part.loc[part["largest_rad"].idxmax()] if part["largest_rad"].notna().any() else None
        rows.append(
            [
                str(channel),
                degrees(rms(part["before_impact_rmse_rad"])),
                degrees(rms(part["rmse_rad"])),
                degrees(SIGN[str(channel)] * float(part["bias_rad"].mean())),
                degrees(float(worst["largest_rad"])) if worst is not None else DASH,
                f"{worst['largest_at_s']:.4f} (trial {int(worst['trial'])})" if worst is not None else DASH,
                percent(shares[str(channel)]),
                degrees(rms(part["u_rms_rad"])),
                str(int(part["n_lost"].sum())),
            ]
        )
    head = [
        "channel",
        "before impact",
        "whole window",
        "bias",
        "largest",
        "at (s)",
        "resolved",
        "u of one sample",
        "lost",
    ]
    notes = [
        "resolved: share of the window in which the mean paired difference leaves its simultaneous 95 % band "
        "(declared uncertainties of force, sensors and parameters; scatter of the trials where larger)."
    ]
    return PageTable("differences", "Differences model − trial by channel (°)", head, rows, notes, "channels")


def event_by_trial_table(result: ValidationResult) -> PageTable:
    """Every event of every trial and its prediction; of many trials, the first ones."""
    rows, notes = [], []
    order = {name: i for i, name in enumerate(EVENTS)}
    events = result.events
    if len(result.traces) > MOST_TRIALS:
        first = list(result.traces)[:MOST_TRIALS]
        events = events[events["trial"].isin(first)]
        notes.append(f"The first {MOST_TRIALS} of {len(result.traces)} trials; all are in the file below.")
    table = events.assign(order=events["event"].map(order)).sort_values(
        ["order", "trial", "source"], ascending=[True, True, False], kind="stable"
    )
    for e in table.itertuples():
        kind = EVENTS[e.event]
        k = kind.display_factor
        shown = with_u(k * e.value, k * e.u)
        rows.append([kind.label, str(e.trial), e.source, shown, e.status, e.note or ""])
    head = ["event", "trial", "source", "value ± u", "status", "note"]
    return PageTable("events-by-trial", "Every event of every trial", head, rows, notes, source="events")


def repeatability_tables(result: ValidationResult) -> list[PageTable]:
    """Repeatability of channels and of events."""
    channel_rows = [
        [
            f"{c.channel} ({c.source})",
            c.state or str(c.n_trials),
            degrees(c.s_r_rad),
            between(degrees(c.s_r_low_rad), degrees(c.s_r_high_rad)),
            degrees(c.s_r_largest_rad),
            degrees(c.limit_rad),
        ]
        for c in result.channels.itertuples()
    ]
    event_rows = []
    for e in result.event_repeatability.itertuples():
        kind = EVENTS[e.event]
        k = kind.display_factor
        event_rows.append(
            [
                kind.label,
                f"{e.n_found} found" + (f", {e.n_ambiguous} ambiguous" if e.n_ambiguous else ""),
                with_u(k * e.mean, k * e.s),
                between(number(k * e.s_low, 2), number(k * e.s_high, 2)),
                number(k * e.limit, 3),
                number(k * e.range, 3),
            ]
        )
    return [
        PageTable(
            "repeatability",
            "Repeatability of the angles over the window (°)",
            ["channel", "trials", "sᵣ pooled", "95 % interval of sᵣ", "largest sᵣ(t)", "limit"],
            channel_rows,
            source="channels",
        ),
        PageTable(
            "event-repeatability",
            "Repeatability of the events",
            ["event", "trials", "mean ± s", "95 % interval of s", "limit", "range"],
            event_rows,
            source="event_repeatability",
        ),
    ]


def trial_page_table(result: ValidationResult) -> PageTable:
    """What was done with each trial before it was compared."""
    rows = []
    for t in result.trials.itertuples():
        if not t.used:
            rows.append([str(t.trial), f"not used: {t.reason}", *[DASH] * 7])
            continue
        hum = f"{number(t.hum_1_n, 3)} at {t.hum_hz:.2f} Hz" if t.hum_accepted else "none subtracted"
        rows.append(
            [
                str(t.trial),
                "used"
                + (", filmed" if t.filmed else "")
                + (f", outside: {t.why_outside}" if t.outside is True else ""),
                number(t.peak_force_n, 4),
                number(1e3 * t.quiet_s, 3),
                with_u(t.offset_n, t.u_offset_n),
                hum,
                number(1e3 * t.noise_n, 3),
                number(1e3 * t.group_delay_s, 3),
                "kept" if t.reused else "simulated",
            ]
        )
    head = [
        "trial",
        "state",
        "peak (N)",
        "quiet (ms)",
        "offset (N)",
        "hum (N)",
        "noise (mN)",
        "delay (ms)",
        "prediction",
    ]
    return PageTable("trials", "Trials and the correction of their force", head, rows, source="trials")


LEAST_PART = 0.01  # of the whole: adds 5e-5 of it


def budget_table(result: ValidationResult) -> PageTable:
    """E, its uncertainties and what can be said, event by event."""
    rows = []
    for b in result.budget.itertuples():
        kind = EVENTS[str(b.event)]
        k = kind.display_factor
        parts = (b.u_num, b.u_force, b.u_parameters, b.u_assumed, b.u_d, b.u_repeat)
        rows.append(
            [
                kind.label,
                with_u(k * b.difference, k * b.u_val),
                number(b.ratio, 2),
                f"{number(k * b.low, 3)} to {number(k * b.high, 3)}" if b.resolved else "not resolved",
                *(_part(k * u, k * b.u_val) for u in parts),
                percent(b.assumed_share),
            ]
        )
    head = [
        "event",
        "model − trial ± u",
        "|E| / u",
        "error of the model",
        "u_num",
        "u force",
        "u parameters",
        "u assumed",
        "u_D",
        "u scatter",
        "assumed share",
    ]
    notes = [
        "After ASME V&V 20: u is the root of the sum of squares of its parts; an error of the model is resolved when "
        "|E| exceeds 2 u. “Not resolved” does not mean that the model is right. assumed share: part of the input "
        "uncertainty (force and parameters, squared) that rests on values this project had to assume. Parts below a "
        "hundredth of u stand as less than that; all digits are in tables/budget.csv."
    ]
    if len(result.budget):
        first = result.budget.iloc[0]
        notes.append(
            f"From {int(first['runs'])} runs of trial {int(first['trial'])} with changed inputs; "
            f"{int(first['failed'])} could not be run."
        )
    else:
        notes.append("No budget was asked for.")
    return PageTable("budget", "Uncertainty budget of the events", head, rows, notes, "budget")


def _part(u: float, whole: float) -> str:
    """One part of an uncertainty; one that is nothing beside the whole by its bound."""
    bound = LEAST_PART * whole
    return f"< {number(bound, 1)}" if u < bound else number(u, 2)


def area_table(result: ValidationResult) -> PageTable:
    """Area metric of every event beside the floor that few trials put under it."""
    rows = []
    for e in result.event_summary.itertuples():
        kind = EVENTS[str(e.event)]
        k = kind.display_factor
        if number(k * e.area) == DASH:
            continue
        rows.append(
            [
                kind.label,
                number(k * e.area, 3),
                number(k * e.area_floor, 3),
                number(k * e.area_floor_95, 3),
                "above" if e.area > e.area_floor_95 else "within",
            ]
        )
    head = ["event", "area", "floor (mean)", "floor (95 %)", "against the floor"]
    notes = [
        "Area between the distribution functions of predictions and trials; floor: what a model without any error, of "
        "force and parameters neither, would show with as few trials, by chance. “Above” shows no error of the model: "
        "the budget decides that."
    ]
    return PageTable("area", "Area metric of the events", head, rows, notes, "event_summary")


def scorecard_table(result: ValidationResult) -> PageTable:
    """Every score beside what a perfect model and the null model score."""
    rows = []
    for s in result.scorecard.itertuples():
        cells = [_cell(s.unit, value) for value in (s.value, s.ceiling, s.null, s.raw_force)]
        better = "smaller" if s.better == "lower" else "larger"
        unit = "°" if s.unit == "rad" else ""
        rows.append([f"{s.channel}: {s.title}{f' ({unit})' if unit else ''}", *cells, _between(s), s.reading, better])
    head = [
        "score",
        "model",
        "perfect model",
        "null model",
        "raw force",
        "range of perfect models",
        "reading",
        "better",
    ]
    notes = [
        "perfect model (the ceiling): median and range over draws of the errors of force and sensors, the prediction "
        "taken for the truth, scored at the same samples of the same trials (at most five); a score inside the range "
        "cannot be told from a perfect model’s. null model: the key's turn alone, all else balanced "
        "along it, no fit to trials; a model of many bodies should do better. raw force: the model driven by the "
        "force as recorded, without correction for offset, hum and delay."
    ]
    guards = [
        f"Trial {row.trial}, {row.channel}: {row.iso_guards}." for row in result.scores.itertuples() if row.iso_guards
    ]
    if guards:
        notes.append("Guards raised (the scores themselves are left as they are): " + " ".join(guards))
    return PageTable("scorecard", "Every score beside its ceiling and the null model", head, rows, notes, "scorecard")


def _between(s: Any) -> str:
    if not s.ceiling_draws:
        return DASH
    return between(_cell(s.unit, s.ceiling_low), _cell(s.unit, s.ceiling_high))


def _cell(unit: str, value: float) -> str:
    if not math.isfinite(value):
        return DASH
    return degrees(value) if unit == "rad" else number(value, 3)
