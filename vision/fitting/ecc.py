"""Fit by OpenCV's masked enhanced correlation coefficient: an engine that needs no compiled kernel of ours.

Chosen with ``method="ecc"``. The averaged template is 32-bit, which halves the error of a one-frame template; frames
are sampled bilinearly by OpenCV, so the noise gain is that of linear interpolation.

Source: G. D. Evangelidis and E. Z. Psarakis, IEEE Trans. Pattern Anal. Mach. Intell. 30(10), 2008. Limits: no weights,
so a body that is partly covered by something unknown is lost or biased; about three times slower than the default
engine. OpenCV raises when it does not converge; here that is ``converged = False``.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.errors import VisionInputError
from vision.film.source import FrameSource
from vision.fitting.base import FAILED, Fit, Fitter, region_of
from vision.fitting.pose_covariance import pose_covariance
from vision.fitting.template import Template

MAX_ITERATIONS = 50
STEP_TOLERANCE = 1e-6
INLIER_SIGMA = 3.0


class EccFitter(Fitter):
    """Fits one body with `cv2.findTransformECCWithMask`."""

    def __init__(self, template: Template) -> None:
        if not hasattr(cv2, "findTransformECCWithMask"):
            raise VisionInputError(
                f'method "ecc": OpenCV {cv2.__version__} has no masked ECC, OpenCV 5 has; '
                'install it or use method "icgn"'
            )
        self.template = template
        # pixels lie at whole numbers plus one common fraction, which the crop keeps as its origin
        self._origin = (template.box_px[0], template.box_px[2])
        corner = np.array(self._origin, dtype=np.float32)[:, None]
        self._cols, self._rows = cols, rows = np.rint(template.offset_px - corner).astype(int)
        shape = (int(rows.max()) + 1, int(cols.max()) + 1)
        self._picture = np.full(shape, template.mean_grey, dtype=np.float32)
        self._picture[rows, cols] = template.columns[3] + np.float32(template.mean_grey)
        self._mask = np.zeros(shape, dtype=np.uint8)
        self._mask[rows, cols] = 255

    def fit(self, film: FrameSource, index: int, pose: NDArray[np.float64], covered: NDArray[np.uint8] | None) -> Fit:
        """Fit the body in frame ``index``, starting from ``pose``."""
        template = self.template
        region = region_of(template, pose, film.height, film.width)
        if region is None:
            return FAILED
        y0, y1, x0, x1 = region
        view = film.read_region(index, y0, y1, x0, x1).astype(np.float32)
        mask = self._mask
        if covered is not None and covered.any():
            mask = self._mask.copy()
            mask[self._rows[covered != 0], self._cols[covered != 0]] = 0
        warp = self._warp_of(pose, x0, y0)
        criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, MAX_ITERATIONS, STEP_TOLERANCE)
        try:
            correlation, found = cv2.findTransformECCWithMask(
                self._picture, view, mask, np.full_like(view, 255, np.uint8), warp, cv2.MOTION_EUCLIDEAN, criteria, 1
            )
        except cv2.error:
            return FAILED
        return self._assess(view, np.asarray(found, dtype=float), mask, float(correlation), x0, y0)

    def _warp_of(self, pose: NDArray[np.float64], x0: int, y0: int) -> NDArray[np.float32]:
        """Matrix from crop coordinates of the template to coordinates of the region read."""
        cosine, sine = math.cos(pose[0]), math.sin(pose[0])
        left, top = self._origin
        x = self.template.centre_px[0] + pose[1] - x0 + cosine * left - sine * top
        y = self.template.centre_px[1] + pose[2] - y0 + sine * left + cosine * top
        return np.array([[cosine, -sine, x], [sine, cosine, y]], dtype=np.float32)

    def _assess(
        self,
        view: NDArray[np.float32],
        warp: NDArray[np.float32],
        mask: NDArray[np.uint8],
        zncc: float,
        x0: int,
        y0: int,
    ) -> Fit:
        template = self.template
        phi = math.atan2(float(warp[1, 0]), float(warp[0, 0]))
        cosine, sine = math.cos(phi), math.sin(phi)
        left, top = self._origin
        tx = float(warp[0, 2]) + x0 - template.centre_px[0] - cosine * left + sine * top
        ty = float(warp[1, 2]) + y0 - template.centre_px[1] - sine * left - cosine * top
        x = warp[0, 0] * self._cols + warp[0, 1] * self._rows + warp[0, 2]
        y = warp[1, 0] * self._cols + warp[1, 1] * self._rows + warp[1, 2]
        inside = (x >= 0) & (y >= 0) & (x <= view.shape[1] - 1) & (y <= view.shape[0] - 1)
        use = inside & (mask[self._rows, self._cols] != 0)
        if np.count_nonzero(use) < 10:
            return FAILED
        sampled = _bilinear(view, x[use], y[use])
        columns = np.vstack([template.columns, np.ones(template.n_pixels)]).T[use].astype(float)
        solution, *_ = np.linalg.lstsq(columns[:, 3:], sampled, rcond=None)
        residual = sampled - columns[:, 3:] @ solution
        variance = float(residual @ residual) / max(1, residual.size - 5)
        fx, fy = np.modf(x[use])[0], np.modf(y[use])[0]
        kappa = float(np.mean((fx**2 + (1 - fx) ** 2) * (fy**2 + (1 - fy) ** 2)))
        gain = float(solution[0])
        if abs(gain) < 1e-3:
            return FAILED
        near = np.abs(residual) < INLIER_SIGMA * max(1.4826 * float(np.median(np.abs(residual))), 0.5)
        covariance, _ = pose_covariance(columns.T @ columns, variance, gain, kappa, template, 1.0)
        n = template.n_pixels
        return Fit(
            np.array([phi, tx, ty]), covariance, zncc, np.count_nonzero(near) / n, np.count_nonzero(use) / n, gain,
            math.sqrt(variance), MAX_ITERATIONS, True,
        )  # fmt: skip


def _bilinear(view: NDArray[np.float32], x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    """Bilinear samples at points inside the picture, without OpenCV's rounding of coordinates."""
    left = np.minimum(x.astype(int), view.shape[1] - 2)
    top = np.minimum(y.astype(int), view.shape[0] - 2)
    fx, fy = x - left, y - top
    upper = (1.0 - fx) * view[top, left] + fx * view[top, left + 1]
    lower = (1.0 - fx) * view[top + 1, left] + fx * view[top + 1, left + 1]
    return np.asarray((1.0 - fy) * upper + fy * lower)
