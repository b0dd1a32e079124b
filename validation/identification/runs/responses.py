"""The model's response to trials of any kind, in their order: those that a force drives, those that the key drives."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor

import numpy as np

import model
from validation.conventions import Array
from validation.identification.observations import ObservedTrial
from validation.identification.runs.exact_runs import ExactRuns
from validation.identification.runs.model_runs import Response
from validation.identification.runs.motion_runs import MotionRuns
from validation.identification.runs.own import Own
from validation.identification.runs.placed import TOLERANCE
from validation.identification.unknowns.priors import Parameter


class MixedRuns:
    """Responses of two kinds of trials as one; see `model_runs.Response`."""

    def __init__(self, parts: Sequence[tuple[Sequence[int], Response]]) -> None:
        self.parts = [(list(places), response) for places, response in parts]
        self.size = sum(len(places) for places, _ in self.parts)

    def curves(self, points: Sequence[Array], own: Sequence[Sequence[Own]] | None = None) -> list[list[Array] | None]:
        """Curves of every trial at each point; None where a trial of either kind cannot run."""
        found = [
            response.curves(points, None if own is None else [[o[k] for k in places] for o in own])
            for places, response in self.parts
        ]
        return [
            None if any(part[i] is None for part in found) else self._joined([part[i] for part in found])
            for i in range(len(points))
        ]

    def jacobian(self, z: Array, which: Sequence[int], own: Sequence[Own] | None = None) -> list[Array]:
        """Derivatives of every trial."""
        return self._joined([response.jacobian(z, which, _those(places, own)) for places, response in self.parts])

    def force_columns(self, z: Array, own: Sequence[Own] | None = None) -> list[Array]:
        """Columns of what each trial has of its own."""
        return self._joined([response.force_columns(z, _those(places, own)) for places, response in self.parts])

    def _joined(self, parts: Sequence[list[Array] | None]) -> list[Array]:
        out: list[Array] = [np.empty(0)] * self.size
        for (places, _), curves in zip(self.parts, parts, strict=True):
            assert curves is not None
            for place, curve in zip(places, curves, strict=True):
                out[place] = curve
        return out


def _those(places: Sequence[int], own: Sequence[Own] | None) -> list[Own] | None:
    return None if own is None else [own[k] for k in places]


def response_to(
    action: model.Action,
    parameters: Sequence[Parameter],
    trials: Sequence[ObservedTrial],
    tolerance: float | None = None,
    executor: Executor | None = None,
) -> Response:
    """The project's model as it answers to these trials.

    Parameters
    ----------
    action : its values are z = 0
    parameters : what z moves, and after that laws which are fixed, but may be others in single trials
    trials : of either kind
    tolerance : largest error of any angle of a run, rad
    executor : where to compute; by default threads of this process
    """
    limit = TOLERANCE if tolerance is None else tolerance
    by_force = [k for k, t in enumerate(trials) if t.key is None]
    by_key = [k for k, t in enumerate(trials) if t.key is not None]
    if not by_key:
        return ExactRuns(action, parameters, trials, limit, executor)
    driven = MotionRuns(action, parameters, [trials[k] for k in by_key], limit, executor)
    if not by_force:
        return driven
    forced = ExactRuns(action, parameters, [trials[k] for k in by_force], limit, executor)
    return MixedRuns([(by_force, forced), (by_key, driven)])
