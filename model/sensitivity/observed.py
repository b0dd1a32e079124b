"""Derivatives of observables along a motion: by the state and by the parameters.

A quantity y(q, v; p) changes with parameter j by dy = y_q dq/dp_j + y_v dv/dp_j + y_p. The first two are gradients, one
for all parameters; the last is asked for only where the quantity reads a value that the parameter changes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from model.parameters.action import Action
from model.sensitivity.parameter_names import LENGTH_STEP, Directions, Parameter, as_action_type, shift_parameter

Array = NDArray[np.float64]
SMALL_SPEED = 1e-6  # rad/s that a difference may change a speed by; by `LENGTH_STEP` it may turn a coordinate
# where nothing but lengths and angles matter: a speed, itself a difference, would be rounded away in smaller steps
SMOOTH_TURN, SMOOTH_SPEED, SMOOTH_STEPS = 1e-4, 1e-2, 1e3


def difference_step(parameter: Parameter, d_angle: Array, d_speed: Array, smooth: bool) -> float:
    """Step of a difference in a parameter's unit along these derivatives (..., n), of what is ``smooth`` or presses."""
    most, turns, speeds = (SMOOTH_STEPS, SMOOTH_TURN, SMOOTH_SPEED) if smooth else (1.0, LENGTH_STEP, SMALL_SPEED)
    turn, speed = (float(np.max(np.abs(d), initial=0.0)) for d in (d_angle, d_speed))
    return min(most * parameter.step, turns / max(turn, 1e-300), speeds / max(speed, 1e-300))


def gradient(value: Callable[[Array], Array], at: Array, step: float) -> Array:
    """Derivatives (n,) of a smooth function of points (m, n) at one of them (n,), by central differences."""
    ways = step * np.eye(len(at))
    ends = value(np.concatenate([at + ways, at - ways]))
    return np.asarray((ends[: len(at)] - ends[len(at) :]) / (2.0 * step))


def state_derivatives(quantity: Callable[[Array, Array], Array], state: tuple[Array, Array]) -> tuple[Array, Array]:
    """Derivatives (n,) of a smooth quantity (m,) of states (m, n) by the angles and by the speeds of one, (n,) each."""
    angle, speed = state
    many = np.ones((2 * len(angle), 1))
    by_angle = gradient(lambda q: quantity(q, many * speed), angle, SMOOTH_TURN)
    by_speed = gradient(lambda v: quantity(many * angle, v), speed, SMOOTH_SPEED)
    return by_angle, by_speed


class _RecordingAction(Action):
    """An action that notes which of its values are asked for."""

    def __getitem__(self, path: str) -> float:
        self.__dict__["read"].add(path)
        return super().__getitem__(path)


def paths_read(action: Action, quantity: Callable[[Action], object]) -> set[str]:
    noting = as_action_type(_RecordingAction, action)
    noting.__dict__["read"] = set()
    quantity(noting)
    return set(noting.__dict__["read"])


def parameter_derivatives(
    action: Action, parameters: Sequence[Parameter], quantity: Callable[[Action], float]
) -> Array:
    """Derivatives (P,) by each parameter of ``quantity``, a smooth function of an action's lengths and angles."""
    read = paths_read(action, quantity)
    out = np.zeros(len(parameters))
    for j, parameter in enumerate(parameters):
        if read & parameter.paths.keys():
            h = SMOOTH_STEPS * parameter.step
            out[j] = (
                quantity(shift_parameter(action, parameter, h)) - quantity(shift_parameter(action, parameter, -h))
            ) / (2.0 * h)
    return out


def observable_derivatives(
    directions: Directions,
    quantity: Callable[..., Array],
    state: tuple[Array, ...],
    slopes: tuple[Array, ...],
    smooth: bool = False,
) -> Array:
    """Derivatives (..., P) by the parameters of ``quantity(*state, vector)``: ``state`` are angles (m, n), speeds (m,
    n) and more, ``slopes`` their derivatives, parameters last; ``smooth``: no felt takes part."""
    parts = []
    for j, parameter in enumerate(directions.parameters):
        along = [slope[..., j] for slope in slopes]
        h = difference_step(parameter, along[0], along[1], smooth)
        ends = [
            quantity(
                *(x + s * h * d for x, d in zip(state, along, strict=True)),
                directions.scene.vector + s * h * directions.slope[j],
            )
            for s in (1.0, -1.0)
        ]
        parts.append((ends[0] - ends[1]) / (2.0 * h))
    return np.stack(parts, axis=-1)
