"""Result of fitting one body in one frame, and the region of the frame that it reads.

A pose is (phi, tx, ty): turn in picture axes (rad, clockwise to the eye) and shift (px) of the template's centre from
its place in the reference.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vision.fitting.assessment import UNKNOWN, Ratios
from vision.fitting.template import Template
from vision.kernel_cache import cached_njit

MARGIN_PX = 14  # read around the body: 8 px for the spline filter, the rest for motion beyond the prediction
LEAST_PX = 16  # side of a region
LEAST_NOISE_GREY = 0.5  # that fits assume: below it there is only the rounding to whole grey values
NO_REGION = -1
SURE_U = 5.0  # standard uncertainties beyond which a difference is not chance: one in a million of normal noise
MEDIAN_U = math.sqrt(0.5 * math.pi)  # standard error of a median of normal noise over a mean's
ROUNDING_GREY = 1.0 / math.sqrt(12.0)  # standard deviation of rounding to whole grey values


@dataclass(frozen=True)
class Fit:
    """Result of fitting one body in one frame.

    ``covariance`` (3, 3) is from this frame's noise only, in rad and px, its shift along the body's own axes. ``zncc``
    is the correlation of fitted and observed grey values over the pixels in use, ``inlier`` the fraction of the
    template's pixels that agree with the fit, ``seen`` the fraction that is inside the picture and not covered. Where
    ``converged`` is False the other values mean nothing. ``coherence`` tells how far the residuals are from white
    noise; ``level`` is the mean grey value of the pixels in use, where it is known.
    """

    pose: NDArray[np.float64]
    covariance: NDArray[np.float64]
    zncc: float
    inlier: float
    seen: float
    gain: float
    noise_grey: float
    iterations: int
    converged: bool
    coherence: Ratios = UNKNOWN
    level: float = math.nan


FAILED = Fit(np.full(3, np.nan), np.full((3, 3), np.nan), 0.0, 0.0, 0.0, np.nan, np.nan, 0, False)


@cached_njit(nogil=True)
def region_at(
    turn: float, x: float, y: float, box: tuple[float, float, float, float], size: tuple[int, int], margin: int
) -> tuple[int, int, int, int]:
    """Rectangle (y0, y1, x0, x1), ``margin`` px wider all round, of a frame of ``size`` (height, width) with a body of
    ``box`` (left, right, top, bottom; px from its centre) turned by ``turn``, rad, and centred at (x, y); y0
    `NO_REGION`: too little inside."""
    nothing = (NO_REGION, 0, 0, 0)
    if not math.isfinite(turn + x + y) or abs(x) + abs(y) > 1e9:
        return nothing
    cosine, sine = math.cos(turn), math.sin(turn)
    left, right, top, bottom = box
    # each corner coordinate is a sum of two products, the least of which is the sum of the least
    low_x, high_x = (left, right) if cosine >= 0.0 else (right, left)
    low_y, high_y = (top, bottom) if cosine >= 0.0 else (bottom, top)
    down_x, up_x = (left, right) if sine >= 0.0 else (right, left)
    down_y, up_y = (top, bottom) if sine >= 0.0 else (bottom, top)
    x0 = max(0, int(math.floor(x + (cosine * low_x - sine * up_y))) - margin)
    x1 = min(size[1], int(math.ceil(x + (cosine * high_x - sine * down_y))) + margin + 1)
    y0 = max(0, int(math.floor(y + (sine * down_x + cosine * low_y))) - margin)
    y1 = min(size[0], int(math.ceil(y + (sine * up_x + cosine * high_y))) + margin + 1)
    return (y0, y1, x0, x1) if x1 - x0 >= LEAST_PX and y1 - y0 >= LEAST_PX else nothing


def region_of(
    template: Template, pose: NDArray[np.float64], height: int, width: int, margin_px: int = MARGIN_PX
) -> tuple[int, int, int, int] | None:
    """Rectangle (y0, y1, x0, x1), ``margin_px`` wider all round, of the frame that holds the body at ``pose``: turn,
    rad, and shift x, y, px, from its place in the reference; None where too little is inside."""
    turn, x, y = pose.tolist()
    x, y = template.centre_px[0] + x, template.centre_px[1] + y
    region: tuple[int, int, int, int] = region_at(turn, x, y, template.box_px, (height, width), margin_px)
    return None if region[0] == NO_REGION else region
