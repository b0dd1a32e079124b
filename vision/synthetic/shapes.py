"""Outlines for synthetic bodies: boxes, bars with round ends, unions by listing points.

Points (x, y), shape (m, 2), in the body's own axes and in the unit of the arguments; valid with y up and with y down.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray


def box(x0: float, y0: float, x1: float, y1: float) -> NDArray[np.float64]:
    """Rectangle between two corners."""
    return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]], dtype=float)


def thick_line(points: ArrayLike, thickness: float | ArrayLike) -> NDArray[np.float64]:
    """Outline of a bent bar along a line of points.

    Parameters
    ----------
    points : array_like, shape (m, 2)
        Centre line.
    thickness : float or array_like, shape (m,)
        Full width, one for all points or one each.

    Returns
    -------
    ndarray, shape (2 m, 2)
    """
    line = np.asarray(points, dtype=float)
    half = 0.5 * np.broadcast_to(np.asarray(thickness, dtype=float), (len(line),))
    step = np.diff(line, axis=0)
    step /= np.hypot(step[:, 0], step[:, 1])[:, None]
    normal = np.column_stack([-step[:, 1], step[:, 0]])
    at_points = np.vstack([normal[:1], normal[:-1] + normal[1:], normal[-1:]])
    at_points /= np.hypot(at_points[:, 0], at_points[:, 1])[:, None]
    # a mitre: the corner moves out so that both arms keep their width
    cosine = np.einsum("ij,ij->i", at_points, np.vstack([normal[:1], normal]))
    offset = at_points * (half / np.maximum(cosine, 0.3))[:, None]
    return np.vstack([line + offset, (line - offset)[::-1]])


def turned(points: ArrayLike, phi_rad: float, pivot: tuple[float, float]) -> NDArray[np.float64]:
    """Points turned by ``[[cos, -sin], [sin, cos]]`` about the origin and moved to a pivot."""
    c, s = np.cos(phi_rad), np.sin(phi_rad)
    return np.asarray(points, dtype=float) @ np.array([[c, s], [-s, c]]) + np.asarray(pivot, dtype=float)
