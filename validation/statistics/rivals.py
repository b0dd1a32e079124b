"""Is the model nearer than its rivals, stroke by stroke: a skill score against the best of them, with its interval.

Skill = 1 − error over error: 0.6 is an error 60 % smaller than that of the best rival, 0 as large, below 0 larger. The
errors are RMSE, the mean over strokes is that of their logarithms, so that no stroke counts more because it is harder.
Its 95 % interval is Student's t of the paired differences of the logarithms; it speaks for strokes like these.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd
from scipy.special import stdtrit

from model.errors import ModelError
from validation.conventions import ENCODER_BODIES, ENCODER_CHANNELS, Array
from validation.measurement.trial import MeasuredTrial
from validation.prediction.black_boxes import BlackBox, Example, left_out_boxes
from validation.prediction.model_under_test import ModelUnderTest
from validation.prediction.posterior import Posterior, posterior_of
from validation.prediction.session import PredictedSession, predict_trial
from validation.scores.session import ScoredSession
from validation.scores.traces import scored
from validation.statistics.domain import features_of, place
from validation.statistics.model_comparison import LEVEL, joint_sign_flip

RIVALS = ("null", "unfitted", "polynomial", "fir")
FEWEST = 4
"""Strokes from which an interval is stated: with three Student's t is 4.3 and says nothing."""
LEAST = 1e-12
CALLED = {
    "null": "the null model",
    "unfitted": "the unfitted set",
    "regulated": "the unfitted set",
    "polynomial": "the polynomial",
    "fir": "the FIR filter",
}
"""Rivals in words; polynomial and FIR filter are the black boxes of `validation.prediction.black_boxes`."""


@dataclass(frozen=True)
class Skill:
    """Skill against the best rival, its 95 % interval (NaN with fewer than `FEWEST` strokes), and how many strokes."""

    rival: str
    skill: float
    low: float
    high: float
    strokes: int

    @property
    def interval(self) -> str:
        """Its interval in brackets; empty where there is none."""
        return f" [{self.low:.2f}, {self.high:.2f}]" if np.isfinite(self.low) else ""

    @property
    def words(self) -> str:
        """In a sentence's words."""
        size = f"{100 * abs(self.skill):.0f} % {'smaller' if self.skill >= 0 else 'larger'}"
        nearer = f"{size} than that of {CALLED.get(self.rival, self.rival)}"
        n = f"{self.strokes} stroke{'s' if self.strokes > 1 else ''}"
        return f"error {nearer} (skill {self.skill:.2f}{self.interval}; {n}{'' if self.interval else ': no interval'})"


def skill_of(model: Array, rivals: Mapping[str, Array]) -> Skill | None:
    """Skill of a model's errors (n,) against those of the rival that is best on the same strokes.

    Strokes that one of them has not are left out, a rival that has none altogether; None where nothing is left.
    """
    there = {name: np.asarray(of, dtype=float) for name, of in rivals.items() if np.isfinite(of).any()}
    known = np.isfinite(np.asarray(model, dtype=float)) & np.all([np.isfinite(of) for of in there.values()], axis=0)
    if not there or not known.any():
        return None
    size = {name: np.log(np.maximum(of[known], LEAST)) for name, of in there.items()}
    best = min(size, key=lambda name: float(size[name].mean()))
    ratio = np.log(np.maximum(np.asarray(model, dtype=float)[known], LEAST)) - size[best]
    n, mean = ratio.size, float(ratio.mean())
    reach = float(stdtrit(n - 1, 0.975) * ratio.std(ddof=1) / np.sqrt(n)) if n >= FEWEST else float("nan")
    low, high = 1.0 - np.exp(mean + reach), 1.0 - np.exp(mean - reach)
    return Skill(best, 1.0 - float(np.exp(mean)), float(low), float(high), n)


def stroke_features(m: MeasuredTrial) -> dict[str, Any]:
    """Properties of a measured trial (`validation.statistics.domain`): by its key, rad, and its force."""
    return features_of(m.time_s, m.change_rad[:, 0], "rad", m.force.force_n if m.has_force else None)


def stroke_example(m: MeasuredTrial) -> Example:
    """A measured trial as a black box sees it: force in, N, angles of the encoders since rest out, rad."""
    return Example(m.force.time_s, m.force.force_n, m.time_s, m.change_rad)


@dataclass(frozen=True)
class Rivals:
    """A model beside its rivals on the trials of a session.

    Attributes
    ----------
    errors : DataFrame
        One row a trial and channel: rmse_rad of the model, <rival>_rmse_rad (of films the null model's alone), nearest.
    skill : dict
        Channel -> skill against the best rival on trials that were not fitted, on all where all were.
    places : DataFrame
        One row a trial: fitted, distance, outside, why_outside; not known for an action that was not identified.
    domain : tuple of str
        What the verdict says of where the trials lie.
    skills : tuple of str
        What it says of the skill, in one line.
    nearer : str
        What its head says where a rival is nearer; empty where the model is nearer in every channel.
    """

    errors: pd.DataFrame
    skill: dict[str, Skill]
    places: pd.DataFrame
    domain: tuple[str, ...]
    skills: tuple[str, ...]
    nearer: str


def beside_rivals(
    predicted: PredictedSession,
    scored_session: ScoredSession,
    tested: ModelUnderTest,
    without: Collection[tuple[int, str]],
) -> Rivals:
    """Score the rivals that `tested` names, and say how far each trial lies from what was fitted.

    Parameters
    ----------
    predicted, scored_session : the session with its predictions and scores
    tested : the model
    without : trials and channels that figures of several trials do not count
    """
    posterior = posterior_of(tested.action)
    boxes = _black_boxes(predicted.trials, tested, posterior, {number for number, _ in without})
    unfitted = _unfitted(tested, posterior)
    rows = []
    for m in predicted.trials:
        answers = {
            kind: box.answers(m.force.time_s, m.force.force_n, m.time_s) for kind, box in boxes[m.number].items()
        }
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
                k, measured = ENCODER_CHANNELS.index(channel), scored(frame, channel)
                errors |= {name: _rms((made[:, k] - measured)[inside]) for name, made in answers.items()}
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
    places = _places(predicted.trials, posterior)
    skill = _skills(table, places, without)
    domain = () if posterior is None else _domain_lines(tested.action.name, places, bool(posterior.strokes))
    fitted = "the strokes it was fitted to" if posterior is not None and posterior.black_boxes else "the other trials"
    return Rivals(table, skill, places, tuple(domain), _skill_lines(skill, fitted), nearer(table, without))


def _skill_lines(skill: Mapping[str, Skill], fitted: str) -> tuple[str, ...]:
    """The skill of every channel in one line."""
    if not skill:
        return ()
    of = [
        f"{channel} {one.skill:.2f}{one.interval} ({CALLED[one.rival].removeprefix('the ')})"
        for channel, one in skill.items()
    ]
    n = min(one.strokes for one in skill.values())
    few = f"; {n} trial{'s' if n > 1 else ''}: no interval" if n < FEWEST else ""
    return (
        f"Skill, 1 − RMSE over that of the best rival (null model, unfitted set, black boxes fitted to {fitted}"
        f"{few}): {', '.join(of)}.",
    )


MOST_NAMED = 4


def _domain_lines(action: str, places: pd.DataFrame, known: bool) -> list[str]:
    """Where the trials that were not fitted lie, in sentences."""
    if not known:
        return [
            f"Domain: not known, {action} does not say what the strokes it was fitted to were like; identify it again."
        ]
    held = places[~places["fitted"]]
    outside, inside = held[held["outside"].eq(True)], held[held["outside"].eq(False)]
    lines = []
    if len(outside):
        parts = [f"{row.trial} ({row.why_outside}{_far(row.distance)})" for row in outside.itertuples()]
        more = f" and {len(parts) - MOST_NAMED} more" if len(parts) > MOST_NAMED else ""
        lines.append(
            f"Domain: trial{'s' if len(parts) > 1 else ''} {', '.join(parts[:MOST_NAMED])}{more}: outside of what was "
            "fitted, where nothing says how well the model does."
        )
    if len(inside):
        named = ", ".join(map(str, inside["trial"].iloc[:MOST_NAMED]))
        more = f" and {len(inside) - MOST_NAMED} more" if len(inside) > MOST_NAMED else ""
        lines.append(
            f"Domain: trial{'s' if len(inside) > 1 else ''} {named}{more}: inside of what was fitted (distance at most "
            f"{inside['distance'].max():.1f}, 1 is the limit)."
        )
    return lines


def _far(distance: float) -> str:
    return f"; distance {distance:.1f}" if np.isfinite(distance) else ""


def nearer(errors: pd.DataFrame, without: Collection[tuple[int, str]] = ()) -> str:
    """What the headline says of rivals; empty where the model is nearer in every channel.

    Conventions: RMSE in rad, paired by trial; a channel is named where a rival's pooled RMSE is the smaller one, the
    best with its figures. A claim at 5 % needs the sign flips of all channels together
    (`validation.statistics.model_comparison.joint_sign_flip`), which six trials allow.
    """
    counts = errors[[pair not in without for pair in zip(errors["trial"], errors["channel"], strict=True)]]
    parts = []
    for channel, part in counts.groupby("channel", sort=False):
        found = []
        for rival in RIVALS:
            pairs = part[["rmse_rad", f"{rival}_rmse_rad"]].dropna().to_numpy(dtype=float)
            if len(pairs):
                model, other = np.degrees(np.sqrt(np.mean(pairs**2, axis=0)))
                closer = int((pairs[:, 1] < pairs[:, 0]).sum())
                found += [(other, model, closer, len(pairs), rival)] if other < model else []
        if not found:
            continue
        other, model, closer, n, rival = min(found)
        shown = (
            "shown at 5 %"
            if _shown(counts, rival, str(channel))
            else f"{n} trial{'s do' if n > 1 else ' does'} not show it"
        )
        also = [CALLED[name] for *_, name in sorted(found)[1:]]
        parts.append(
            f"{channel} {CALLED[rival]} (RMSE {other:.2g}° against {model:.2g}°, in {closer} of {n} trials; {shown})"
            + (f", also {' and '.join(also)}" if also else "")
        )
    return f"Nearer than the model: in {'; in '.join(parts)}." if parts else ""


def _shown(counts: pd.DataFrame, rival: str, channel: str) -> bool:
    """Whether that a rival is nearer in a channel is shown at 5 %, all channels taken together."""
    names = ["rmse_rad", f"{rival}_rmse_rad"]
    known = counts.dropna(subset=names)
    wide = known.pivot_table(index="trial", columns="channel", values=names)
    wide = wide.dropna() if len(wide.dropna()) else wide
    difference = wide[names[1]] - wide[names[0]]
    if not difference.notna().all(axis=None):
        return False
    p = joint_sign_flip(difference.to_numpy(dtype=float))
    return bool(p[list(difference.columns).index(channel)] <= LEVEL)


def _black_boxes(
    trials: Collection[MeasuredTrial], tested: ModelUnderTest, posterior: Posterior | None, faulty: Collection[int]
) -> dict[int, dict[str, BlackBox]]:
    """For each trial the black boxes fitted to the set's strokes, or to the other trials without faults."""
    nothing: dict[int, dict[str, BlackBox]] = {m.number: {} for m in trials}
    if not {"polynomial", "fir"} & set(tested.rivals):
        return nothing
    if posterior is not None and posterior.black_boxes:
        made = {kind: BlackBox.of(plain, tested.action.origin) for kind, plain in posterior.black_boxes.items()}
        return {m.number: made for m in trials}
    sound = [m for m in trials if m.number not in faulty and m.has_force]
    found = left_out_boxes([stroke_example(m) for m in sound])
    return nothing | {m.number: boxes for m, boxes in zip(sound, found, strict=True)}


def _unfitted(tested: ModelUnderTest, posterior: Posterior | None) -> ModelUnderTest | None:
    if posterior is None or not posterior.before or "unfitted" not in tested.rivals:
        return None
    before = tested.action.with_values(dict(posterior.before))
    return replace(tested, action=before, rivals=())


def _places(trials: Collection[MeasuredTrial], posterior: Posterior | None) -> pd.DataFrame:
    """Where each trial lies beside those the action was fitted to."""
    rows = []
    for m in trials:
        fitted = posterior is not None and m.seal in set(posterior.trials.values())
        where = place(stroke_features(m), list(posterior.strokes.values())) if posterior is not None else None
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


def _skills(table: pd.DataFrame, places: pd.DataFrame, without: Collection[tuple[int, str]]) -> dict[str, Skill]:
    fitted = set(places["trial"][places["fitted"]])
    out = {}
    for channel, part in table.groupby("channel", sort=False):
        counts = part[[(number, channel) not in without for number in part["trial"]]]
        held = counts[~counts["trial"].isin(fitted)]
        counts = held if len(held) else counts
        rivals = {name: counts[f"{name}_rmse_rad"].to_numpy(dtype=float) for name in RIVALS}
        skill = skill_of(counts["rmse_rad"].to_numpy(dtype=float), rivals)
        if skill is not None:
            out[str(channel)] = skill
    return out


def _rms(away: Array) -> float:
    known = away[np.isfinite(away)]
    return float(np.sqrt(np.mean(known**2))) if known.size else float("nan")
