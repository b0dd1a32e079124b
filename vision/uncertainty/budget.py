"""Error budget of a tracked film: each contribution to the uncertainty of each angle.

Terms, all standard uncertainties in rad, of the angle at the middle of the exposure:
``noise`` (of the frame), ``reference`` (of the zero; common to all frames), ``shutter`` (a blurred picture
shows the mean over the exposure), ``tilt`` and ``distortion`` (see `vision.camera.model`), ``codec``,
``synchronisation`` (speed times the standard uncertainty of the frame times), ``rows`` (a rolling shutter shows each
row of a frame at another time; 0 where it is global or not declared), ``lag`` (filtering in time by the camera, see
`vision.reference.temporal_noise`), ``aspect`` (pixels that are not square, see `vision.tracking.picture_stretch`),
``interlace`` (rows that are interpolated, and when they were exposed, where that is not known). Independent terms add
in squares (GUM 5.1.2). A term is NaN where the body is lost.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

TERMS = (
    *("noise", "reference", "shutter", "tilt", "distortion", "codec", "synchronisation", "rows"),
    *("lag", "aspect", "interlace"),
)


@dataclass(frozen=True)
class ErrorBudget:
    """Standard uncertainties by term.

    Attributes
    ----------
    bodies : tuple of str
    absolute, relative : dict of str to ndarray, shape (n, m)
        Per term of `TERMS`, frame and body, rad; ``relative`` to the parent, NaN for a body without one.
    camera : str
        What is assumed or known of the camera.
    shutter : str
        What is declared of the sensor's shutter, which no film shows.
    """

    bodies: tuple[str, ...]
    absolute: dict[str, NDArray[np.float64]]
    relative: dict[str, NDArray[np.float64]]
    camera: str
    shutter: str

    def total(self, relative: bool = False, without: Sequence[str] = ()) -> NDArray[np.float64]:
        """Root of the sum of squares over the terms, shape (n, m)."""
        terms = self.relative if relative else self.absolute
        return np.sqrt(np.sum([terms[name] ** 2 for name in TERMS if name not in without], axis=0))

    def typical(self, relative: bool = False) -> dict[str, dict[str, float]]:
        """Root mean square over the frames, rad, by body, then by term and ``total``; of angles relative to the parent
        if ``relative``. Bodies without such an angle are left out."""
        terms = {**(self.relative if relative else self.absolute), "total": self.total(relative)}
        return {
            body: {name: rms(values[:, i]) for name, values in terms.items()}
            for i, body in enumerate(self.bodies)
            if np.isfinite(terms["noise"][:, i]).any()
        }


def rms(values: NDArray[np.float64]) -> float:
    """Root mean square of the finite values; NaN without any."""
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(known**2))) if known.size else math.nan


def shutter_text(rows_per_s: float | None) -> str:
    """What is declared of a sensor's shutter, as a line; rows per second, infinite for a global one."""
    if rows_per_s is None:
        return "shutter not declared (`rows_per_s`): taken as global, term rows as 0; no film shows a rolling one"
    if math.isinf(rows_per_s):
        return "global shutter: all rows of a frame are of one time"
    return f"rolling shutter, {rows_per_s:g} rows/s; frame times are those of the first row; term rows is not corrected"
