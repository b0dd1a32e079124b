"""Rigid inverse-compositional Gauss-Newton fit with Tukey weights: the tracker's default engine.

Place in the data flow: `follower` asks for a fit per body and frame; the loop itself runs compiled in
`kernels`.

Method: S. Baker and I. Matthews, Lucas-Kanade 20 years on, Int. J. Comput. Vis. 56, 2004 (inverse
composition); gain and offset are solved in the same 5 x 5 system as turn and shift, so flicker does not bias
the pose. The frame, not the template, is sampled, by cubic B-splines. Weights start from those of the
previous frame and follow the residuals of each iteration.

Failure: a fit that breaks down or does not settle returns ``converged = False``; nothing is raised.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vision.film.source import FrameSource
from vision.fitting.base import FAILED, MARGIN_PX, Fit, region_of
from vision.fitting.bspline import coefficients, noise_gain
from vision.fitting.kernels import fit_rigid
from vision.fitting.pose_covariance import TUKEY_FACTOR, pose_covariance
from vision.fitting.template import Template

TOLERANCE_PX = 0.002
"""Last step of any pixel. With part of the body covered the weights settle slowly: at 0.02 px such fits stopped up to
eight standard uncertainties short."""
MAX_ITERATIONS = 30
SCALE_FLOOR_GREY = 0.5
"""Smallest noise the weights assume: below it rounding to whole grey values is all there is."""


class IcgnFitter:
    """Fits one body; keeps the weights of its pixels from frame to frame.

    Parameters
    ----------
    template : Template
    robust : bool
        False for plain least squares.
    tolerance_px : float
        Iteration stops when no pixel moves further than this.
    """

    def __init__(self, template: Template, robust: bool = True, tolerance_px: float = TOLERANCE_PX) -> None:
        self.template = template
        self._robust = robust
        self._tolerance = tolerance_px
        self._gain_table = noise_gain()
        self._uncovered = np.zeros(template.n_pixels, dtype=np.uint8)
        self.reset()

    def reset(self) -> None:
        """Forget the weights carried over from the previous frame."""
        self._weight = np.ones(self.template.n_pixels, dtype=np.float32)
        self._scale = 2.0

    def carried(self) -> dict[str, NDArray[Any]]:
        """Weights and noise of the newest frame."""
        return {"weight": self._weight, "scale": np.array(self._scale)}

    def carry(self, arrays: dict[str, NDArray[Any]]) -> None:
        """Go on from the weights and noise of another frame."""
        self._weight, self._scale = np.array(arrays["weight"], dtype=np.float32), float(arrays["scale"])

    def fit(self, film: FrameSource, index: int, pose: NDArray[np.float64], covered: NDArray[np.uint8] | None) -> Fit:
        """Fit the body in frame ``index``, starting from ``pose``."""
        result = self._fit_once(film, index, pose, covered)
        moved = np.abs(result.pose[1:] - pose[1:]).max() if result.converged else 0.0
        if moved > MARGIN_PX - 9:
            # the end of the way lay in the strip that the filter's border spoils
            result = self._fit_once(film, index, result.pose, covered)
        return result

    def _fit_once(
        self, film: FrameSource, index: int, start: NDArray[np.float64], covered: NDArray[np.uint8] | None
    ) -> Fit:
        template = self.template
        region = region_of(template, start, film.height, film.width)
        if region is None:
            return FAILED
        y0, y1, x0, x1 = region
        coefficient = coefficients(film.read_region(index, y0, y1, x0, x1))
        pose = np.array(start, dtype=float)
        step, normal, stats = np.zeros(5), np.zeros((5, 5)), np.zeros(8)
        iterations = fit_rigid(
            coefficient, float(x0), float(y0), template.offset_px, template.columns,
            self._uncovered if covered is None else covered, template.centre_px[0], template.centre_px[1],
            self._gain_table, SCALE_FLOOR_GREY, self._tolerance, MAX_ITERATIONS, self._robust,
            pose, self._weight, self._scale, step, normal, stats,
        )  # fmt: skip
        if iterations <= 0 or not np.all(np.isfinite(pose)):
            self.reset()
            return FAILED
        weights, squares, inlier, seen, sum_value, sum_value2, scale, kappa = stats
        self._scale = scale
        return self._judge(
            pose, iterations, step[3], normal, kappa, weights, squares, inlier, seen, sum_value, sum_value2
        )

    def _judge(
        self,
        pose: NDArray[np.float64],
        iterations: int,
        gain: float,
        normal: NDArray[np.float64],
        kappa: float,
        weights: float,
        squares: float,
        inlier: float,
        seen: float,
        sum_value: float,
        sum_value2: float,
    ) -> Fit:
        """Quality figures and covariance from the sums of the last iteration."""
        if weights <= 6.0:
            return FAILED
        # the weighted sum has as many degrees of freedom as pixels with weight, less the five parameters
        variance = squares / (weights * (1.0 - 5.0 / max(seen, 6.0)))
        spread = sum_value2 / weights - (sum_value / weights) ** 2
        explained = 1.0 - squares / weights / spread if spread > 0.0 else 0.0
        covariance = pose_covariance(
            normal, variance, gain, kappa, self.template, TUKEY_FACTOR if self._robust else 1.0
        )
        n = self.template.n_pixels
        return Fit(
            pose=pose,
            covariance=covariance,
            zncc=float(np.sqrt(max(explained, 0.0)) * np.sign(gain)),
            inlier=inlier / n,
            seen=seen / n,
            gain=gain,
            noise_grey=float(np.sqrt(variance)),
            iterations=iterations,
            converged=True,
        )
