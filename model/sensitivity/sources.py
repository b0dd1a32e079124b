"""Which numbers of a scene each parameter changes, as the tangents read them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from model.integrators.tangents.loads import Sources
from model.kernels import layout as L
from model.scene.build import Scene
from model.sensitivity.parameter_names import Directions


def sources_of(directions: Directions) -> Sources:
    """Numbers that parameters change, and by how much a unit of each does."""
    entry, column = np.nonzero(directions.slope.T)
    number, first = np.unique(entry, return_index=True)
    assert not len(number) or number[-1] < _moving(directions.scene), "a parameter changes the prescribed motion"
    place = np.full(len(directions.scene.vector), -1, dtype=np.int64)
    place[number] = np.arange(len(number))
    return Sources(
        number.astype(np.int64), np.append(first, len(entry)).astype(np.int64), column.astype(np.int64),
        np.ascontiguousarray(directions.slope[column, entry]), place,
    )  # fmt: skip


def _moving(scene: Scene) -> int:
    """Where the prescribed motion's numbers begin, which no parameter changes; the end where there is none."""
    return int(scene.tables.offset[4]) if np.any(scene.tables.prescribed) else len(scene.vector)


def places_of_gap(scene: Scene, contact: str) -> NDArray[np.int64]:
    """Places of the numbers that a contact's gap hangs on beside the angles: its surfaces, and all pivots."""
    first = int(scene.tables.offset[1]) + L.CONTACT_SIZE * scene.contacts.index(contact)
    pivots = L.GLOBALS + L.BODY_SIZE * np.arange(len(scene.bodies))[:, None] + [L.PIVOT_X, L.PIVOT_Y]
    return np.append(np.arange(first, first + L.K_A), pivots.ravel())
