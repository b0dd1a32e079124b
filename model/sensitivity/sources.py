"""Which numbers of a scene each parameter changes, as the tangents read them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from model.integrators.tangents.loads import Sources
from model.kernels import layout as L
from model.scene.build import Scene
from model.scene.pressing import Command
from model.sensitivity.parameter_names import Directions, commands

Array = NDArray[np.float64]


def sources_of(directions: Directions) -> Sources:
    """Numbers that parameters change, and by how much a unit of each does; without those of a string's modes."""
    scene = directions.scene
    modes = int(scene.tables.offset[7]) + L.STRING_HEAD if len(scene.tables.string) else len(scene.vector)
    entry, column = np.nonzero(directions.slope[:, :modes].T)
    number, first = np.unique(entry, return_index=True)
    first_of_motion, end = scene.tables.offset[4:6]
    assert not np.any((number >= first_of_motion) & (number < end)), "a parameter changes the prescribed motion"
    place = np.full(len(directions.scene.vector), -1, dtype=np.int64)
    place[number] = np.arange(len(number))
    return Sources(
        number.astype(np.int64), np.append(first, len(entry)).astype(np.int64), column.astype(np.int64),
        np.ascontiguousarray(directions.slope[column, entry]), place,
    )  # fmt: skip


def modes_moved(directions: Directions, first: int, count: int) -> Array:
    """Change (3, K, P) of gains, stiffnesses, dampings of ``count`` modes, whose numbers begin at ``first``."""
    slope = directions.slope[:, first : first + 3 * count]
    return np.asarray(np.moveaxis(slope.reshape(len(slope), 3, count), 0, -1))


def _command_slopes(directions: Directions, found: Callable[[Command], Array], shape: tuple[int, ...]) -> Array:
    """Change (..., P) by parameters of what a command turns an input into; zeros of ``shape`` where none does."""
    out = np.zeros((*shape, len(directions.parameters)))
    for j, parameter in enumerate(directions.parameters):
        ends = commands(directions, j)
        if any(end != directions.scene.command for end in ends):
            out[..., j] = (found(ends[0]) - found(ends[1])) / (2.0 * parameter.step)
    return out


def input_slopes(directions: Directions, table: tuple[Array, Array], time_s: Array) -> Array:
    """Change (k - 1, 2, P) of the kernels' input at both ends between the times (k,) of its own table.

    ``table`` is the input of the run. Empty where no parameter changes how that becomes the kernels' input.
    """
    if directions.scene.command is None:
        return np.empty((0, 2, len(directions.parameters)))
    # between its points the input is straight: two times inside tell the ends, however near a kink lies
    inside = time_s[:-1, None] + np.diff(time_s)[:, None] * np.array([0.25, 0.75])

    def found(command: Command) -> Array:
        return np.asarray(np.interp(inside, *command.table(*table, False)))

    quarter = _command_slopes(directions, found, inside.shape)
    if not np.any(quarter):
        return np.empty((0, 2, len(directions.parameters)))
    rise = 0.5 * (quarter[:, 1] - quarter[:, 0])
    return np.stack([quarter[:, 0] - rise, quarter[:, 1] + rise], axis=1)


def rest_input_slopes(directions: Directions, value: float) -> Array:
    """Change (P,) of the kernels' input by parameters where the run's input rests at ``value``."""
    return _command_slopes(directions, lambda command: np.array(command.value(value)), ())


def places_of_gap(scene: Scene, contact: str) -> NDArray[np.int64]:
    """Places of the numbers that a contact's gap hangs on beside the angles: its surfaces, and all pivots."""
    first = int(scene.tables.offset[1]) + L.CONTACT_SIZE * scene.contacts.index(contact)
    pivots = L.GLOBALS + L.BODY_SIZE * np.arange(len(scene.bodies))[:, None] + [L.PIVOT_X, L.PIVOT_Y]
    return np.append(np.arange(first, first + L.K_A), pivots.ravel())
