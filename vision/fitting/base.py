"""What a fit of one body in one frame returns, and the region of the frame it reads.

A pose is (phi, tx, ty): turn in picture axes (rad, clockwise to the eye) and shift (px) of the template's centre from
its place in the reference.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from vision.film.source import FrameSource
from vision.fitting.assessment import UNKNOWN, Ratios
from vision.fitting.template import Template

MARGIN_PX = 14
"""Read around the body: 8 px for the spline filter, the rest for motion beyond the prediction."""


@dataclass(frozen=True)
class Fit:
    """Result of fitting one body in one frame.

    ``covariance`` (3, 3) is from this frame's noise only, in rad and px. ``zncc`` is the correlation of fitted and
    observed grey values over the pixels in use, ``inlier`` the fraction of the template's pixels that agree with the
    fit, ``seen`` the fraction that is inside the picture and not covered. Where ``converged`` is False the other values
    mean nothing. ``coherence`` tells how far the residuals are from white noise; ``level`` is the mean grey value of
    the pixels in use, where it is known.
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


class Fitter(Protocol):
    """An engine that fits one body."""

    template: Template
    has_cautious_start: bool
    """Whether ``cautious`` makes a difference to `reset`."""

    def fit(self, film: FrameSource, index: int, pose: NDArray[np.float64], covered: NDArray[np.uint8] | None) -> Fit:
        """Fit the body in frame ``index``, starting from ``pose``; ``covered`` marks template pixels to leave out."""
        ...

    def reset(self, cautious: bool = False) -> None:
        """Forget the state carried over from the previous frame; ``cautious`` as for much of the body hidden."""
        ...

    def state(self) -> dict[str, NDArray[Any]]:
        """What is carried over from frame to frame, as arrays."""
        ...

    def restore(self, arrays: dict[str, NDArray[Any]]) -> None:
        """Continue from what `state` gave."""
        ...


def region_of(
    template: Template, pose: NDArray[np.float64], height: int, width: int, margin_px: int = MARGIN_PX
) -> tuple[int, int, int, int] | None:
    """Rectangle (y0, y1, x0, x1) of the frame that holds the body at a pose, or None when too little is inside."""
    # plain numbers, once per body and frame: the loop over the corners cost as much as a tenth of a fit
    turn, shift_x, shift_y = pose.tolist()
    centre_x, centre_y = template.centre_px[0] + shift_x, template.centre_px[1] + shift_y
    if not math.isfinite(turn + centre_x + centre_y):
        return None
    cosine, sine = math.cos(turn), math.sin(turn)
    left, right, top, bottom = template.box_px
    # each corner coordinate is a sum of two products, the least of which is the sum of the least
    low_x, high_x = (left, right) if cosine >= 0.0 else (right, left)
    low_y, high_y = (top, bottom) if cosine >= 0.0 else (bottom, top)
    down_x, up_x = (left, right) if sine >= 0.0 else (right, left)
    down_y, up_y = (top, bottom) if sine >= 0.0 else (bottom, top)
    x0 = max(0, math.floor(centre_x + (cosine * low_x - sine * up_y)) - margin_px)
    x1 = min(width, math.ceil(centre_x + (cosine * high_x - sine * down_y)) + margin_px + 1)
    y0 = max(0, math.floor(centre_y + (sine * down_x + cosine * low_y)) - margin_px)
    y1 = min(height, math.ceil(centre_y + (sine * up_x + cosine * high_y)) + margin_px + 1)
    if x1 - x0 < 16 or y1 - y0 < 16:
        return None
    return y0, y1, x0, x1
