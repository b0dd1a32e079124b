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
from validation.conventions import ENCODER_BODIES, ENCODER_CHANNELS, Array
from validation.identification.model_runs import ModelRuns
from validation.identification.observations import ObservedTrial


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
    measured = [t.change_rad for t in trials]
    out: dict[str, Any] = {}
    for name, action in actions.items():
        found = ModelRuns(action, (), trials, tolerance).curves([np.zeros(0)])[0]
        out[name] = None if found is None else _by_channel([m - f for m, f in zip(measured, found, strict=True)])
    null = [_null(next(iter(actions.values())), t, tolerance) for t in trials]
    known = [(m - f) for m, f in zip(measured, null, strict=True) if f is not None]
    out["null model"] = _by_channel(known) if known else None
    shapes = {m.shape for m in measured}
    if len(measured) > 1 and len(shapes) == 1:
        centre = np.mean(measured, axis=0)
        spread = _by_channel([m - centre for m in measured])
        inflate = float(np.sqrt(len(measured) / (len(measured) - 1)))
        out["scatter of trials"] = {name: inflate * value for name, value in spread.items()}
    return out


def _by_channel(differences: Sequence[Array]) -> dict[str, float]:
    together = np.sqrt(np.mean(np.concatenate(differences) ** 2, axis=0))
    return {name: float(v) for name, v in zip(ENCODER_CHANNELS, together, strict=True)}


def _null(action: model.Action, trial: ObservedTrial, tolerance: float) -> Array | None:
    try:
        rest = model.rest_state(action, force_n=trial.preload_n)
        found = model.null_model.simulate(
            action,
            trial.force_time_s,
            trial.force_n,
            tolerance=tolerance,
            output_time_s=trial.time_s,
            initial=rest,
        )
    except ModelError:
        return None
    return np.asarray(found.angle_rad[:, ENCODER_BODIES] - rest.angle_rad[ENCODER_BODIES])
