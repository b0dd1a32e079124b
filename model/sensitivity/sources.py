"""Which numbers of a scene each parameter changes, and by how much, for the tangents."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from model.integrators.tangents.parameter_loads import Sources
from model.kernels import layout as L
from model.scene.build import Scene
from model.scene.pressing import Command
from model.sensitivity.parameter_names import SHARE_STEP, Directions, shifted_commands

Array = NDArray[np.float64]


def find_sources(directions: Directions) -> Sources:
    """Entries of the scene's vector that parameters change, with the derivatives of each by each parameter; those of a
    string's modes are left out."""
    scene = directions.scene
    modes = int(scene.tables.offset[7]) + L.STRING_HEAD if len(scene.tables.string) else len(scene.vector)
    entry, column = np.nonzero(directions.slope[:, :modes].T)
    number, first = np.unique(entry, return_index=True)
    assert np.all(number < (scene.tables.offset[4] or modes)), "a parameter changes the prescribed motion"
    place = np.full(len(directions.scene.vector), -1, dtype=np.int64)
    place[number] = np.arange(len(number))
    return Sources(
        number.astype(np.int64), np.append(first, len(entry)).astype(np.int64), column.astype(np.int64),
        np.ascontiguousarray(directions.slope[column, entry]), place,
    )  # fmt: skip


def mode_derivatives(directions: Directions, first: int, count: int) -> Array:
    """Change (3, K, P) of gains, stiffnesses, dampings of ``count`` modes, whose numbers begin at ``first``."""
    slope = directions.slope[:, first : first + 3 * count]
    return np.asarray(np.moveaxis(slope.reshape(len(slope), 3, count), 0, -1))


def _input_slopes(
    directions: Directions, kernel_input: Callable[[Command | None, Array], Array], value: Array, input_changes: Array
) -> Array:
    """Derivatives (..., P) of the kernels' input by parameters of the command and, last, along ``input_changes`` (k, m)
    of ``value`` (k,)."""
    own, count = directions.scene.command, len(directions.parameters) - input_changes.shape[1]
    out = np.zeros((*kernel_input(own, value).shape, len(directions.parameters)))
    for j, parameter in enumerate(directions.parameters[:count] if own is not None else ()):
        ends = shifted_commands(directions, j)
        if any(end != own for end in ends):
            out[..., j] = (kernel_input(ends[0], value) - kernel_input(ends[1], value)) / (2.0 * parameter.step)
    for j, change in enumerate(input_changes.T, count):
        step = SHARE_STEP * (1.0 + np.max(np.abs(value))) / max(float(np.max(np.abs(change))), 1e-300)
        out[..., j] = (kernel_input(own, value + step * change) - kernel_input(own, value - step * change)) / (
            2.0 * step
        )
    return out


def input_derivatives(directions: Directions, table: tuple[Array, Array], time_s: Array) -> Array:
    """Derivatives (k - 1, 2, P) of the kernels' input by the parameters, at both ends of each interval of ``time_s``
    (k,), its own table; ``table``: times, values of the run's input; (0, 2, P) where none acts."""
    moved = directions.inputs[0] if directions.inputs[0].size else np.empty((len(table[1]), 0))
    if directions.scene.command is None and not moved.size:
        return np.empty((0, 2, len(directions.parameters)))
    # between its points the input is straight: two times inside tell the ends, however near a kink lies
    inside = time_s[:-1, None] + np.diff(time_s)[:, None] * np.array([0.25, 0.75])

    def kernel_input(command: Command | None, value: Array) -> Array:
        given = (table[0], value)
        return np.asarray(np.interp(inside, *(given if command is None else command.table(*given, False))))

    quarter = _input_slopes(directions, kernel_input, table[1], moved)
    if not np.any(quarter):
        return np.empty((0, 2, len(directions.parameters)))
    rise = 0.5 * (quarter[:, 1] - quarter[:, 0])
    return np.stack([quarter[:, 0] - rise, quarter[:, 1] + rise], axis=1)


def rest_input_derivatives(directions: Directions, value: float) -> Array:
    def kernel_input(command: Command | None, value: Array) -> Array:
        return np.asarray(value[0] if command is None else command.value(float(value[0])))

    return _input_slopes(directions, kernel_input, np.array([value]), directions.inputs[1][None])


def gap_number_places(scene: Scene, contact: str) -> NDArray[np.int64]:
    """Indices in the scene's vector of the parameters that a contact's gap depends on: surfaces, all pivots."""
    first = int(scene.tables.offset[1]) + L.CONTACT_SIZE * scene.contacts.index(contact)
    pivots = L.GLOBALS + L.BODY_SIZE * np.arange(len(scene.bodies))[:, None] + [L.PIVOT_X, L.PIVOT_Y]
    return np.append(np.arange(first, first + L.K_A), pivots.ravel())
