"""Converged differences of whole simulations: what derivatives are checked against."""

from __future__ import annotations

from typing import Any

import numpy as np

import model
from model.sensitivity import find_parameters

TIGHT = 1e-11
Blow = tuple[np.ndarray, np.ndarray]


def changed(action: model.Action, name: str, by: float) -> model.Action:
    """The action with a parameter changed by that much of its unit."""
    (parameter,) = find_parameters(action, [name])
    return action.with_values({path: action[path] + by * weight for path, weight in parameter.paths.items()})


def richardson(action: model.Action, blow: Blow, name: str, step: float, **given: Any) -> tuple[np.ndarray, float]:
    """Derivatives (m, n) of the angles from two central differences, and how far the finer is from their limit.

    ``step`` is the coarse one, in the parameter's unit; ``given`` goes to `model.simulate`.
    """
    given = {"tolerance": TIGHT, "method": "rodas5p"} | given
    central = []
    for h in (step, 0.5 * step):
        ends = [model.simulate(changed(action, name, s * h), *blow, **given).angle_rad for s in (1.0, -1.0)]
        central.append((ends[0] - ends[1]) / (2.0 * h))
    limit = (4.0 * central[1] - central[0]) / 3.0
    return limit, float(np.max(np.abs(central[1] - limit)) / np.max(np.abs(limit)))


def relative_error(found: np.ndarray, limit: np.ndarray) -> float:
    """Largest difference of any angle's derivative (m, n) from its limit, of that angle's largest derivative."""
    return float(np.max(np.max(np.abs(found - limit), axis=0) / np.max(np.abs(limit), axis=0)))
