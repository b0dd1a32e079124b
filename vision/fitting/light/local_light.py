"""The local light of one body from frame to frame: when it is believed, what it is now, what it costs.

Light goes on from frame to frame, noise does not: a change of light is taken up when two fits in a row show the same
one, so that noise that is smooth over the picture, which looks like light in any single frame, is left to the
uncertainty. Method of the squares: `vision.fitting.light.light_field`.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vision.fitting.base import Fit
from vision.fitting.bspline import noise_gain
from vision.fitting.light.light_field import DEAREST, Light, LightField
from vision.fitting.slow_changes import Changes, light_factor
from vision.fitting.template import Template

HIDDEN_SUSPECTED = 0.05
"""Share of visible pixels that do not agree from which local light is looked for."""
SUSPECTED = 2.0
"""The same for the ratio of `vision.fitting.coherence` over the largest blocks."""
ALIKE = 0.7
"""Correlation of the changes that two fits show, from which they are the same light."""
LEAST_NOISE_GREY = 0.5
F64 = NDArray[np.float64]


class LocalLight:
    """What the light of one body is; even at first."""

    def __init__(self, template: Template) -> None:
        self._template = template
        self._field: LightField | None = None
        self.reset()

    def reset(self) -> None:
        """Forget the light of the frames before."""
        self.light: Light | None = None
        self._shown: F64 | None = None

    @property
    def is_looked_for(self) -> bool:
        """Whether the next fit must be asked about the light, however good it is."""
        return self.light is not None or self._shown is not None

    def state(self) -> dict[str, NDArray[Any]]:
        """The light, and what the newest fit showed of one that is not yet believed."""
        light, nothing = self.light, np.zeros((0, 0))
        return {
            "shade": nothing if light is None else light.shade,
            "glow": nothing if light is None else light.glow,
            "glows": np.array(light is not None and light.glows),
            "shown": nothing if self._shown is None else self._shown,
        }

    def restore(self, arrays: dict[str, NDArray[Any]]) -> None:
        """Continue from the light of another frame."""
        shade, shown = arrays["shade"], arrays["shown"]
        self.light = Light(shade, arrays["glow"], bool(arrays["glows"])) if shade.size else None
        self._shown = shown if shown.size else None

    def changed(self, fit: Fit, work: NDArray[np.float32], slow: Changes, first: bool) -> bool:
        """Whether the light, as the residuals of a fit show it, asks for another.

        Parameters
        ----------
        fit : Fit
        work : ndarray, shape (5, n)
            Visible pixels and residuals in rows 1 and 2.
        slow : Changes
            What the fit took for light that changes slowly.
        first : bool
            Whether this is the frame's first question.
        """
        if self.light is None and not (first and _suspected(fit)):
            if first:
                self._shown = None
            return False
        field, noise = self._squares(), self._noise(fit.gain)
        if self.light is not None:
            light = field.followed(self.light, work[1], work[2], fit.gain, noise)
        else:
            change = field.shown(work[1], work[2], fit.gain, noise) if field.price()[0] <= DEAREST else None
            before, self._shown = self._shown, change
            if change is None or before is None or np.corrcoef(before.ravel(), change.ravel())[0, 1] < ALIKE:
                return False
            factor = light_factor(slow, *(field.middles_px() / self._template.radius_px))
            light = field.begun(factor, work[1], work[2], fit.gain, noise)
        if light is None:
            return False
        self.light, self._shown = light, None
        return True

    def taken_off(self, coefficient: NDArray[np.float32], corner: tuple[int, int], pose: F64) -> NDArray[np.float32]:
        """Spline coefficients of a region, whose first pixel is at (y, x), under even light."""
        if self.light is None:
            return coefficient
        return self._squares().taken_off(coefficient, corner, pose, self.light)

    def widened(self, fit: Fit) -> Fit:
        """A fit with what the local light takes from the pose in its covariance."""
        if self.light is None:
            return fit
        root = np.sqrt(self._squares().price())
        return replace(fit, covariance=fit.covariance * root[:, None] * root)

    def _squares(self) -> LightField:
        """Made when they are first asked for."""
        if self._field is None:
            self._field = LightField(self._template)
        return self._field

    def _noise(self, gain: float) -> float:
        """Standard deviation of a residual that is noise, grey."""
        noise = max(self._template.noise_grey, LEAST_NOISE_GREY)
        return noise * math.sqrt(float(noise_gain().mean()) ** 2 + gain**2 / self._template.n_averaged)


def _suspected(fit: Fit) -> bool:
    return fit.seen - fit.inlier > HIDDEN_SUSPECTED or any(one > SUSPECTED for one in fit.coherence.ratio[-1].tolist())
