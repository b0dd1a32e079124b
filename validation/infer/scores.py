"""How well values predict trials: the printed set, the identified one and the null model, beside the trials' scatter.

Conventions: root mean square difference by channel over the common phases, rad; the scatter is that of the trials of
one session about their mean at the same phase: a model driven by each trial's own force can be closer than it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

import model
from model.errors import ModelError
from validation.conventions import BODIES, ENCODER_BODIES, Array
from validation.errors import PredictionError, ValidationInputError
from validation.events.definitions import EVENTS
from validation.events.detect import find_events
from validation.infer.observations import CHANNEL_NAMES, ObservedTrial
from validation.infer.response import ModelResponse
from validation.measurement.geometry import motion_of
from validation.measurement.trial import MeasuredTrial
from validation.prediction.model_under_test import ModelUnderTest


def score(
    trials: Sequence[ObservedTrial], actions: Mapping[str, model.Action], tolerance: float
) -> dict[str, dict[str, Any]]:
    """Name of an action, ``null model`` or ``scatter of trials`` -> channel -> root mean square, rad, of measured less
    predicted angles of ``trials``, of the last about their mean; None in place of channels where a model cannot run.

    Parameters
    ----------
    actions : name -> action
    tolerance : largest error of any angle of a run, rad

    Returns
    -------
    dict
        Name of an action, ``null model`` or ``scatter of trials`` -> channel -> rad; None where it cannot run.
    """
    out: dict[str, Any] = {}
    for name, action in actions.items():
        found = ModelResponse(action, (), trials, tolerance).curves([np.zeros(0)])[0]
        out[name] = None if found is None else rmse_by_channel(trials, found)
    null = [_run_null_model(next(iter(actions.values())), t, tolerance) for t in trials]
    known = [(t, f) for t, f in zip(trials, null, strict=True) if f is not None]
    out["null model"] = rmse_by_channel([t for t, _ in known], [f for _, f in known]) if known else None
    centres: list[tuple[ObservedTrial, Array]] = []
    freedom = 0
    for session in sorted({t.session for t in trials}):  # each its own kind of stroke, at phases of its own
        alike = [t for t in trials if t.session == session]
        if len(alike) > 1 and len({(t.change_rad.shape, t.channels) for t in alike}) == 1:
            measured = [t.change_rad for t in alike]
            centre = np.nansum(measured, axis=0) / np.maximum(np.isfinite(measured).sum(axis=0), 1)
            centres += [(t, centre) for t in alike]
            freedom += len(alike) - 1
    if centres:
        spread = rmse_by_channel(*map(list, zip(*centres, strict=True)))
        inflate = float(np.sqrt(len(centres) / freedom))
        out["scatter of trials"] = {name: inflate * value for name, value in spread.items()}
    return out


RISES = 1.02  # an RMSE that is larger by less says nothing


def explain_rising_rmse(
    before: Mapping[str, float], found: Mapping[str, float], whole: Mapping[str, float]
) -> list[str]:
    """Line for each channel whose RMSE with the identified values, ``found``, is over 2 % larger than ``before`` the
    fit (both channel -> rad), with a possible reason; ``whole``: with the errors of drive and sensors fitted beside
    them."""
    lines = []
    for channel in (c for c in found if found[c] > RISES * before[c]):
        from_, to, beside = (f"{np.degrees(by[channel]):.2g}°" for by in (before, found, whole))
        why = "values and errors belong together"
        if whole[channel] > RISES * before[channel]:
            why = (
                "the fit weighs each phase by what noise, scatter and the model's lack may do there, and gives up some "
                "for others; look at the residuals before the values are used"
            )
        lines.append(
            f"the {channel}'s RMSE rises from {from_} to {to} by the identified values alone; with the errors of "
            f"what drives the strokes, found beside them, it is {beside}: {why}"
        )
    return lines


def rmse_by_channel(trials: Sequence[ObservedTrial], curves: Sequence[Array]) -> dict[str, float]:
    """Channel -> root mean square, rad, of measured less predicted angles over the trials that have it, without samples
    that a film lost; ``curves``: predicted angles (m, c), rad, of each trial."""
    out = {}
    for c, name in enumerate(CHANNEL_NAMES):
        apart = [
            (t.change_rad - f)[:, t.channels.index(c)] for t, f in zip(trials, curves, strict=True) if c in t.channels
        ]
        known = np.concatenate([d[np.isfinite(d)] for d in apart]) if apart else np.empty(0)
        if known.size:
            out[name] = float(np.sqrt(np.mean(known**2)))
    return out


def _run_null_model(action: model.Action, trial: ObservedTrial, tolerance: float) -> Array | None:
    """Channels (m, c), rad since rest, that the null model predicts of a trial driven by its force; None where it
    cannot run, or the key drives the trial."""
    if trial.key is not None:  # the null model moves as the key does: it has nothing to say under its motion
        return None
    try:
        rest = model.rest_state(action, force_n=trial.preload_n)
        found = model.null_model.simulate(
            action,
            trial.force_time_s,
            trial.force_n,
            tolerance=tolerance,
            output_time_s=trial.model_time_s(),
            initial=rest,
        )
    except ModelError:
        return None
    return trial.seen(np.asarray(found.angle_rad[:, : len(BODIES)] - rest.angle_rad[: len(BODIES)]))


NULL = "null model"
CEILING = "scatter of trials"
SHOWN = ("string_impact", "hammer_speed", "check_height", "key_release")


@dataclass(frozen=True)
class EventScore:
    """How one event is met."""

    difference: float  # mean of model minus trial, in the unit of the event; NaN where it never happens in both
    rms: float  # root mean square of the same
    # both, trials: in how many trials it happens in both, in how many in the trial
    both: int
    trials: int


def score_events(
    trials: Sequence[MeasuredTrial], actions: Mapping[str, model.Action], tolerance: float
) -> dict[str, dict[str, EventScore]]:
    """Name of an action, ``null model`` or ``scatter of trials`` → event of `SHOWN` → `EventScore`, model less trial in
    the event's unit over ``trials``, each run under its force; of the last their standard deviation.

    Conventions: difference model minus trial, mean over the trials in which the event happens in both; ``ceiling`` is
    the standard deviation of the trials' own values: each trial's force drives the model, so that one can come closer
    than it, but no closer than the sensors read. Curves are scored by `validation.infer.scores`.

    Parameters
    ----------
    actions : name -> action
    tolerance : largest error of any angle of a run, rad
    """
    runs: dict[str, tuple[ModelUnderTest, Callable[..., model.Solution]]] = {
        name: (ModelUnderTest(action, tolerance), model.simulate) for name, action in actions.items()
    }
    own, _ = next(iter(runs.values()))
    runs[NULL] = (own, model.null_model.simulate)
    measured = [_events(own, m, m.time_s, m.change_rad, m.u_rad) for m in trials]
    out: dict[str, dict[str, EventScore]] = {}
    for name, (tested, simulate) in runs.items():
        predicted = [_predict_events(tested, m, simulate) for m in trials]
        out[name] = {event: _score_event(event, predicted, measured) for event in SHOWN}
    values = {event: np.array([one[event] for one in measured]) for event in SHOWN}
    out[CEILING] = {event: _scatter(values[event]) for event in SHOWN}
    return out


def _predict_events(
    tested: ModelUnderTest, m: MeasuredTrial, simulate: Callable[..., model.Solution]
) -> dict[str, float]:
    """Event of `SHOWN` -> value that ``simulate`` (the model's or the null model's) predicts of a trial under its
    measured force; NaN where it does not happen, all NaN where it cannot run."""
    time = m.time_s[(m.time_s >= m.force.time_s[0]) & (m.time_s <= m.force.time_s[-1])]
    nothing = dict.fromkeys(SHOWN, float("nan"))
    try:
        rest = tested.load(m.force.preload_n).rest
        found = simulate(
            tested.action,
            m.force.time_s,
            m.force.force_n,
            tolerance=tested.tolerance,
            output_time_s=time,
            initial=rest,
        )
        change = (np.asarray(found.angle_rad) - np.asarray(rest.angle_rad))[:, ENCODER_BODIES]
        return _events(tested, m, time, change, np.full(3, tested.tolerance))
    except (ModelError, PredictionError, ValidationInputError):
        return nothing


def _events(tested: ModelUnderTest, m: MeasuredTrial, time: Array, change: Array, u: Array) -> dict[str, float]:
    motion = motion_of(tested.geometry_at(m.force.preload_n), time, change, u)
    found = find_events(motion, m.quiet.stop)
    return {name: found[name].value for name in SHOWN}


def _score_event(event: str, predicted: Sequence[dict[str, float]], measured: Sequence[dict[str, float]]) -> EventScore:
    """Mean and root mean square of predicted less measured values of one event over trials (each name -> value, NaN
    where it does not happen), with how many have it in both, and in the measurement."""
    trial = np.array([one[event] for one in measured])
    apart = np.array([one[event] for one in predicted]) - trial
    known = apart[np.isfinite(apart)]
    happened = int(np.isfinite(trial).sum())
    if not known.size:
        return EventScore(float("nan"), float("nan"), 0, happened)
    return EventScore(float(known.mean()), float(np.sqrt(np.mean(known**2))), int(known.size), happened)


def _scatter(values: Array) -> EventScore:
    known = values[np.isfinite(values)]
    spread = float(np.std(known, ddof=1)) if known.size > 1 else float("nan")
    return EventScore(0.0 if known.size > 1 else float("nan"), spread, int(known.size), int(known.size))


def event_words(event: str) -> tuple[str, float, str]:
    """How an event is called and shown: title, factor, unit."""
    kind = EVENTS[event]
    return kind.title, kind.display_factor, kind.display_unit
