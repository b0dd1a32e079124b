"""A model beside its rivals on the trials of a session: their errors, and how far each trial lies from the fitted ones.

Rivals: the null model, the set before it was identified, and three black boxes fitted to the set's strokes, or to the
other trials.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd

from model.errors import ModelError
from validation.conventions import ENCODER_BODIES, ENCODER_CHANNELS, FILM_CHANNELS, rms
from validation.measurement.trial import MeasuredTrial
from validation.prediction.black_boxes import KINDS, BlackBox, Example, left_out_boxes
from validation.prediction.model_under_test import ModelUnderTest
from validation.prediction.posterior import Posterior, posterior_of
from validation.prediction.predict_session import PredictedSession, predict_trial
from validation.scores.score_session import ScoredSession
from validation.scores.traces import select_scored_angles
from validation.statistics.domain import describe_domain, extract_features, locate_stroke
from validation.statistics.skill import (
    RIVALS,
    Skill,
    compute_skill,
    describe_nearer_rivals,
    describe_nearest,
    describe_skills,
)


def describe_stroke(m: MeasuredTrial) -> dict[str, Any]:
    """Properties of a measured trial (`validation.statistics.domain`): by its key, rad, and its force."""
    return extract_features(m.time_s, m.change_rad[:, 0], "rad", None if m.driven_by_key else m.force.force_n)


def make_example(m: MeasuredTrial) -> Example:
    """Input and outputs of a measured trial for a black box: the force, N, in (the key's angle, rad, where the key
    drives), angles of key, whippen and hammer since rest, (n, 3), rad, out; NaN for those not compared."""
    compared = [name in m.channels for name in ENCODER_CHANNELS]
    answers = np.where(compared, m.change_rad, np.nan)
    if m.driven_by_key:
        return Example(m.time_s, m.change_rad[:, 0], m.time_s, answers)
    return Example(m.force.time_s, m.force.force_n, m.time_s, answers)


@dataclass(frozen=True)
class Rivals:
    """A model beside its rivals on the trials of a session."""

    # one row a trial and channel: rmse_rad of the model, <rival>_rmse_rad (of films the null model's alone), nearest
    errors: pd.DataFrame
    # channel -> skill against the best rival on trials that were not fitted, on all where all were
    skill: dict[str, Skill]
    # one row a trial: fitted, distance, outside, why_outside; not known for an action that was not identified
    places: pd.DataFrame
    domain: tuple[str, ...]  # what the verdict says of where the trials lie
    skills: tuple[str, ...]  # what it says of the skill, in one line
    nearer: str  # what its head says where a rival is nearer; empty where the model is nearer in every channel


def compare_rivals(
    predicted: PredictedSession,
    scored_session: ScoredSession,
    tested: ModelUnderTest,
    without: Collection[tuple[int, str]],
) -> Rivals:
    """RMSE of the rivals that ``tested`` names, for each trial and channel, skill by channel, position of each trial in
    the training domain, and sentences on them; pairs (trial, channel) ``without`` do not count. Simulates values before
    a fit."""
    posterior = posterior_of(tested.action)
    compared = {m.number: m.channels for m in predicted.trials}
    faulty = {number for number, name in without if name in (*compared.get(number, ()), *FILM_CHANNELS)}
    boxes = _fit_black_boxes(predicted.trials, tested, posterior, faulty)
    unfitted = _make_unfitted(tested, posterior)
    rows = []
    for m in predicted.trials:
        drive = make_example(m)
        answers = {kind: box.answers(drive.drive_s, drive.drive, m.time_s) for kind, box in boxes[m.number].items()}
        if unfitted is not None:
            try:
                answers["unfitted"] = predict_trial(m, unfitted).turn_rad[:, ENCODER_BODIES]
            except ModelError:
                answers["unfitted"] = np.full(m.change_rad.shape, np.nan)
        frame = scored_session.traces.encoder[m.number]
        inside = scored_session.traces.window.mask(m.time_s)
        for score in scored_session.scores[scored_session.scores["trial"] == m.number].to_dict("records"):
            channel = str(score["channel"])
            errors = {"null": float(score["null_rmse_rad"])}
            if channel in ENCODER_CHANNELS:
                k, measured = ENCODER_CHANNELS.index(channel), select_scored_angles(frame, channel)
                errors |= {name: rms((made[:, k] - measured)[inside]) for name, made in answers.items()}
            known = {"model": float(score["rmse_rad"]), **errors}
            known = {name: value for name, value in known.items() if np.isfinite(value)}
            rows.append(
                {
                    "trial": m.number,
                    "channel": channel,
                    "rmse_rad": float(score["rmse_rad"]),
                    **{f"{name}_rmse_rad": errors.get(name, np.nan) for name in RIVALS},
                    "nearest": min(known, key=lambda name: known[name]) if known else "",
                }
            )
    table = pd.DataFrame(rows)
    places = _locate_trials(predicted.trials, posterior)
    skill = _compute_skills(table, places, without)
    lost = {int(row.trial) for row in table.itertuples() if row.nearest not in ("", "model")}
    domain = [] if posterior is None else describe_domain(tested.action.name, places, bool(posterior.strokes), lost)
    counts = [pair not in without for pair in zip(table["trial"], table["channel"], strict=True)]
    domain += describe_nearest(table[counts])
    fitted = "the strokes it was fitted to" if posterior is not None and posterior.black_boxes else "the other trials"
    return Rivals(table, skill, places, tuple(domain), describe_skills(skill, fitted), describe_nearer_rivals(skill))


def _fit_black_boxes(
    trials: Collection[MeasuredTrial], tested: ModelUnderTest, posterior: Posterior | None, faulty: Collection[int]
) -> dict[int, dict[str, BlackBox]]:
    """Black boxes by trial number and kind: those stored with the identified action, else each fitted to the other
    trials but ``faulty`` ones, given by number (which get none). Empty where ``tested`` names no black box."""
    nothing: dict[int, dict[str, BlackBox]] = {m.number: {} for m in trials}
    if not set(KINDS) & set(tested.rivals):
        return nothing
    if posterior is not None and posterior.black_boxes:
        made = {
            kind: BlackBox.from_plain_values(plain, tested.action.origin)
            for kind, plain in posterior.black_boxes.items()
        }
        return {m.number: made for m in trials}
    sound = [m for m in trials if m.number not in faulty]
    found = left_out_boxes([make_example(m) for m in sound])
    return nothing | {m.number: boxes for m, boxes in zip(sound, found, strict=True)}


def _make_unfitted(tested: ModelUnderTest, posterior: Posterior | None) -> ModelUnderTest | None:
    if posterior is None or not posterior.before or "unfitted" not in tested.rivals:
        return None
    before = tested.action.with_values(dict(posterior.before))
    return replace(tested, action=before, rivals=())


def _locate_trials(trials: Collection[MeasuredTrial], posterior: Posterior | None) -> pd.DataFrame:
    """Table with a row a trial: whether it was ``fitted``, its ``distance`` from the training domain (above 1 outside),
    ``outside``, and ``why_outside``; distance NaN and outside None where the domain is not known."""
    rows = []
    for m in trials:
        fitted = posterior is not None and posterior.was_fitted_to(m.seal, m.samples)
        where = locate_stroke(describe_stroke(m), list(posterior.strokes.values())) if posterior is not None else None
        rows.append(
            {
                "trial": m.number,
                "fitted": fitted,
                "distance": where.distance if where else np.nan,
                "outside": where.outside if where else None,
                "why_outside": where.why if where and where.outside else "",
            }
        )
    return pd.DataFrame(rows)


def _compute_skills(
    table: pd.DataFrame, places: pd.DataFrame, without: Collection[tuple[int, str]]
) -> dict[str, Skill]:
    """Skill by channel, from the ``table`` of RMSE of model and rivals, a row a trial and channel, over the trials that
    ``places`` does not call fitted, or all where none is left; pairs (trial, channel) ``without`` do not count."""
    fitted = set(places["trial"][places["fitted"]])
    out = {}
    for channel, part in table.groupby("channel", sort=False):
        counts = part[[(number, channel) not in without for number in part["trial"]]]
        held = counts[~counts["trial"].isin(fitted)]
        counts = held if len(held) else counts
        rivals = {name: counts[f"{name}_rmse_rad"].to_numpy(dtype=float) for name in RIVALS}
        skill = compute_skill(counts["rmse_rad"].to_numpy(dtype=float), rivals)
        if skill is not None:
            out[str(channel)] = skill
    return out
