"""How well values predict trials: the printed set, the identified one and the null model, beside the trials' scatter.

Conventions: root mean square difference by channel over the common phases, rad; the scatter is that of the trials of
one session about their mean at the same phase: a model driven by each trial's own force can be closer than it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

import model
from model.errors import ModelError
from validation.conventions import BODIES, Array
from validation.identification.observations import CHANNEL_NAMES, ObservedTrial
from validation.identification.runs.responses import response_to


def score(
    trials: Sequence[ObservedTrial], actions: Mapping[str, model.Action], tolerance: float
) -> dict[str, dict[str, Any]]:
    """Scores of some trials.

    Parameters
    ----------
    trials : sequence of ObservedTrial
    actions : name -> action
    tolerance : largest error of any angle of a run, rad

    Returns
    -------
    dict
        Name of an action, ``null model`` or ``scatter of trials`` -> channel -> rad; None where it cannot run.
    """
    out: dict[str, Any] = {}
    for name, action in actions.items():
        found = response_to(action, (), trials, tolerance).curves([np.zeros(0)])[0]
        out[name] = None if found is None else _by_channel(trials, found)
    null = [_null(next(iter(actions.values())), t, tolerance) for t in trials]
    known = [(t, f) for t, f in zip(trials, null, strict=True) if f is not None]
    out["null model"] = _by_channel([t for t, _ in known], [f for _, f in known]) if known else None
    measured = [t.change_rad for t in trials]
    if len(measured) > 1 and len({(m.shape, t.channels) for m, t in zip(measured, trials, strict=True)}) == 1:
        there = np.isfinite(measured).sum(axis=0)
        centre = np.nansum(measured, axis=0) / np.maximum(there, 1)
        spread = _by_channel(trials, [centre] * len(trials))
        inflate = float(np.sqrt(len(measured) / (len(measured) - 1)))
        out["scatter of trials"] = {name: inflate * value for name, value in spread.items()}
    return out


def _by_channel(trials: Sequence[ObservedTrial], curves: Sequence[Array]) -> dict[str, float]:
    """Root mean square difference by channel, of the trials that have it; what a film lost does not count."""
    out = {}
    for c, name in enumerate(CHANNEL_NAMES):
        apart = [
            (t.change_rad - f)[:, t.channels.index(c)] for t, f in zip(trials, curves, strict=True) if c in t.channels
        ]
        known = np.concatenate([d[np.isfinite(d)] for d in apart]) if apart else np.empty(0)
        if known.size:
            out[name] = float(np.sqrt(np.mean(known**2)))
    return out


def _null(action: model.Action, trial: ObservedTrial, tolerance: float) -> Array | None:
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
