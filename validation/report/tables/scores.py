"""Tables of one result: scores beside their ceiling, differences, the verdict, events, repeatability, trials."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import pandas as pd

from validation.curves.display_signs import SIGN
from validation.events.definitions import EVENTS
from validation.measurement.trial import trials_in_words
from validation.report.tables.formatting import DASH, PageTable, between, cells, degrees, number, percent, rms, with_u
from validation.result import ValidationResult
from validation.statistics.skill import CALLED, RIVALS
from validation.verdict.quantities import QUANTITIES
from validation.verdict.verdict import detectable_words, format_interval, reading_of, shown_interval

QUANTITY = {q.name: q for q in QUANTITIES}
MOST_TRIALS = 10  # more columns than that nobody reads side by side


def score_matrix(result: ValidationResult) -> PageTable:
    """RMSE of every trial and channel, and of all trials together against range and repeatability."""
    trials = list(result.traces) if len(result.traces) <= MOST_TRIALS else []
    each = result.scores.set_index(["channel", "trial"])["rmse_rad"]

    def one(trial: Any, c: Any) -> str:
        return degrees(float(each.get((c.channel, trial), math.nan)))

    shown = cells(
        result.channels.itertuples(),
        {
            "channel": lambda c: f"{c.channel} ({c.state})" if c.state else c.channel,
            **{f"trial {t}": partial(one, t) for t in trials},
            "all": lambda c: degrees(c.rmse_rad),
            "of range": lambda c: percent(c.rmse_over_range),
            "sᵣ": lambda c: degrees(c.s_r_rad),
            "RMSE / sᵣ": lambda c: number(c.rmse_over_s_r, 2),
            "right model": lambda c: degrees(c.rmse_right_rad),
            "95 % below": lambda c: degrees(c.rmse_right_95_rad),
            "trial–trial": lambda c: degrees(c.trial_to_trial_rmse_rad),
        },
    )
    notes = [
        "RMSE of model − trial in degrees inside the evaluation window; “all” is the root mean square over trials.",
        "sᵣ: repeatability standard deviation; right model: the RMSE of a model that is right within the declared "
        "uncertainties of force, sensors and parameters, its median and what 95 % of them stay below (at most five "
        "trials); trial–trial: the RMSE of one trial against another, which says how alike the blows were.",
    ]
    if not trials:
        notes.append(f"The RMSE of each of the {len(result.traces)} trials stands in tables/scores.csv.")
    return PageTable("scores", "RMSE of every trial and channel (°)" if trials else "RMSE (°)", *shown, notes, "scores")


def rival_table(result: ValidationResult) -> PageTable:
    """RMSE of the model and its rivals by channel, over all trials, and the skill against the best of them."""
    pooled = result.rivals.merge(_pooled(result)[["trial", "channel"]], on=["trial", "channel"])
    skill = result.channels.set_index("channel")
    names = [name for name in RIVALS if pooled[f"{name}_rmse_rad"].notna().any()]

    def rival(name: str, of: Any) -> str:
        return degrees(rms(of[0][f"{name}_rmse_rad"]))

    shown = cells(
        ((part, skill.loc[channel]) for channel, part in pooled.groupby("channel", sort=False)),
        {
            "channel": lambda of: str(of[1].name),
            "model": lambda of: degrees(rms(of[0]["rmse_rad"])),
            **{CALLED[name].removeprefix("the "): partial(rival, name) for name in names},
            "best rival": lambda of: CALLED.get(of[1]["best_rival"], DASH).removeprefix("the "),
            "skill": lambda of: number(of[1]["skill"], 2),
            "95 %": lambda of: between(number(of[1]["skill_low"], 2), number(of[1]["skill_high"], 2)),
        },
    )
    notes = [
        "RMSE in degrees, all trials. Skill: 1 − error over that of the best rival, strokes paired; below 0 the rival "
        "is nearer; an interval from four trials on. Polynomial and FIR filters are black boxes of the force: they "
        "know no other regulation, no inner forces and no touch."
    ]
    return PageTable("rivals", "The model beside its rivals (°)", *shown, notes, "rivals")


def _pooled(result: ValidationResult) -> pd.DataFrame:
    """Scores that figures of several trials count."""
    return result.scores[result.scores["pooled"]]


def iso_table(result: ValidationResult) -> PageTable:
    """ISO 18571-style scores per channel: mean over trials, and what a perfect model would score."""
    ceiling = dict(zip(result.channels["channel"], result.channels["iso_ceiling"].astype(float), strict=True))
    parts = ("overall", "corridor", "phase", "magnitude", "slope")

    def mean(name: str, of: Any) -> str:
        return number(float(of[1][f"iso_{name}"].mean()), 3)

    shown = cells(
        _pooled(result).groupby("channel", sort=False),
        {
            "channel": lambda of: str(of[0]),
            **{name: partial(mean, name) for name in parts},
            "perfect model": lambda of: number(ceiling[str(of[0])], 3),
            "largest shift (ms)": lambda of: number(1e3 * float(of[1]["iso_shift_s"].abs().max()), 2),
        },
    )
    notes = [
        "From 0 to 1, mean over trials; perfect model: what it would score overall under the force as measured. "
        "The specification is made for forces and accelerations of vehicle safety; here it is a style of scoring. "
        "A curve with lost frames has no score."
    ]
    return PageTable("iso", "ISO/TS 18571-style scores", *shown, notes, "scores")


def resolution_table(result: ValidationResult) -> PageTable:
    """Before the impact, bias, largest difference and stated uncertainty per channel."""
    shares = dict(zip(result.channels["channel"], result.channels["resolved_share"].astype(float), strict=True))
    rows = []
    for channel, part in _pooled(result).groupby("channel", sort=False):
        known = part["largest_rad"].notna().any()
        rows.append((str(channel), part, part.loc[part["largest_rad"].idxmax()] if known else None))
    shown = cells(
        rows,
        {
            "channel": lambda of: of[0],
            "before impact": lambda of: degrees(rms(of[1]["before_impact_rmse_rad"])),
            "whole window": lambda of: degrees(rms(of[1]["rmse_rad"])),
            "bias": lambda of: degrees(SIGN[of[0]] * float(of[1]["bias_rad"].mean())),
            "largest": lambda of: DASH if of[2] is None else degrees(float(of[2]["largest_rad"])),
            "at (s)": lambda of: (
                DASH if of[2] is None else f"{of[2]['largest_at_s']:.4f} (trial {int(of[2]['trial'])})"
            ),
            "beyond 95 %": lambda of: percent(shares[of[0]]),
            "u of one sample": lambda of: degrees(rms(of[1]["u_rms_rad"])),
            "lost": lambda of: str(int(of[1]["n_lost"].sum())),
        },
    )
    notes = [
        "beyond 95 %: share of the window in which the mean paired difference is larger than 1.96 u of that instant "
        "(declared uncertainties of force, sensors and parameters, scatter of the trials); by chance one in twenty."
    ]
    return PageTable("differences", "Differences model − trial by channel (°)", *shown, notes, "channels")


def _label(row: Any) -> str:
    return EVENTS[str(row.event)].label


def _shown(row: Any, column: str) -> float:
    """A number of an event in the unit it is shown in."""
    return EVENTS[str(row.event)].display_factor * float(getattr(row, column))


def event_by_trial_table(result: ValidationResult) -> PageTable:
    """Every event of every trial and its prediction; of many trials, the first ones."""
    notes = []
    order = {name: i for i, name in enumerate(EVENTS)}
    events = result.events
    if len(result.traces) > MOST_TRIALS:
        first = list(result.traces)[:MOST_TRIALS]
        events = events[events["trial"].isin(first)]
        notes.append(f"The first {MOST_TRIALS} of {len(result.traces)} trials; all are in the file below.")
    table = events.assign(order=events["event"].map(order)).sort_values(
        ["order", "trial", "source"], ascending=[True, True, False], kind="stable"
    )
    shown = cells(
        table.itertuples(),
        {
            "event": _label,
            "trial": lambda e: str(e.trial),
            "source": lambda e: e.source,
            "value ± u": lambda e: with_u(_shown(e, "value"), _shown(e, "u")),
            "status": lambda e: e.status,
            "note": lambda e: e.note or "",
        },
    )
    return PageTable("events-by-trial", "Every event of every trial", *shown, notes, source="events")


def repeatability_tables(result: ValidationResult) -> list[PageTable]:
    """Repeatability of channels and of events."""
    channels = cells(
        result.channels.itertuples(),
        {
            "channel": lambda c: f"{c.channel} ({c.source})",
            "trials": lambda c: c.state or str(c.n_trials),
            "sᵣ pooled": lambda c: degrees(c.s_r_rad),
            "95 % interval of sᵣ": lambda c: between(degrees(c.s_r_low_rad), degrees(c.s_r_high_rad)),
            "largest sᵣ(t)": lambda c: degrees(c.s_r_largest_rad),
            "limit": lambda c: degrees(c.limit_rad),
        },
    )
    events = cells(
        result.event_repeatability.itertuples(),
        {
            "event": _label,
            "trials": lambda e: f"{e.n_found} found" + (f", {e.n_ambiguous} ambiguous" if e.n_ambiguous else ""),
            "mean ± s": lambda e: with_u(_shown(e, "mean"), _shown(e, "s")),
            "95 % interval of s": lambda e: between(number(_shown(e, "s_low"), 2), number(_shown(e, "s_high"), 2)),
            "limit": lambda e: number(_shown(e, "limit"), 3),
            "range": lambda e: number(_shown(e, "range"), 3),
        },
    )
    caption = "Repeatability of the angles over the window (°)"
    return [
        PageTable("repeatability", caption, *channels, source="channels"),
        PageTable("event-repeatability", "Repeatability of the events", *events, source="event_repeatability"),
    ]


def trial_page_table(result: ValidationResult) -> PageTable:
    """What was done with each trial before it was compared."""
    used: dict[str, Callable[[Any], str]] = {
        "trial": lambda t: str(t.trial),
        "state": lambda t: (
            "used" + (", filmed" if t.filmed else "") + (f", outside: {t.why_outside}" if t.outside is True else "")
        ),
        "peak (N)": lambda t: number(t.peak_force_n, 4),
        "quiet (ms)": lambda t: number(1e3 * t.quiet_s, 3),
        "offset (N)": lambda t: with_u(t.offset_n, t.u_offset_n),
        "hum (N)": lambda t: f"{number(t.hum_1_n, 3)} at {t.hum_hz:.2f} Hz" if t.hum_accepted else "none subtracted",
        "noise (mN)": lambda t: number(1e3 * t.noise_n, 3),
        "delay (ms)": lambda t: number(1e3 * t.group_delay_s, 3),
        "prediction": lambda t: "kept" if t.reused else "simulated",
    }
    refused: dict[str, Callable[[Any], str]] = {head: lambda _: DASH for head in used}
    refused |= {"trial": used["trial"], "state": lambda t: f"not used: {t.reason}"}
    rows = [[say(t) for say in (used if t.used else refused).values()] for t in result.trials.itertuples()]
    return PageTable("trials", "Trials and the correction of their force", list(used), rows, source="trials")


def quantity_table(result: ValidationResult) -> PageTable:
    """Every quantity of the verdict: interval of the model error, plain difference, limit, and what can be said."""

    def shown(row: Any, *names: str) -> str:
        if not math.isfinite(getattr(row, names[0])):
            return DASH
        return format_interval(*shown_interval(row, (names[0], names[1])), "")

    def plain_number(row: Any, column: str, digits: int = 2) -> str:
        return number(QUANTITY[row.quantity].factor * float(getattr(row, column)), digits)

    rows = cells(
        result.quantities.itertuples(),
        {
            "quantity": lambda r: f"{r.title} ({QUANTITY[r.quantity].unit_shown})",
            "error, 95 %": lambda r: shown(r, "low", "high"),
            "plain, 95 %": lambda r: shown(r, "plain_low", "plain_high"),
            "limit": lambda r: plain_number(r, "limit"),
            "reading": reading_of,
            "Y": lambda r: detectable_words(r) if r.primary and math.isfinite(r.detectable_low) else DASH,
            "u": lambda r: plain_number(r, "u"),
            "u force": lambda r: plain_number(r, "u_force"),
            "u sensors": lambda r: plain_number(r, "u_sensors"),
            "u parameters": lambda r: plain_number(r, "u_parameters"),
            "u scatter": lambda r: plain_number(r, "u_repeat"),
            "mostly from": lambda r: r.main_input or DASH,
            "n": lambda r: str(r.n_trials),
        },
    )
    facts = result.judgement
    notes = [
        "After ASME V&V 20: model − trial. Error: interval of the model error of each quantity by itself, with force, "
        "sensors, parameters as declared and the scatter of the trials; plain: the difference without the parameters, "
        "what would be seen again. Angles are means over a phase. “differs” is said of what the test of all quantities "
        "of the claim together resolves (5 %); “alone” of what only its own interval excludes. Y, of quantities of the "
        "claim, would be shown in 80 % of sessions; n trials."
    ]
    if facts.get("judged", False):
        notes.append(
            f"From {facts['draws']} draws on {trials_in_words(facts['drawn_trials'])}, "
            f"{facts['draws_on_branch']} of them on the branch of the trials ({facts['branch']}); "
            f"{facts['failed_draws']} could not be run."
        )
    else:
        notes.append(f"No quantity is estimated: {facts.get('reason', 'nothing was drawn')}.")
    return PageTable("quantities", "Error of the model, quantity by quantity", *rows, notes, "quantities")


def area_table(result: ValidationResult) -> PageTable:
    """Area metric of every event beside the floor that few trials put under it."""
    shown = cells(
        (e for e in result.event_summary.itertuples() if math.isfinite(e.area)),
        {
            "event": _label,
            "area": lambda e: number(_shown(e, "area"), 3),
            "floor (mean)": lambda e: number(_shown(e, "area_floor"), 3),
            "floor (95 %)": lambda e: number(_shown(e, "area_floor_95"), 3),
            "against the floor": lambda e: "above" if e.area > e.area_floor_95 else "within",
        },
    )
    notes = [
        "Area between the distribution functions of predictions and trials; floor: what a model without any error, of "
        "force and parameters neither, would show with as few trials, by chance. “Above” shows no error of the model: "
        "the verdict decides that."
    ]
    return PageTable("area", "Area metric of the events", *shown, notes, "event_summary")


def scorecard_table(result: ValidationResult) -> PageTable:
    """Every score beside what a perfect model and the null model score."""
    shown = cells(
        result.scorecard.itertuples(),
        {
            "score": lambda s: f"{s.channel}: {s.title}{' (°)' if s.unit == 'rad' else ''}",
            "model": lambda s: _cell(s.unit, s.value),
            "perfect model": lambda s: _cell(s.unit, s.ceiling),
            "null model": lambda s: _cell(s.unit, s.null),
            "raw force": lambda s: _cell(s.unit, s.raw_force),
            "range of perfect models": lambda s: (
                between(_cell(s.unit, s.ceiling_low), _cell(s.unit, s.ceiling_high)) if s.ceiling_draws else DASH
            ),
            "reading": lambda s: s.reading,
            "better": lambda s: "smaller" if s.better == "lower" else "larger",
        },
    )
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
    return PageTable("scorecard", "Every score beside its ceiling and the null model", *shown, notes, "scorecard")


def _cell(unit: str, value: float) -> str:
    return degrees(value) if unit == "rad" else number(value, 3)
