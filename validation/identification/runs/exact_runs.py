"""The project's model as a `Response`, with exact derivatives integrated beside each stroke (`model.sensitivities`).

Curves and force columns are those of `model_runs`; a derivative costs about as much as a third of a run, and has
no step to choose. A parameter that does nothing in the scene has a column of zeros.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Any

import numpy as np

import model
from model.errors import InputError, ModelError
from model.sensitivity.parameter_names import directions
from validation.conventions import BODIES, Array
from validation.identification.observations import ObservedTrial
from validation.identification.runs.model_runs import Case, ModelRuns
from validation.identification.runs.own import Own
from validation.identification.runs.placed import TOLERANCE, PlacedRuns
from validation.identification.unknowns.priors import Parameter
from validation.prediction.elsewhere import spread

MOTION, TANGENT = 1e-7, 1e-4
PROBE = 0.01  # of a prior standard uncertainty: the step that checks the derivatives
MISSED = 0.2  # of the change: derivatives that miss it by more are not used


@dataclass(frozen=True)
class Tangents:
    """A trial's derivatives to be computed, as plain data: the action as it is, names, errors of the force."""

    action: model.Action
    names: tuple[str, ...]
    case: Case
    trial: ObservedTrial


def tangents(task: Tangents) -> Array:
    """Derivatives (m, c, n) of a trial's channels, per SI unit or per relative change.

    Raises
    ------
    model.errors.ModelError
        The derivatives cannot be carried on.
    """
    options = model.SensitivityOptions(
        tolerance=MOTION,
        relative_tolerance=TANGENT,
        output_time_s=task.trial.model_time_s(),
        rest_input=task.case.preload_n(task.trial),
        events=False,
        allow_idle=True,
    )
    blow = task.trial.force_time_s, task.case.felt_n(task.trial)
    found = model.sensitivities(task.action, blow, task.names, options=options)
    turn = found.d_angles - found.d_rest[None]
    return np.stack([task.trial.seen(d[:, : len(BODIES)]) for d in np.moveaxis(turn, -1, 0)], axis=-1)


class ExactRuns(ModelRuns):
    """Exact derivatives; see `ModelRuns` for the parameters."""

    def __init__(
        self,
        action: model.Action,
        parameters: Sequence[Parameter],
        trials: Sequence[ObservedTrial],
        tolerance: float | None = None,
        executor: Executor | None = None,
    ) -> None:
        super().__init__(action, parameters, trials, TOLERANCE if tolerance is None else tolerance, executor)
        self.acting = [j for j, p in enumerate(self.parameters) if acting(action, p)]

    def jacobian(self, z: Array, which: Sequence[int], own: Sequence[Own] | None = None) -> list[Array]:
        """Derivatives with respect to z; see `Response`."""
        asked = [j for j in which if j in self.acting]
        by_runs = [j for j in which if not self.parameters[j].paths]
        at = self.places(z, own)
        names = tuple(self.parameters[j].name for j in asked)
        place = [list(which).index(j) for j in asked]
        try:
            found = [np.zeros((*t.change_rad.shape, len(which))) for t in self.trials]
            if asked:
                tasks = [
                    Tangents(self.action.with_values(case.changed), names, case, trial)
                    for case, trial in zip(self.cases(at, own), self.trials, strict=True)
                ]
                for out, here, columns in zip(found, at, spread(self.executor, tangents, tasks), strict=True):
                    out[:, :, place] = columns * self.units(asked, here)
            if by_runs:
                force = super().jacobian(z, by_runs, own)
                for out, columns in zip(found, force, strict=True):
                    out[:, :, [list(which).index(j) for j in by_runs]] = columns
        except ModelError:  # differences of runs go on where a tangent cannot
            found = []
        if found and derivatives_hold(self, at, own, list(which), found):
            return found
        return super().jacobian(z, which, own)


def derivatives_hold(
    runs: PlacedRuns[Any], at: Array, own: Sequence[Own] | None, which: list[int], jacobian: Sequence[Array]
) -> bool:
    """Whether a small step in all parameters at once does what the derivatives say.

    A tangent that steps over a layer in which friction turns round may grow without bound; a difference shows it.
    """
    step = np.zeros(at.shape[1])
    step[which] = PROBE * np.where(np.arange(len(which)) % 2, 1.0, -1.0)
    here, there = runs.there([at, at + step], own)
    if here is None or there is None:
        return False
    for k, derivative in enumerate(jacobian):
        moved, said = there[k] - here[k], derivative @ step[which]
        if np.sqrt(np.mean((moved - said) ** 2)) > MISSED * np.sqrt(np.mean(moved**2)) + runs.tolerance:
            return False
    return True


def acting(action: model.Action, parameter: Parameter) -> bool:
    """Whether a parameter changes any number of the scene."""
    if not parameter.paths:
        return False
    try:
        found = model.sensitivity.find_parameters(action, [parameter.name])
        directions(action, model.choice_of(action), found)
    except InputError:
        return False
    return True
