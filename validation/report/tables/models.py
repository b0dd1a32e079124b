"""Tables that set sessions and models side by side: scores beside their ceiling, models paired by trial, events."""

from __future__ import annotations

import math
from typing import Any

import pandas as pd

from validation.conventions import ENCODER_CHANNELS, FILM_CHANNELS
from validation.curves.display_signs import TITLE
from validation.events.definitions import EVENTS
from validation.report.tables.formatting import DASH, PageTable, cells, degrees, number, with_u
from validation.report.view import SessionView
from validation.result import ValidationResult
from validation.scores.curve_scores import SCORES
from validation.side_by_side import SideBySide
from validation.verdict.quantities import PHASES, QUANTITIES
from validation.verdict.verdict import format_interval, reading_of, shown_interval

MATRIX_SCORES = {"rmse_rad": "RMSE (°)", "iso_overall": "ISO-style"}


def matrix(side: SideBySide) -> PageTable:
    """One row per session and model, and below each session its ceiling and the null model; scores of each channel."""
    channels = [
        c for c in (*ENCODER_CHANNELS, *FILM_CHANNELS) if any((r.scorecard["channel"] == c).any() for r in side.results)
    ]
    head = ["session", "predicted by", "trials"]
    head += [f"{channel} {title}" for title in MATRIX_SCORES.values() for channel in channels]
    head += ["events that agree"]
    rows = []
    for name, results in side.sessions.items():
        first = results[0]
        n = str(len(first.traces))
        for r in results:
            counted = r.event_summary[r.event_summary["n_trials"] > 0]
            agree = f"{int(counted['agree'].sum())} of {len(counted)}"
            rows.append([name, r.action_name, str(len(r.traces)), *_cells(r, channels, "value"), agree])
        rows.append([name, "perfect model (ceiling)", n, *_cells(first, channels, "ceiling"), DASH])
        rows.append([name, "null model", n, *_cells(first, channels, "null"), DASH])
    notes = [
        "Over all trials of a session: RMSE by root mean square, the ISO 18571-style score (0 to 1, 1 is best) by "
        "mean. Ceiling: what a perfect model would score that knows each trial’s force as it was measured; "
        "a dash without budget. Null model: the key’s turn alone, all else balanced along it, no fit to trials; a "
        "model of many bodies should do better. Sessions are never pooled: blows of different conditions or sample "
        "rates have no common repeatability. Jack and repetition lever: filmed trials only."
    ]
    return PageTable("matrix", "Scores of every session, model and channel", head, rows, notes, "scorecard")


def _cells(result: ValidationResult, channels: list[str], column: str) -> list[str]:
    card = result.scorecard.set_index(["channel", "score"])[column]
    cells = []
    for score in MATRIX_SCORES:
        for channel in channels:
            value = float(card.get((channel, score), math.nan))
            cells.append(degrees(value) if SCORES[score].unit == "rad" else number(value, 3))
    return cells


def evidence_table(side: SideBySide) -> PageTable:
    """The evidence for each model of a session against its first, and what a blow costs."""
    shown = cells(
        side.evidence.itertuples(),
        {
            "session: model": lambda e: f"{e.session}: {e.model}",
            "evidence": lambda e: e.reading,
            "ln Bayes factor": lambda e: (
                with_u(e.log_bayes_factor, e.u_log_bayes_factor) if e.model != e.against else DASH
            ),
            "ln evidence": lambda e: with_u(e.log_evidence, e.u_log_evidence),
            "p of the test": lambda e: number(e.p, 2),
            "right-hand sides": lambda e: str(round(e.right_hand_sides)) if math.isfinite(e.right_hand_sides) else DASH,
            "times the first": lambda e: number(e.cost_ratio, 3),
            "ms a blow": lambda e: number(1e3 * e.seconds, 3),
        },
    )
    notes = [
        "Evidence (marginal likelihood): density that a model gives to the trials’ mean angles, its parameters, the "
        "force and the sensors drawn from what is declared of them; so what is uncertain in a richer model counts "
        "against it. ln Bayes factor: ln evidence less that of the session’s first model, ± u from the number of "
        "draws, graded after Kass and Raftery (1995) by its end nearest to 0. p: of the verdict’s test. Right-hand "
        "sides: mean of a blow; ms: processor time of one, with the run that estimates its error."
    ]
    return PageTable("evidence", "Evidence for each model, and what it costs", *shown, notes, "evidence")


def pair_tables(side: SideBySide) -> tuple[PageTable, PageTable]:
    """Which model is closer by RMSE, and whether so few trials can show it; the same by other scores."""
    by_rmse = side.model_pairs["score"] == "rmse_rad"
    return (
        _pairs(side.model_pairs[by_rmse], "model-pairs", "Models paired by trial"),
        _pairs(side.model_pairs[~by_rmse], "model-pairs-other", "Models paired by trial, other scores"),
    )


def _pairs(pairs: pd.DataFrame, key: str, caption: str) -> PageTable:
    def k(p: Any) -> float:
        return math.degrees(1.0) if p.unit == "rad" else 1.0

    def of_several(p: Any, text: str) -> str:
        return text if p.n_trials > 1 else DASH

    shown = cells(
        pairs.itertuples(),
        {
            "session: channel": lambda p: f"{p.session}: {p.channel}",
            "score": lambda p: SCORES[p.score].title + (" (°)" if p.unit == "rad" else ""),
            "what can be said": lambda p: p.claim,
            "difference": lambda p: f"{p.second} − {p.first}",
            "mean ± u": lambda p: with_u(k(p) * p.difference, k(p) * p.u_difference),
            "95 % interval": lambda p: of_several(p, f"{number(k(p) * p.low, 3)} to {number(k(p) * p.high, 3)}"),
            "closer: first : second": lambda p: f"{p.first_closer} : {p.second_closer} of {p.n_trials}",
            "p": lambda p: of_several(p, number(p.p, 3)),
            "least p": lambda p: of_several(p, number(p.p_least, 3)),
            "p, all channels": lambda p: of_several(p, number(p.p_joint, 3)),
        },
    )
    notes = [
        "Every trial is predicted by both models; the difference of their scores is taken trial by trial, so that the "
        "scatter of the blows cancels. u: standard uncertainty of the mean; interval by Student’s t, "
        "widened by what errors of force and sensors common to the trials make of the difference. p: exact sign-flip "
        "test, two-sided; least p: the smallest that so many trials allow (five: 0.0625); all channels: signs flipped "
        "in all channels together. Closer to these trials does not mean right."
    ]
    return PageTable(key, caption, *shown, notes, "model_pairs")


NOT_COUNTED = "not counted (encoder left out)"


def event_table(view: SessionView) -> PageTable:
    """Presence, means and paired differences of the events, the models beside each other."""
    head = ["event", "found in trials", "trials: mean ± s"]
    for called in view.names:
        head += [f"{called}: found", f"{called}: mean", f"{called} − trial ± u"]
    models = [r.event_summary.set_index("event") for r in view.results]
    budgets = [dict(zip(r.quantities["quantity"], r.quantities["u"], strict=True)) for r in view.results]
    rows = []
    for name, e in models[0].iterrows():
        kind = EVENTS[str(name)]
        k = kind.display_factor
        row = [kind.label, f"{e['found_trial']} of {e['n_trials']}" if e["n_trials"] else NOT_COUNTED]
        row.append(with_u(k * e["trial_mean"], k * e["trial_s"]))
        for summary, budget in zip(models, budgets, strict=True):
            m = summary.loc[name]
            presence = "both" if m["agree"] and m["found_trial"] else "neither" if m["agree"] else "differs"
            doubt = f", {m['ambiguous']} ambiguous" if m["ambiguous"] else ""
            row.append(f"{m['found_model']} of {m['n_trials']}: {presence}{doubt}" if m["n_trials"] else DASH)
            row += [
                number(k * m["model_mean"], 5),
                with_u(k * m["difference"], k * budget.get(name, m["u_difference"])),
            ]
        rows.append(row)
    whole = "that of the table of quantities: force, sensors, parameters as declared, scatter of the trials"
    part = "of the trials alone (encoder, levels of rest, scatter over trials), because nothing was drawn"
    notes = [
        "Whether an event happens comes before when: “both” found in as many trials as predictions, “neither” in none, "
        "“differs” otherwise. Differences are paired by trial; u is a standard uncertainty, "
        f"{whole if all(budgets) else part}."
    ]
    if _moved(view):
        notes.append(
            "Events of the trials are found with the geometry and rest of each model; the trials’ column is that of "
            f"{view.names[0]}, the differences are each model’s own."
        )
    return PageTable("events", "Events: presence first, then timing", head, rows, notes, "event_summary")


def _moved(view: SessionView) -> bool:
    """Whether the trials' own events depend on the model they were found with."""
    first = view.first.event_summary["trial_mean"]
    return any(not r.event_summary["trial_mean"].equals(first) for r in view.results[1:])


WIDTH, HEIGHT, EDGE = 240.0, 22.0, 8.0


def forest(side: SideBySide) -> list[dict[str, Any]]:
    """Rows of the primary events of all results, resolved ones first, then by how far the interval reaches.

    Of each the quantity, session and model, texts, and the places ``at``, ``low``, ``high`` in the drawing's units.

    Its numbers are those of `ValidationResult.quantities`; each quantity has one scale for all its rows.
    """
    found = [
        (result, row)
        for result in side.results
        for row in result.quantities.itertuples()
        if row.primary and not row.channel and math.isfinite(row.low)
    ]
    reach: dict[str, float] = {}
    for _, row in found:
        reach[row.quantity] = max(reach.get(row.quantity, 0.0), abs(row.low), abs(row.high), row.limit)

    def place(value: float, most: float) -> float:
        share = value / most if most > 0 and math.isfinite(value) else 0.0
        return round(WIDTH / 2 + (WIDTH / 2 - EDGE) * share, 2)

    def first(pair: tuple[ValidationResult, Any]) -> tuple[bool, float]:
        row = pair[1]
        return not row.resolved, -max(abs(row.low), abs(row.high)) / row.limit

    out = []
    for result, row in sorted(found, key=first):
        q, most = QUANTITY[row.quantity], reach[row.quantity]
        out.append(
            {
                "quantity": f"{q.title} ({q.unit_shown})",
                "session": result.session_name,
                "model": result.action_name,
                "difference": format_interval(*shown_interval(row), ""),
                "interval": f"{number(q.factor * row.low, 3)} to {number(q.factor * row.high, 3)}",
                "reading": reading_of(row),
                "resolved": bool(row.resolved),
                "at": place(0.5 * (row.low + row.high), most),
                "low": place(row.low, most),
                "high": place(row.high, most),
                "limits": [place(-row.limit, most), place(row.limit, most)],
            }
        )
    return out


STEPS = ((0.5, "h0"), (1.0, "h1"), (2.0, "h2"), (4.0, "h3"), (math.inf, "h4"))
"""Upper end of each class of colour, in multiples of what a right model reaches."""
QUANTITY = {q.name: q for q in QUANTITIES}


def heat_map(side: SideBySide) -> list[dict[str, Any]]:
    """One group per result: its session and model, and by measured channel the cells of the phases.

    A cell has the interval of the model error as ``text``, class of colour as ``level``, and the whole in ``words``.

    Its numbers are those of `ValidationResult.quantities`; a colour only repeats what the numbers say.
    """
    groups = []
    for result in side.results:
        rows = []
        angles = result.quantities[result.quantities["channel"] != ""]
        for channel, part in angles.groupby("channel", sort=False):
            by_phase = {str(row.phase): row for row in part.itertuples()}
            rows.append((TITLE[str(channel)], [_cell(by_phase[phase]) for phase in PHASES]))
        judged = bool(result.judgement.get("judged", False))
        groups.append({"session": result.session_name, "model": result.action_name, "judged": judged, "rows": rows})
    return groups


def _cell(row: Any) -> dict[str, str]:
    if not math.isfinite(row.low):
        return {"text": DASH, "level": "na", "words": row.state or "not estimated"}
    level = next(name for most, name in STEPS if row.ratio <= most * row.ratio_limit)
    plain = format_interval(*shown_interval(row, ("plain_low", "plain_high")), "°")
    words = f"{reading_of(row)}; plain difference {plain}; limit {number(math.degrees(row.limit), 2)}°"
    return {"text": format_interval(*shown_interval(row), "°"), "level": level, "words": words}
