"""Table *event_summary*: presence of the events in trials and predictions, then their paired differences.

Conventions: SI; differences are model − trial, paired by trial; presence is judged before timing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import lru_cache
from typing import Any

import numpy as np

from validation.conventions import CONFIDENCE, Array
from validation.events.definitions import EVENTS, Event
from validation.tables.comparison import Comparison
from validation.tables.events import event_label
from validation.tables.table import OF_ROW, UNIT, Column, Page, Row, Table


def _count_words(column: str) -> Callable[[Row], str]:
    """Formatter of a table cell: how many of a row's trials have the event, by the count in ``column``, with the
    ambiguous ones where that is ``found_model``."""

    def cell(row: Row) -> str:
        if not row["n_trials"]:
            return "not counted (left out in all trials)"
        doubt = f", {row['ambiguous']} ambiguous" if row["ambiguous"] and column == "found_model" else ""
        return f"{row[column]} of {row['n_trials']}{doubt}"

    return cell


COLUMNS = (
    Column("event", "", "Event, a key of event_definitions", str, head="event", text=event_label),
    UNIT,
    Column("n_trials", "1", "Trials compared", int),
    Column("found_trial", "1", "Trials in which it happened", int, head="trials with it",
           text=_count_words("found_trial")),
    Column("found_model", "1", "Predictions in which it happened", int, head="predictions with it",
           text=_count_words("found_model")),
    Column("agree", "", "Whether it happened in the same trials and predictions", bool),
    Column("ambiguous", "1", "Ambiguous cases, trials and predictions together", int),
    Column("trial_mean", OF_ROW, "Mean over trials", head="trials: mean ± s", u="trial_s"),
    Column("trial_s", OF_ROW, "Standard deviation over trials"),
    Column("model_mean", OF_ROW, "Mean over predictions", head="model: mean", digits=4),
    Column("difference", OF_ROW, "Mean of model − trial, paired by trial", head="model − trial", u="u_difference"),
    Column("difference_s", OF_ROW, "Standard deviation of that difference"),
    Column("u_difference", OF_ROW, "Standard uncertainty of the mean difference (stated uncertainty of the events, "
           "scatter over trials)"),
    Column("n_both", "1", "Trials with the event in both", int),
    Column("u_trial", OF_ROW, "Stated standard uncertainty of the event in one trial"),
    Column("area", OF_ROW, "Area metric between the distributions of predictions and trials", head="area metric"),
    Column("area_floor", OF_ROW, "Mean of it for a perfect model and so many trials"),
    Column("area_floor_95", OF_ROW, "95th percentile of that", head="by chance below"),
)  # fmt: skip


def rows(comparison: Comparison) -> list[dict[str, Any]]:
    """One row an event, of the trials that count."""
    return list(event_summary(comparison.counting, comparison.events.model))


DRAWS = 4000  # the mean of an area is known to one per cent
SEED = 2008


def area_metric(model: Array, trial: Array) -> float:
    """Area between the empirical distribution functions of two samples (n,) and (m,), in their unit, 0 where they are
    equal; NaN values are left out, NaN with fewer than two values in either.

    Conventions: in the unit of the event; the area between the two empirical distribution functions. Source: Ferson,
    Oberkampf and Ginzburg (2008); for equally many values it is the mean distance of the sorted values. Few trials put
    a floor under it: two samples of one and the same distribution are apart by chance. The floor is simulated for
    independent normal samples (a model driven by the trials' own forces can lie below it).
    """
    m, t = (np.asarray(v, dtype=float)[np.isfinite(v)] for v in (model, trial))
    if min(m.size, t.size) < 2:
        return float("nan")
    return float(_area_between_distributions(m[None], t[None])[0])


@lru_cache(maxsize=256)
def area_floor(n_model: int, n_trial: int) -> tuple[float, float]:
    """Mean and 95th percentile, over the standard deviation of the trials, of the area metric of a model without error
    with ``n_model`` predictions and ``n_trial`` trials; simulated with a fixed seed. NaN where either is below two.

    >>> [round(v, 1) for v in area_floor(5, 5)]
    [0.7, 1.3]
    """
    if min(n_model, n_trial) < 2:
        return float("nan"), float("nan")
    rng = np.random.default_rng([SEED, n_model, n_trial])
    areas = _area_between_distributions(rng.standard_normal((DRAWS, n_model)), rng.standard_normal((DRAWS, n_trial)))
    return float(areas.mean()), float(np.quantile(areas, CONFIDENCE))


def _area_between_distributions(model: Array, trial: Array) -> Array:
    """Area (k,) between the empirical distribution functions of row i of ``model`` (k, n) and row i of ``trial`` (k,
    m), in their unit."""
    values = np.concatenate([model, trial], axis=1)
    order = np.argsort(values, axis=1, kind="stable")
    of_model = order < model.shape[1]
    apart = np.cumsum(of_model / model.shape[1] - ~of_model / trial.shape[1], axis=1)
    width = np.diff(np.take_along_axis(values, order, axis=1), axis=1)
    return np.asarray((np.abs(apart[:, :-1]) * width).sum(axis=1))


def event_summary(trial: dict[int, dict[str, Event]], model: dict[int, dict[str, Event]]) -> Iterator[dict[str, Any]]:
    """Yield for each event a row by column: in how many trials and predictions it happened, means, and paired
    differences model − trial where both have it; arguments: trial number → event name → event. Events missing from
    ``trial`` do not count."""
    for name, kind in EVENTS.items():
        t = [events[name] for events in trial.values() if name in events]
        m = [model[number][name] for number, events in trial.items() if name in events]
        there = np.array([e.status != "absent" for e in t], dtype=bool)  # no trial may count
        predicted = np.array([e.status != "absent" for e in m], dtype=bool)
        both = there & predicted
        tv, mv = np.array([e.value for e in t]), np.array([e.value for e in m])
        tu, mu = np.array([e.u for e in t]), np.array([e.u for e in m])
        d = (mv - tv)[both]
        n = d.size
        s = float(d.std(ddof=1)) if n > 1 else float("nan")
        # the levels of rest are the same for all trials, so averaging does not shrink the stated uncertainty
        stated = float(np.sqrt(np.mean(tu[both] ** 2 + mu[both] ** 2))) if n else float("nan")
        floor, floor_95 = area_floor(int(predicted.sum()), int(there.sum()))
        spread = float(tv[there].std(ddof=1)) if there.sum() > 1 else float("nan")
        yield {
            "event": name,
            "unit": kind.unit,
            "n_trials": len(t),
            "found_trial": int(there.sum()),
            "found_model": int(predicted.sum()),
            "agree": bool(np.all(there == predicted)),
            "ambiguous": sum(e.status == "ambiguous" for e in t + m),
            "trial_mean": float(tv[there].mean()) if there.any() else float("nan"),
            "trial_s": spread,
            "model_mean": float(mv[predicted].mean()) if predicted.any() else float("nan"),
            "difference": float(d.mean()) if n else float("nan"),
            "difference_s": s,
            "u_difference": float(np.hypot(stated, s / np.sqrt(n))) if n > 1 else stated,
            "n_both": n,
            "u_trial": float(np.sqrt(np.mean(tu[both] ** 2))) if n else float("nan"),
            "area": area_metric(mv[predicted], tv[there]),
            "area_floor": floor * spread,
            "area_floor_95": floor_95 * spread,
        }


NOTES = (
    "Whether an event happens comes before when. Differences are paired by trial; ±: standard uncertainty of the "
    "trials alone (encoders, levels of rest, scatter). Area metric: area between the distribution functions of "
    "predictions and trials; by chance below: what a model without error stays below in 95 % of sessions with as few "
    "trials.",
)
TABLE = Table(
    "event_summary",
    "event: presence, then paired differences",
    COLUMNS,
    rows,
    (Page("scores", "Events: presence first, then timing", NOTES, order=2),),
)
