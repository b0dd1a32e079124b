"""Observables of contacts, tips, bodies and joints at given states, evaluated by generated kernels.

Columns are named in `model.codegen.observable_columns`. Forces in N, powers in W; world frame: x right, y up.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from model.codegen.load import load_kernel
from model.codegen.observable_columns import BODY, CONTACT, TIP
from model.errors import InputError
from model.kernels.compile import kernel
from model.kernels.layout import STRING_STATES, Tables

Array = NDArray[np.float64]


@kernel
def evaluate_rows(observe, x, u, p, y):  # type: ignore[no-untyped-def]  # compiled
    """Fill rows ``y`` (m, k) from states ``x`` (m, n) and inputs ``u`` (m, l)."""
    for i in range(x.shape[0]):
        observe(x[i], u[i], p, y[i])


def _evaluate(tables: Tables, what: str, shape: tuple[int, int], given: tuple[Array, Array, Array]) -> Array:
    x, u, p = given
    y = np.zeros((len(x), *shape))
    if y.size:
        evaluate_rows(load_kernel(tables, what), x, u, p, y.reshape(len(x), -1))
    return y


def _state_rows(
    tables: Tables, angle: Array, speed: Array, memory: Array | None, value: Array | None, prescribed: Array | None
) -> tuple[Array, Array]:
    """Check states, angles and speeds (m, n) of all coordinates, with what a run remembers (m, …), if anything; return
    rows of states (m, k) and of inputs, ``value`` (m,) or 0, then ``prescribed`` accelerations or 0, as the kernels
    take them."""
    m, n = len(angle), len(tables.parent)
    if angle.shape != (m, n) or speed.shape != angle.shape:
        raise InputError(
            f"states: found {angle.shape} angles and {speed.shape} speeds, allowed (m, {n}) twice: all coordinates, "
            "with one that is prescribed"
        )
    remembered = np.empty((m, 0)) if memory is None else memory
    least = len(tables.memory) + 2 * len(tables.pin) + STRING_STATES * len(tables.string)
    if remembered.shape[0] != m or remembered.shape[1] < least:
        raise InputError(
            f"states: found rows of {remembered.shape[1]} numbers of what felt, joints and string remember, allowed "
            f"{m} rows of at least {least}: what a run has left (`Simulation.remembered`)"
        )
    x = np.concatenate([angle, speed, remembered], axis=1)
    held = int(tables.prescribed.sum())
    u = np.zeros((m, 1 + held))
    if value is not None:
        u[:, 0] = value
    if prescribed is not None:
        u[:, 1:] = prescribed.reshape(m, held)
    return np.ascontiguousarray(x, dtype=float), u


def contacts_at(tables: Tables, p: Array, angle: Array, speed: Array, memory: Array | None = None) -> Array:
    """Columns `NORMAL` to `RATE` of each contact (m, c, 11) at states (m, n); ``memory`` (m, z) as runs keep it."""
    x, u = _state_rows(tables, angle, speed, memory, None, None)
    return _evaluate(tables, "contacts", (len(tables.contact), CONTACT), (x, u, p))


def tips_at(tables: Tables, p: Array, angle: Array, speed: Array, memory: Array | None = None) -> Array:
    """Columns `TIP_FORCE` to `TIP_DEPTH` of each tip (m, b, 3)."""
    x, u = _state_rows(tables, angle, speed, memory, None, None)
    return _evaluate(tables, "tips", (len(tables.probe), TIP), (x, u, p))


def bodies_at(
    tables: Tables,
    p: Array,
    states: tuple[Array, Array],
    memory: Array | None = None,
    value: Array | None = None,
    prescribed: Array | None = None,
) -> Array:
    """Columns `PIVOT_X` to `HELD` of each body (m, n, 16) at ``states``, angles, rad, and speeds, rad/s, (m, n) each,
    under inputs ``value`` (m,), 0 by default; ``p``: the scene's numbers; ``memory`` (m, …): what a run remembers.

    Where a coordinate is prescribed, under accelerations (m,) of the way along which its input works: of the key's
    front downwards, m/s^2, of an arm's or finger's angle, rad/s^2.
    """
    x, u = _state_rows(tables, *states, memory, value, prescribed)
    return _evaluate(tables, "bodies", (len(tables.parent), BODY), (x, u, p))
