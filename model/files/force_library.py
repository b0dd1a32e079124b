"""Named force tables, computed so that every machine gets the same numbers; for studies and benchmarks.

Time (s), force on the key (N, positive downwards), 5 kHz, 0.7 s, rounded to 1e-4 N. The forces that the thesis
measured are not printed in numbers; ``thesis-forte`` and ``piano`` follow its words and Figs 4.1 and 4.5.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from model.errors import InputError

RATE_HZ = 5000  # as the bench samples
DURATION_S = 0.7

# corners (s, N), straight lines between them
KNOTS: dict[str, tuple[list[float], list[float]]] = {
    "forte": (
        [0, 0.05, 0.07, 0.09, 0.11, 0.1125, 0.115, 0.118, 0.3, 0.39],
        [0, 0, 1.4, 4.9, 10, 27, 15, 10, 10, 0],
    ),
    # 0.05 to 0.11 s up to 10 N, spike of 34 N where the key meets the bottom, held 0.20 s (Section 4.1)
    "thesis-forte": (
        [0, 0.05, 0.06, 0.07, 0.08, 0.09, 0.1, 0.11, 0.1115, 0.116, 0.31, 0.33, 0.35, 0.37, 0.39, 0.41],
        [0, 0, 0.435, 1.46, 2.97, 4.92, 7.27, 10, 34, 10, 10, 9.05, 6.55, 3.45, 0.95, 0],
    ),
    # gradually to 1.5 N, three times as long as the forte, then a small spike (Section 4.2.1)
    "piano": ([0, 0.03, 0.16, 0.165, 0.17, 0.35, 0.45], [0, 0, 1.5, 3.0, 1.5, 1.5, 0]),
    # two strikes: the key goes up within 0.02 s between them, else the hammer stays in check
    "double": (
        [0, 0.03, 0.08, 0.11, 0.15, 0.17, 0.25, 0.28, 0.31, 0.45, 0.5],
        [0, 0, 6, 12, 8, 0, 0, 8, 14, 8, 0],
    ),
    # a 60 N spike of 2.5 ms half width on a hard blow
    "fortissimo": (
        [0, 0.03, 0.05, 0.065, 0.0675, 0.07, 0.075, 0.25, 0.3],
        [0, 0, 8, 18, 60, 25, 15, 15, 0],
    ),
}


def force_table(name: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Times (k,), s, and forces (k,), N, down on the key, of a built-in blow: ``forte``, ``thesis-forte``, ``piano``,
    ``double`` or ``fortissimo``.

    Parameters
    ----------
    name : ``forte``, ``thesis-forte``, ``piano``, ``double`` or ``fortissimo``

    Returns
    -------
    tuple of ndarray
        Times (k,), s, at 5 kHz, and forces (k,), N, positive downwards on the key.

    Raises
    ------
    InputError : there is no blow of that name

    Examples
    --------
    >>> import model
    >>> time_s, force_n = model.force_table("forte")
    >>> time_s.shape, float(force_n.max())
    ((3501,), 26.52)
    """
    if name not in KNOTS:
        raise InputError(f"force table {name!r}: not found; allowed {', '.join(KNOTS)}")
    time = np.round(np.arange(round(DURATION_S * RATE_HZ) + 1) / RATE_HZ, 4)
    at, newton = KNOTS[name]
    return time, np.round(np.interp(time, np.array(at, dtype=float), np.array(newton, dtype=float)), 4)
