"""Light that changes across a body: measured in the residuals of a fit, and divided out of the frame.

Gain and offset follow light that changes everywhere alike. A lamp that moves with the body, a shadow's slow edge, or
bands of a lamp's flicker in a rolling picture multiply the grey values by a factor that grows across the body; to first
order ``1 + a x + b y``. Only where the residuals ask for it, since on weak texture such terms take information from the
pose: then the covariance grows by what they take.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from vision.fitting.template import Template

ASKED_FOR = 60.0
"""Chi-squared of the two terms from which they are believed; 14 would be one fit in a thousand by chance."""
MOST = 0.6
"""Largest change of the light from the middle to the rim that is followed."""

Light = tuple[float, float]
"""Change of the factor from the middle of the body to its rim, along the template's x and y."""
NO_LIGHT: Light = (0.0, 0.0)


class LightGradient:
    """The two terms of one template."""

    def __init__(self, template: Template) -> None:
        self._template = template
        grey = template.columns[3].astype(float) + template.mean_grey
        terms = grey * template.offset_px.astype(float) / template.radius_px
        design = np.vstack([template.columns.astype(float), np.ones(template.n_pixels)])
        across = terms @ design.T
        # what the five parameters of the fit cannot follow
        follow = np.linalg.lstsq(template.normal, across.T, rcond=None)[0]
        self._terms = terms - follow.T @ design
        whole = np.block([[template.normal, across.T], [across, terms @ terms.T]])
        scale = 1.0 / np.sqrt(np.maximum(whole.diagonal(), 1e-300))
        with_light = np.linalg.pinv(whole * scale[:, None] * scale, rcond=1e-9).diagonal()[:3]
        alone = np.linalg.pinv(template.normal * scale[:5, None] * scale[:5], rcond=1e-9).diagonal()[:3]
        self.variance_factor: NDArray[np.float64] = np.maximum(with_light / np.maximum(alone, 1e-300), 1.0)

    def measure(self, weight: NDArray[np.float32], residual: NDArray[np.float32], gain: float, noise2: float) -> Light:
        """What the residuals of a fit, with their weights, say of the light; `NO_LIGHT` where it may be chance."""
        one, other = self._terms
        w, r = weight.astype(float), residual.astype(float)
        # sums, not products of matrices, whose order of adding may depend on threads
        a11, a12, a22 = float(np.sum(w * one * one)), float(np.sum(w * one * other)), float(np.sum(w * other * other))
        b1, b2 = float(np.sum(w * one * r)), float(np.sum(w * other * r))
        determinant = a11 * a22 - a12 * a12
        if not determinant > 1e-6 * a11 * a22 > 0.0:
            return NO_LIGHT
        first, second = (a22 * b1 - a12 * b2) / determinant, (a11 * b2 - a12 * b1) / determinant
        if (first * b1 + second * b2) / max(noise2, 1e-9) < ASKED_FOR:
            return NO_LIGHT
        return first / gain, second / gain

    def divided_out(
        self, coefficient: NDArray[np.float32], corner: tuple[int, int], pose: NDArray[np.float64], light: Light
    ) -> NDArray[np.float32]:
        """Spline coefficients of a region, whose first pixel is at (y, x), under even light."""
        template = self._template
        cosine, sine = math.cos(pose[0]) / template.radius_px, math.sin(pose[0]) / template.radius_px
        along_x, along_y = light[0] * cosine - light[1] * sine, light[0] * sine + light[1] * cosine
        height, width = coefficient.shape
        x = np.arange(corner[1], corner[1] + width) - (template.centre_px[0] + pose[1])
        y = np.arange(corner[0], corner[0] + height) - (template.centre_px[1] + pose[2])
        factor = 1.0 + (along_x * x)[None, :] + (along_y * y)[:, None]
        return np.asarray(coefficient / np.maximum(factor, 1.0 - MOST), dtype=np.float32)
