"""The ceiling of every score: what a perfect model would reach, which knows each trial's force as it was measured.

Conventions: the prediction stands for the truth; the trial is drawn from it with errors of force (gain, preload, delay,
offset, noise) and sensors (scale, interpolation, quantisation, film) of the declared size, common to the session or to
a trial as they are (`validation.prediction.joint_draws`); it is scored at the same samples as the recorded one.
With 19 draws a perfect model scores worse than all of them in 5 % of sessions.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from validation.conventions import CHANNEL_GROUPS, LEVEL, Array
from validation.measurement.trial import MeasuredTrial
from validation.prediction.joint_draws import (
    CHANNELS,
    JointDraw,
    chosen_trials,
    joint_draws,
    run_draws,
    session_seed,
)
from validation.prediction.model_under_test import ModelUnderTest
from validation.scores.curve_scores import SCORES, compute_scores, pool_score
from validation.scores.traces import SessionTraces, select_scored_angles

DRAWS = round(1.0 / LEVEL) - 1  # a right model is worse than all of them once in twenty
MOVED = "moved_"
PAIRED_SCORES = ("rmse_rad", "before_impact_rmse_rad", "iso_overall")
NUISANCE_COLUMNS = ["trial", "channel", "draw", *PAIRED_SCORES]
NOT_MADE = "not judged: no ceiling was made"
INSIDE, OUTSIDE = "indistinguishable from a perfect model", "worse than a perfect model"


@dataclass(frozen=True)
class Ceiling:
    """Scores of a perfect model: (channel, score) → one pooled value per draw; the trials they are made from.

    ``nuisance``: scores of the recorded trials when the model's force and the sensors are as drawn: trial, channel,
    draw, `PAIRED_SCORES`. The draws are the same for every model of a session.
    """

    scores: Mapping[tuple[str, str], Array] = field(default_factory=dict)
    trials: tuple[int, ...] = ()
    nuisance: pd.DataFrame = field(default_factory=lambda: pd.DataFrame(columns=NUISANCE_COLUMNS))

    def row(self, channel: str, score: str, value_of_same: float) -> dict[str, object]:
        """Cells of the score card for one channel and score: median and range over draws of a perfect model's score,
        number of draws, and whether ``value_of_same``, the model's score in the same trials, is worse than all of them.
        """
        known = self.scores.get((channel, score), np.empty(0))
        known = known[np.isfinite(known)]
        if not known.size:
            nan = float("nan")
            return {"ceiling": nan, "ceiling_low": nan, "ceiling_high": nan, "ceiling_draws": 0, "reading": NOT_MADE}
        low, high = float(known.min()), float(known.max())
        worse = value_of_same > high if SCORES[score].better == "lower" else value_of_same < low
        reading = (OUTSIDE if worse else INSIDE) if np.isfinite(value_of_same) else NOT_MADE
        return {
            "ceiling": float(np.median(known)),
            "ceiling_low": low,
            "ceiling_high": high,
            "ceiling_draws": int(known.size),
            "reading": reading,
        }


@dataclass(frozen=True)
class _Curve:
    """One recorded curve and its prediction, inside the window."""

    channel: int
    time_s: Array
    lost: NDArray[np.bool_]
    measured: Array
    predicted: Array
    early: NDArray[np.bool_]


def score_perfect_model(
    trials: Sequence[MeasuredTrial],
    traces: SessionTraces,
    tested: ModelUnderTest,
    without: Collection[tuple[int, str]] = (),
    *,
    paired: bool = False,
) -> Ceiling:
    """Scores of a perfect model: some trials drawn from their predictions with errors of force and sensors, pooled by
    channel and score, one value a draw; pairs (trial, channel) ``without`` do not count. Simulates, unless stored.

    With ``paired`` the recorded trials are also scored against each draw, which only a comparison of models needs.
    """
    chosen = chosen_trials(trials, without)
    seed = session_seed(trials)
    draws = joint_draws(tested.action, seed, DRAWS, parameters=False)
    pooled: dict[tuple[str, str], list[list[float]]] = {}
    nuisance: list[dict[str, object]] = []
    curves = [_select_curves(m, traces, without) for m in chosen]
    every = tested.store.values(
        "perfect model",
        [
            (tested.identity, seed, DRAWS, paired, m.number, m.force, sensors, m.film, of_trial, m.driven_by_key)
            for m, of_trial in zip(chosen, curves, strict=True)
            for sensors in [(m.u_rad, m.resolution_rad, m.scale_relative_u, m.sensors and m.sensors.calibration)]
        ],
        lambda missing: _score_draws(tested, [(chosen[i], curves[i]) for i in missing], draws, paired),
    )
    for m, found in zip(chosen, every, strict=True):
        for i, of_draw in enumerate(found):
            for name, scores in of_draw.items():
                for score in SCORES:
                    pooled.setdefault((name, score), [[] for _ in draws])[i].append(scores[score])
                if paired:
                    moved = {score: scores[f"{MOVED}{score}"] for score in PAIRED_SCORES}
                    nuisance.append({"trial": m.number, "channel": name, "draw": i, **moved})
    values = {
        (name, score): np.array([pool_score(score, np.array(v)) if v else np.nan for v in of_draw])
        for (name, score), of_draw in pooled.items()
    }
    return Ceiling(values, tuple(m.number for m in chosen), pd.DataFrame(nuisance, columns=NUISANCE_COLUMNS))


def _score_draws(
    tested: ModelUnderTest,
    trials: Sequence[tuple[MeasuredTrial, Sequence[_Curve]]],
    draws: Sequence[JointDraw],
    paired: bool,
) -> list[list[dict[str, dict[str, float]]]]:
    """Scores of the predictions against drawn trials, nested trial → draw → channel → score; a draw that cannot be run
    is empty. With ``paired`` also the recorded trials' scores against the draw, named ``moved_…``."""
    times = [np.unique(np.concatenate([c.time_s for c in curves])) if curves else np.empty(0) for _, curves in trials]

    def scores(i: int, read: Array) -> dict[str, dict[str, float]]:
        out = {}
        for c in trials[i][1]:
            trial = np.where(c.lost, np.nan, read[np.searchsorted(times[i], c.time_s), c.channel])
            reached = compute_scores(c.time_s, trial, c.predicted, c.early)
            values = {name: float(reached[name]) for name in SCORES}
            if paired:
                moved = compute_scores(c.time_s, c.measured, trial, c.early)
                values |= {f"{MOVED}{name}": float(moved[name]) for name in PAIRED_SCORES}
            out[CHANNELS[c.channel]] = values
        return out

    found = run_draws(tested, [(m, time) for (m, _), time in zip(trials, times, strict=True)], draws, scores)
    return [[one or {} for one in of_trial] for of_trial in found]


def _select_curves(m: MeasuredTrial, traces: SessionTraces, without: Collection[tuple[int, str]]) -> list[_Curve]:
    """Measured and predicted curves, rad, of a trial's encoders and film inside the window, one a channel, with times,
    lost samples and those before the impact; without the pairs (trial, channel) ``without``."""
    out = []
    for names, source in CHANNEL_GROUPS:
        frame = traces.select_source(source).get(m.number)
        if frame is None:
            continue
        part: pd.DataFrame = frame[traces.window.mask(frame["time_s"].to_numpy())]
        time = part["time_s"].to_numpy()
        for name in names:
            if (m.number, name) not in without:
                measured, predicted = select_scored_angles(part, name), part[f"{name}_predicted_rad"].to_numpy()
                early = time < traces.impact_s.get(m.number, np.inf)
                out.append(_Curve(CHANNELS.index(name), time, ~np.isfinite(measured), measured, predicted, early))
    return out
