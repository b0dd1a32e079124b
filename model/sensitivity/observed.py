"""Derivatives of what is seen of a motion: functions of the state and of the parameters, differentiated along both.

A quantity y(q, v; p) changes with parameter j by dy = y_q dq/dp_j + y_v dv/dp_j + y_p. All three come from one central
difference in the direction (dq/dp_j, dv/dp_j, 1), so that any function of `model.observables` can be used as it is.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from model.parameters.action import Action
from model.sensitivity.parameter_names import Directions, Parameter, shifted

Array = NDArray[np.float64]
# rad and rad/s that a difference may move a coordinate: felt is pressed in by more; lengths and angles are smooth
SMALL_TURN, SMALL_SPEED = 1e-8, 1e-6
SMOOTH = 100.0


def step_of(parameter: Parameter, d_angle: Array, d_speed: Array, larger: float = 1.0) -> float:
    """Step of a difference in a parameter's unit along these derivatives (..., n)."""
    turn, speed = (float(np.max(np.abs(d), initial=0.0)) for d in (d_angle, d_speed))
    return larger * min(parameter.step, SMALL_TURN / max(turn, 1e-300), SMALL_SPEED / max(speed, 1e-300))


def total_slopes(
    action: Action,
    parameters: tuple[Parameter, ...],
    quantity: Callable[[Action, Array, Array], Array],
    state: tuple[Array, Array],
    slopes: tuple[Array, Array],
) -> Array:
    """Derivatives (m, P) of a smooth quantity (m,) of states (m, n), whose own are ``slopes``, (m, n, P) each."""
    angle, speed = state
    out = np.empty((len(angle), len(parameters)))
    for j, parameter in enumerate(parameters):
        d_angle, d_speed = slopes[0][:, :, j], slopes[1][:, :, j]
        h = step_of(parameter, d_angle, d_speed, SMOOTH)
        ends = [
            quantity(shifted(action, parameter, s * h), angle + s * h * d_angle, speed + s * h * d_speed)
            for s in (1.0, -1.0)
        ]
        out[:, j] = (ends[0] - ends[1]) / (2.0 * h)
    return out


def force_slopes(
    directions: Directions,
    forces: Callable[[Array, Array, Array], Array],
    state: tuple[Array, Array],
    slopes: tuple[Array, Array],
) -> Array:
    """Derivatives (m, c, P) of forces (m, c) that depend on states (m, n) and on a scene's parameter vector."""
    angle, speed = state
    vector = directions.scene.vector
    parts = []
    for j, parameter in enumerate(directions.parameters):
        d_angle, d_speed = (np.ascontiguousarray(slope[:, :, j]) for slope in slopes)
        h = step_of(parameter, d_angle, d_speed)
        ends = [
            forces(angle + s * h * d_angle, speed + s * h * d_speed, vector + s * h * directions.slope[j])
            for s in (1.0, -1.0)
        ]
        parts.append((ends[0] - ends[1]) / (2.0 * h))
    return np.stack(parts, axis=-1)
