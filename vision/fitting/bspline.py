"""Cubic B-spline representation of a picture: prefilter, gradient, and how much sampling smooths the noise.

Source: M. Unser, Splines: a perfect fit for signal and image processing, IEEE Signal Process. Mag. 16(6),
1999: the interpolating prefilter has the impulse response ``sqrt(3) * z**|k|`` with pole ``z = sqrt(3) - 2``.
It is cut after 7 taps on each side, which changes a coefficient by at most 1.3e-4 of the largest per axis,
and mirrored at the border.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

POLE = np.sqrt(3.0) - 2.0
HALF_TAPS = 7  # of the prefilter: its impulse response falls by 0.27 a pixel
TABLE_STEPS = 64  # fractions of a pixel for which the noise gain is tabulated


def prefilter_taps(half: int = HALF_TAPS) -> NDArray[np.float64]:
    """Impulse response of the interpolating prefilter, shape (2 * half + 1,), scaled to sum one."""
    taps = np.sqrt(3.0) * POLE ** np.abs(np.arange(-half, half + 1))
    return taps / taps.sum()


_TAPS = prefilter_taps().astype(np.float32)


def coefficients(picture: NDArray[Any]) -> NDArray[np.float32]:
    """B-spline coefficients of a picture, same shape (height, width)."""
    # a filter wider than the picture would mirror more than once; regions are always wider than the filter
    return _correlate_separable(picture, _TAPS, _TAPS)


def gradient(picture: NDArray[Any]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Derivatives (d/dx, d/dy) of the spline at the pixel centres, grey per pixel, each (height, width)."""
    coefficient = coefficients(picture)
    smooth = np.array([1.0, 4.0, 1.0], dtype=np.float32) / 6.0
    slope = np.array([-0.5, 0.0, 0.5], dtype=np.float32)
    return _correlate_separable(coefficient, slope, smooth), _correlate_separable(coefficient, smooth, slope)


def _correlate_separable(
    picture: NDArray[Any], along_x: NDArray[np.float32], along_y: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Picture (height, width) correlated with the product of the taps ``along_x`` and ``along_y``, mirrored
    at the rim."""
    if picture.dtype not in (np.uint8, np.uint16, np.float32):
        picture = picture.astype(np.float32)
    result = cv2.sepFilter2D(
        np.ascontiguousarray(picture), cv2.CV_32F, along_x, along_y, borderType=cv2.BORDER_REFLECT_101
    )
    return np.asarray(result, dtype=np.float32)


def basis(fraction: NDArray[np.float64] | float) -> NDArray[np.float64]:
    """Weights of the four coefficients around a point, shape (..., 4), for fractions 0 <= f < 1."""
    f = np.asarray(fraction, dtype=float)
    g = 1.0 - f
    middle = (2.0 / 3.0 - one**2 + 0.5 * one**3 for one in (f, g))
    return np.stack([g**3 / 6.0, *middle, f**3 / 6.0], axis=-1)


@lru_cache(maxsize=1)
def slope_noise_gain() -> float:
    """Variance of one component of `gradient` at a pixel, for white noise of variance one."""
    return float(np.sum(np.convolve([0.5, 0.0, -0.5], prefilter_taps()) ** 2))


@lru_cache(maxsize=1)
def noise_gain() -> NDArray[np.float64]:
    """Variance (65,) of a spline sample of white noise of variance one, along one axis, at ``i / 64`` of a pixel past
    one: 1 on a pixel, 0.75 between two.

    The sample at fraction f is the picture weighted with the cardinal spline; its variance is the sum of the squared
    weights. In two dimensions the gains multiply.
    """
    taps = prefilter_taps()
    gains = []
    for weights in basis(np.linspace(0.0, 1.0, TABLE_STEPS + 1)):
        gains.append(float(np.sum(np.convolve(weights, taps) ** 2)))
    table = np.array(gains)
    table.setflags(write=False)
    return table
