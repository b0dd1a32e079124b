"""Whether a body's texture lies within a few coarse steps of grey.

A film whose grey values were rounded to steps that its noise does not blur shows a contour where there was a slope;
contours move with the body by whole pixels at a time, and residuals do not tell how far that moves the pose. Films in
steps are known by the grey values that occur.
"""

from __future__ import annotations

import numpy as np

from vision.film.source import FrameSource
from vision.fitting.template import Template

OF_TEXTURE = 0.25
"""Step over the texture's standard deviation from which it is coarse."""
OF_NOISE = 2.0
"""Step over the noise from which it is not blurred."""
LEAST_VALUES = 3
"""Fewer grey values are no texture."""


def grey_step(film: FrameSource, box: tuple[int, int, int, int]) -> float:
    """Smallest difference of two grey values that occur in a rectangle (y0, y1, x0, x1) of the first frame."""
    while hasattr(film, "film"):  # what was taken off a frame has no steps
        film = film.film
    values = np.unique(film.read_region(0, *box))
    return float(np.diff(values.astype(np.float64)).min()) if values.size >= LEAST_VALUES else np.inf


def in_coarse_steps(template: Template, step: float) -> bool:
    """Whether a body is seen in steps of grey that neither its texture nor its noise make fine."""
    return step > OF_TEXTURE * float(np.std(template.columns[3])) and step > OF_NOISE * template.noise_grey
