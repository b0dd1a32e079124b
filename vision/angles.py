"""Angles and picture coordinates: the only place where the sign of the image's y axis is flipped.

The tracker works in picture axes (x right, y *down*, pixel centres at whole numbers, origin in the centre of the
top-left pixel) and turns a body by ``phi`` with the matrix ``[[cos, -sin], [sin, cos]]``, which is clockwise to the
eye. Everything the user sees is counter-clockwise with x right and y *up* (thesis, figure 2.3).

Datum: an angle is zero at the mean of the film's still frames. A relative angle is the body's minus its parent's.
Angles are tracked from frame to frame, so they are never wrapped to one turn. A lost frame of either body is NaN.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vision.arrays import as_numbers, as_points


def picture_to_ccw(phi_rad: ArrayLike) -> NDArray[np.float64]:
    """Counter-clockwise angles, rad, of rotations of any shape in picture axes, where y points down and a positive turn
    is clockwise to the eye: the negative.

    Parameters
    ----------
    phi_rad : array_like
        Rotations of any shape, rad.

    Returns
    -------
    ndarray
        The same shape, rad.

    Examples
    --------
    >>> import vision
    >>> vision.picture_to_ccw([0.1])
    array([-0.1])
    """
    return -as_numbers(phi_rad, "angles")


def ccw_to_picture(angle_rad: ArrayLike) -> NDArray[np.float64]:
    """Rotations in picture axes (y down; a positive turn is clockwise to the eye), rad, of counter-clockwise angles of
    any shape: the negative.

    Parameters
    ----------
    angle_rad : array_like
        Angles of any shape, rad.

    Returns
    -------
    ndarray
        The same shape, rad.

    Examples
    --------
    >>> import vision
    >>> vision.ccw_to_picture([0.1, -0.2])
    array([-0.1,  0.2])
    """
    return -as_numbers(angle_rad, "angles")


def ground_to_picture(
    points_m: ArrayLike, scale_px_per_m: float, origin_px: tuple[float, float]
) -> NDArray[np.float64]:
    """Turn points (..., 2) of a plane, m, x right and y up, into picture points (..., 2), px, x right and y down.

    Parameters
    ----------
    points_m : array_like, shape (..., 2)
        Points in metres.
    scale_px_per_m : float
        Pixels per metre; 1 with points in pixels only turns y.
    origin_px : (float, float)
        Picture point (x, y) of the plane's origin.

    Returns
    -------
    ndarray, shape (..., 2)
        Picture points (x right, y down), pixels.

    Examples
    --------
    >>> import vision
    >>> vision.ground_to_picture([[0.01, 0.02]], 1000.0, (200.0, 150.0))
    array([[210., 130.]])
    """
    points = as_points(points_m)
    return points * np.array([scale_px_per_m, -scale_px_per_m]) + as_numbers(origin_px, "origin", 1)


def relative_angle(
    child_rad: NDArray[np.float64],
    parent_rad: NDArray[np.float64],
    u_child_rad: NDArray[np.float64],
    u_parent_rad: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """``child_rad - parent_rad``, (n_frames,), and its standard uncertainty, rad: those of both, added in squares; NaN
    where either body is lost.

    The two fits use different pixels, so their noise is independent and the variances add (GUM, 5.1.2).

    Returns
    -------
    angle_rad, u_rad : ndarray, shape (n_frames,)
        NaN where either body is lost.
    """
    return child_rad - parent_rad, np.hypot(u_child_rad, u_parent_rad)


def turn_matrix(phi_rad: float | NDArray[np.float64]) -> NDArray[np.float64]:
    """What turns points (x, y) of a picture by an angle in its axes, ``[[cos, -sin], [sin, cos]]``; (n, 2, 2) of n."""
    c, s = np.cos(phi_rad), np.sin(phi_rad)
    return np.moveaxis(np.array([[c, -s], [s, c]]), (0, 1), (-2, -1))
