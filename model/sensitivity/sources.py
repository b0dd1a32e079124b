"""Which numbers of a scene each parameter changes, sorted by what they are numbers of, as the kernels read them."""

from __future__ import annotations

from collections import Counter

import numpy as np
from numpy.typing import NDArray

from model.integrators.tangents.loads import BODY, CONTACT, DAMPER, DRIVE, GLOBAL, PROBE, SPRING, Sources
from model.kernels import layout as L
from model.scene.build import Scene
from model.sensitivity.parameter_names import Directions

_KINDS = (SPRING, CONTACT, DRIVE, PROBE, None, DAMPER)  # in the order in which their numbers lie
_SIZES = (L.SPRING_SIZE, L.CONTACT_SIZE, L.DRIVE_SIZE, L.PROBE_SIZE, 1, L.DAMPER_SIZE)


def _place_of(scene: Scene, entry: int) -> tuple[int, int, int] | None:
    """Kind, index and number of a place in the parameter vector; None where no parameter has it."""
    if entry < L.GLOBALS:
        return GLOBAL, 0, entry
    if entry < L.GLOBALS + L.BODY_SIZE * len(scene.bodies):
        return BODY, *divmod(entry - L.GLOBALS, L.BODY_SIZE)
    part = int(np.searchsorted(scene.tables.offset, entry, side="right")) - 1
    kind = _KINDS[part]
    return None if kind is None else (kind, *divmod(entry - int(scene.tables.offset[part]), _SIZES[part]))


def sources_of(directions: Directions) -> Sources:
    """Numbers that parameters change, as the kernels read them."""
    found = []
    for j, entry in zip(*np.nonzero(directions.slope), strict=True):
        place = _place_of(directions.scene, int(entry))
        assert place is not None, "a parameter changes the prescribed motion"
        found.append((place, int(j), float(directions.slope[j, entry])))
    found.sort(key=lambda one: one[0])
    places = list(dict.fromkeys(place for place, _, _ in found))
    counts = Counter(place for place, _, _ in found)
    first = np.cumsum([0, *(counts[place] for place in places)])
    kind, thing, number = np.array(places, dtype=np.int64).reshape(-1, 3).T
    return Sources(
        np.ascontiguousarray(kind), np.ascontiguousarray(thing), np.ascontiguousarray(number), first.astype(np.int64),
        np.array([j for _, j, _ in found], dtype=np.int64), np.array([slope for _, _, slope in found]),
    )  # fmt: skip


def places_of_gap(scene: Scene, contact: str) -> NDArray[np.int64]:
    """Places of the numbers that a contact's gap hangs on beside the angles: its surfaces, and all pivots."""
    first = int(scene.tables.offset[1]) + L.CONTACT_SIZE * scene.contacts.index(contact)
    pivots = L.GLOBALS + L.BODY_SIZE * np.arange(len(scene.bodies))[:, None] + [L.PIVOT_X, L.PIVOT_Y]
    return np.append(np.arange(first, first + L.K_A), pivots.ravel())
