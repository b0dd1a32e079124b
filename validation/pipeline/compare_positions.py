"""Models against a session of positions: predictions, bands and scores of every stroke, and what can be said of it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd

import model
from rig.session import Session
from validation.conventions import Array
from validation.errors import ValidationInputError
from validation.events.strikes import EVENTS, PHASES, find_phases, find_stroke_events
from validation.infer.positions import FILE, Identified, example_of, read_identified
from validation.measurement.positions import Stroke, measure_positions
from validation.pipeline.advice import IDENTIFY, USE, beyond, nearer
from validation.prediction.black_boxes import BlackBox, left_out_boxes
from validation.prediction.positions import FREE, SENSORS, Mixture, Predict, of_model, of_null
from validation.statistics.bands import PredictedStroke, estimate_spread, half_width, score
from validation.statistics.domain import compute_left_out_distances, extract_features, locate_stroke
from validation.statistics.skill import CALLED, Skill, compute_skill

NO_PARAMETERS = "hirschkorn2004-regulated"


@dataclass(frozen=True, eq=False)
class Predicted:
    """One model's prediction of one stroke: displacement (n,), m, and half width of its 95 % band; NaN without one."""

    model: str
    stroke: Stroke
    hammer_m: Array
    half_m: Array


@dataclass(frozen=True, eq=False)
class PositionComparison:
    """What came out.

    Attributes
    ----------
    session_name, action_name : str
    identified : Identified or None
    predictions : tuple of Predicted
    scores : DataFrame
        One row a stroke and model.
    by_phase : DataFrame
        RMSE (rulers) of each stroke, model and phase.
    events : DataFrame
        Events measured and predicted.
    repeatability : DataFrame
        Events of strokes of one condition: how many, mean, standard deviation.
    rivals : DataFrame
        One row a stroke: how far it lies from what was fitted (``distance``, infinite where a phase was never fitted,
        NaN where it is not known; ``outside``, ``why``), RMSE (rulers) of every model and black box, ``nearest``.
    training_distances : dict
        Distance of each fitted stroke from the others.
    refused : dict
        Trials that were not used, with the reason.
    sentence : str
    advice : tuple of str
        What to do, of `validation.pipeline.advice`.
    verdict_lines : tuple of str
    files : dict
        What was written, by name.
    """

    session_name: str
    action_name: str
    identified: Identified | None
    predictions: tuple[Predicted, ...]
    scores: pd.DataFrame
    by_phase: pd.DataFrame
    events: pd.DataFrame
    repeatability: pd.DataFrame
    rivals: pd.DataFrame
    training_distances: dict[str, float]
    refused: dict[int, str]
    sentence: str
    advice: tuple[str, ...]
    verdict_lines: tuple[str, ...]
    files: dict[str, Path] = field(default_factory=dict)


def compare_positions(
    session: Session,
    action_name: str | None = None,
    identified: Path | None = None,
    say: Callable[[str], None] = lambda text: None,
) -> PositionComparison:
    """Drive the models by each stroke's measured key and compare the hammer.

    Parameters
    ----------
    session : of positions, without force
    action_name : the action as it is; by default that of the identified set, else the regulated one
    identified : file of an identified set, or a session folder that holds one; by default the session's own, where
        there is one
    say : told of the progress

    Raises
    ------
    ValidationInputError
        No stroke is usable, or the identified set cannot be read or is of other sensors or another action.
    """
    strokes, refused = measure_positions(session)
    own = session.path / FILE
    chosen = identified or (own if own.is_file() else None)
    record = None if chosen is None else read_identified(chosen)
    if record is not None and action_name not in (None, record.action):
        if identified is not None:
            raise ValidationInputError(
                f"{identified}: identified on {record.action}, not on {action_name}; leave out --action or --identified"
            )
        say(f"{chosen}: identified on {record.action}, not on {action_name}: not used")
        record = None
    if record is not None:
        record.check(strokes, str(session.path))
    name = action_name or (record.action if record else NO_PARAMETERS)
    action = model.load_action(name)
    by_number = {stroke.number: stroke for stroke in strokes}
    seals = {stroke.number: session.trial(stroke.number).sha256 for stroke in strokes}
    fitted = {n for n, seal in seals.items() if record is not None and record.was_fitted_to(seal, by_number[n].samples)}
    predictions, rows, phase_rows, event_rows = [], [], [], []
    models = _models(action, record)
    for stroke in strokes:
        say(f"stroke {stroke.number} {stroke.condition}")
        event_rows += _event_rows(stroke, "measured", stroke.hammer.value_m)
        for label, (predict, sets) in models.items():
            fitted_to = label != "regulated" and record is not None and stroke.number in fitted
            try:
                made = sets.predict(predict, stroke)
            except model.ModelError as error:
                say(f"stroke {stroke.number}: {label}: {error}")
                about = {"trial": stroke.number, "condition": stroke.condition, "model": label}
                rows.append({**about, "rmse_share": np.nan, "fitted": fitted_to})
                continue
            half = np.full(made.size, np.nan)
            if record is not None:
                band = record.bands[label]
                half = half_width(
                    PredictedStroke(stroke, made, estimate_spread(stroke, predict, sets, made)), band, band.q
                )
            predicted = Predicted(label, stroke, made, half)
            predictions.append(predicted)
            left = _left_out(record, label, predict, stroke) if fitted_to else np.nan
            rows.append({**_score(predicted), "fitted": fitted_to, "left_out_rmse_share": left})
            phase_rows.append(_phase_row(predicted))
            event_rows += _event_rows(stroke, label, made)
    scores, events = pd.DataFrame(rows), pd.DataFrame(event_rows)
    rivals = _rivals(strokes, scores, record)
    sentence, lines = _verdict(session.info.name, scores, rivals, record)
    advice = _advice(rivals, record)
    return PositionComparison(
        session.info.name or session.path.name,
        action.name,
        record,
        tuple(predictions),
        scores,
        pd.DataFrame(phase_rows),
        events,
        _repeatability(events),
        rivals,
        compute_left_out_distances(record.strokes) if record else {},
        refused,
        sentence,
        tuple(advice),
        (*lines, f"What to do: {' '.join(advice)}") if advice else lines,
    )


def _models(action: model.Action, record: Identified | None) -> dict[str, tuple[Predict, Mixture]]:
    """Predictions by name with their parameters; the action as it is and the null model have no spread of their own."""
    full, null = of_model(action), of_null(action)
    found = {
        "regulated": (full, Mixture.of_one(np.zeros(len(FREE)))),
        "null": (null, Mixture.of_one(np.array(record.null_z) if record else np.zeros(len(SENSORS)))),
    }
    return found | ({"identified": (full, record.mixture)} if record else {})


def _left_out(record: Identified | None, label: str, predict: Predict, stroke: Stroke) -> float:
    """RMSE (rulers) of a stroke by parameters that have not seen it; NaN where they are not known or cannot follow."""
    sets = None if record is None else record.left_out.get(label, {}).get(str(stroke.number))
    try:
        made = np.nan if sets is None else sets.predict(predict, stroke)
    except model.ModelError:
        made = np.nan
    error = (made - stroke.hammer.value_m) / stroke.hammer.travel_m
    return float(np.sqrt(np.mean(error**2)))


def _score(one: Predicted) -> dict[str, object]:
    stroke, travel = one.stroke, one.stroke.hammer.travel_m
    error = one.hammer_m - stroke.hammer.value_m
    rmse = float(np.sqrt(np.mean(error**2)))
    banded = bool(np.all(np.isfinite(one.half_m)))
    fared = (
        score(stroke, one.hammer_m, one.half_m) if banded else dict.fromkeys(("inside", "half_width", "score"), np.nan)
    )
    return {
        "trial": stroke.number,
        "condition": stroke.condition,
        "model": one.model,
        "rmse_m": rmse,
        "rmse_share": rmse / travel,
        "inside_band": fared["inside"],
        "half_width_share": fared["half_width"],
        "interval_score_share": fared["score"],
        "flagged_share": float(np.mean(stroke.hammer.position.flag != 0)),
    }


def _phase_row(one: Predicted) -> dict[str, object]:
    error, at = (one.hammer_m - one.stroke.hammer.value_m) / one.stroke.hammer.travel_m, find_phases(one.stroke)
    row: dict[str, object] = {"trial": one.stroke.number, "condition": one.stroke.condition, "model": one.model}
    return row | {
        name: float(np.sqrt(np.mean(error[at == i] ** 2))) if np.any(at == i) else np.nan
        for i, name in enumerate(PHASES)
    }


def _event_rows(stroke: Stroke, source: str, hammer_m: Array) -> list[dict[str, object]]:
    about = {"trial": stroke.number, "condition": stroke.condition, "source": source}
    return [{**about, "strike": k, **found} for k, found in enumerate(find_stroke_events(stroke, hammer_m), 1)]


def _repeatability(events: pd.DataFrame) -> pd.DataFrame:
    """Scatter of measured events among strikes of one condition, or of one trial that has several: of the player and
    the piano together.
    """
    rows = []
    measured = events[events["source"] == "measured"]
    unnamed = measured["condition"] == ""
    kinds = measured["condition"].mask(unnamed, "trial " + measured["trial"].astype(str))
    for condition, part in measured.groupby(kinds, sort=False):
        if len(part) < 2:
            continue
        for name in [event for event in EVENTS if event != "impact_s"]:
            values = part[name].dropna()
            if len(values) > 1:
                rows.append({"condition": condition, "event": name, "n": len(values), "mean": float(values.mean()),
                             "s": float(values.std(ddof=1))})  # fmt: skip
    return pd.DataFrame(rows, columns=["condition", "event", "n", "mean", "s"])


def _rivals(strokes: Sequence[Stroke], scores: pd.DataFrame, record: Identified | None) -> pd.DataFrame:
    """Where each stroke lies beside those fitted, and the error of every model and black box there."""
    fitted = list(record.strokes.values()) if record is not None else []
    if record is not None and record.black_boxes:
        boxes = {kind: BlackBox.of(plain, FILE) for kind, plain in record.black_boxes.items()}
        every = [boxes for _ in strokes]
    else:
        every = left_out_boxes([example_of(stroke) for stroke in strokes])
    rows = []
    for stroke, boxes in zip(strokes, every, strict=True):
        own = scores[scores["trial"] == stroke.number].set_index("model")
        errors = {str(name): float(value) for name, value in own["rmse_share"].items()}
        for kind, box in boxes.items():
            made = box.answers(stroke.time_s, stroke.key.value_m, stroke.time_s)[:, 0]
            away = (made - stroke.hammer.value_m) / stroke.hammer.travel_m
            errors[kind] = float(np.sqrt(np.mean(away**2)))
        known = {name: value for name, value in errors.items() if math.isfinite(value)}
        where = locate_stroke(extract_features(stroke.time_s, stroke.key.value_m, "m"), fitted)
        rows.append(
            {
                "trial": stroke.number,
                "condition": stroke.condition,
                "fitted": bool(own["fitted"].eq(True).any()) if "fitted" in own else False,
                "distance": where.distance if where else np.nan,
                "outside": where.outside if where else None,
                "why": where.why if where else "",
                **{f"{name}_rmse_share": value for name, value in errors.items()},
                "nearest": min(known, key=lambda name: known[name]) if known else "",
            }
        )
    return pd.DataFrame(rows)


ENDING = "_rmse_share"


def _nearer(row: pd.Series, tested: str) -> list[str]:
    """Rivals that are nearer to a stroke than the model, the nearest first, with their error."""
    errors = {name.removesuffix(ENDING): row[name] for name in row.index if name.endswith(ENDING)}
    found = sorted((value, name) for name, value in errors.items() if name != tested and value < errors[tested])
    return [f"{CALLED.get(name, name)} {100 * value:.1f} %" for value, name in found]


def _beside(rivals: pd.DataFrame, tested: str, record: Identified | None) -> list[str]:
    """Lines on where the strokes lie beside those fitted, and on the rivals of the model."""
    lines = []
    held = rivals[~rivals["fitted"]]
    outside = held["outside"].eq(True)
    if record is not None and not record.strokes:
        lines.append(f"Domain: not known, {FILE} does not say what its strokes were like; identify it again.")
    for row in held[outside].itertuples():
        far = f"; distance {row.distance:.1f}, 1 is the limit" if math.isfinite(row.distance) else ""
        lines.append(f"Domain: trial {row.trial} lies outside of what was fitted ({row.why}{far}).")
    nearest = [not _nearer(row, tested) for _, row in held.iterrows()]
    inside = held[held["outside"].eq(False) & np.array(nearest, dtype=bool)]
    if len(inside):
        named = ", ".join(f"{row.trial} (distance {row.distance:.1f})" for row in inside.itertuples())
        lines.append(
            f"Domain: trial{'s' if len(inside) > 1 else ''} {named}: inside of what was fitted (1 is the limit)."
        )
    for where, part in (("", held[~outside]), (" outside", held[outside])):
        if skill := _skill(part, tested):
            fitted = "" if record is not None and record.black_boxes else "; black boxes fitted to the other strokes"
            lines.append(f"{tested}, strokes not fitted{where}: {skill.words}{fitted}.")
    for _, row in held.iterrows():
        if found := _nearer(row, tested):
            own = f"{100 * row[tested + ENDING]:.1f} %"
            lines.append(f"Trial {row['trial']}: nearer than {tested} ({own}): {', '.join(found)}.")
    return lines


def _skill(rivals: pd.DataFrame, tested: str) -> Skill | None:
    """Skill of the model on these strokes."""
    errors = {name.removesuffix(ENDING): rivals[name].to_numpy() for name in rivals if name.endswith(ENDING)}
    return compute_skill(errors.pop(tested), errors)


def _advice(rivals: pd.DataFrame, record: Identified | None) -> list[str]:
    """What to do, of `validation.pipeline.advice`."""
    if record is None:
        return [IDENTIFY]
    held = rivals[~rivals["fitted"]]
    skill = _skill(held[~held["outside"].eq(True)], "identified")
    said = beyond({row.trial: row.why if row.outside else "" for row in held.itertuples()})
    said += nearer({"hammer": skill}) if skill else []
    return said or ([USE] if skill and skill.skill > 0.0 else [])


def _verdict(
    name: str, scores: pd.DataFrame, rivals: pd.DataFrame, record: Identified | None
) -> tuple[str, tuple[str, ...]]:
    """One sentence, and the lines of the terminal."""
    lines = [
        f"{name}: key motion in, hammer motion predicted, {scores['trial'].nunique()} strokes; RMSE in % of the ruler"
    ]
    for label, part in scores.groupby("model", sort=False):
        values = ", ".join(
            f"{row.trial} {row.condition}{' (fitted)' if row.fitted is True else ''} {100 * row.rmse_share:.1f}"
            for row in part.itertuples()
        )
        lines.append(f"{label}: {values}")
    tested = "identified" if "identified" in set(scores["model"]) else "regulated"
    lines += _beside(rivals, tested, record)
    if record is None:
        return f"{name}: no identified set; the regulated set and its rivals are compared as they are.", tuple(lines)
    out = scores[(scores["model"] == "identified") & (scores["fitted"] == False)]  # noqa: E712
    if not len(out):
        sentence = f"{name}: every stroke was fitted; nothing is held out."
        return sentence, (*lines, sentence)
    beside = rivals.set_index("trial")
    made = out[out["rmse_share"].notna()]
    missed = [f"trial {n} (the identified set cannot follow its key)" for n in out["trial"].drop(made.index)]
    if not len(made):
        sentence = f"{name}: no stroke that was not fitted is predicted; missed: {'; '.join(missed)}."
        return sentence, (*lines, sentence)
    near = [f"trial {row.trial} {_nearest(beside.loc[row.trial], 'identified')}" for row in made.itertuples()]
    outside = [f"trial {row.trial}" for row in made.itertuples() if beside.loc[row.trial]["outside"]]
    least, widest = made["inside_band"].min(), made["half_width_share"].max()
    n, low, high = len(made), 100 * made["rmse_share"].min(), 100 * made["rmse_share"].max()
    sentence = (
        f"On {n} stroke{'s that were' if n > 1 else ' that was'} not fitted the identified set is off by "
        f"{f'{low:.1f} to {high:.1f}' if n > 1 else f'{low:.1f}'} % of the ruler (RMS), at least "
        f"{math.floor(100 * least)} % of each lies inside its 95 % band, whose median half width is at most "
        f"{100 * widest:.1f} %; nearest: {', '.join(near)}"
        + (f"; outside of what was fitted: {', '.join(outside)}" if outside else "")
        + (f"; missed: {'; '.join(missed)}" if missed else "")
        + "."
    )
    return sentence, (*lines, sentence)


def _nearest(row: pd.Series, tested: str) -> str:
    """Which of the model and its rivals is nearest to a stroke, with its error."""
    found = _nearer(row, tested)
    return found[0] if found else f"the {tested} set {100 * row[tested + ENDING]:.1f} %"
