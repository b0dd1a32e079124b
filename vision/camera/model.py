"""What is known of the camera's view of the plane of motion: nothing, or a calibration.

Every camera model contributes to the uncertainty of the angles; a calibrated one also corrects them.

A model lists *variants*: projections one standard uncertainty away from the nominal one, each with a weight and
the budget term it belongs to. The variance of an angle is the weighted sum of its squared differences.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from vision.arrays import as_numbers
from vision.camera.projection import MAX_DISTORTION, Projection, tilted
from vision.errors import VisionInputError

DIRECTIONS = 8


@dataclass(frozen=True)
class Variant:
    """One way in which the camera may differ from its nominal model."""

    term: str
    weight: float
    projection: Projection


class CameraModel(Protocol):
    """Nominal projection and its uncertainty."""

    def nominal(self, width: int, height: int) -> Projection | None:
        """Projection to correct the angles with; None when nothing is known."""
        ...

    def variants(self, width: int, height: int) -> list[Variant]:
        """Projections one standard uncertainty away."""
        ...

    def description(self) -> str:
        """What is assumed or known, for the user."""
        ...


@dataclass(frozen=True)
class AssumedCamera:
    """A camera set up by eye: standard uncertainties of its tilt, in any direction, and of its lens.

    Parameters
    ----------
    u_tilt_rad : float
        Of the angle between the camera's axis and the normal of the plane of motion.
    u_radial : float
        Of the radial displacement at the picture's corner, as a fraction.
    distance_widths : float
        Distance of the lens over the width of the field of view.
    """

    u_tilt_rad: float = math.radians(1.0)
    u_radial: float = 0.001
    distance_widths: float = 10.0

    def __post_init__(self) -> None:
        if not 0.0 <= self.u_tilt_rad <= math.radians(30.0):
            raise VisionInputError(f"assumed tilt {math.degrees(self.u_tilt_rad):g} deg; allowed 0 to 30")
        if not 0.0 <= self.u_radial <= MAX_DISTORTION:
            raise VisionInputError(f"assumed distortion {self.u_radial:g}; allowed 0 to {MAX_DISTORTION}")
        if not 1.0 <= self.distance_widths < math.inf:
            raise VisionInputError(f"camera distance of {self.distance_widths:g} picture widths; needs at least 1")

    def nominal(self, width: int, height: int) -> Projection | None:
        """Nothing to correct with."""
        return None

    def variants(self, width: int, height: int) -> list[Variant]:
        """The tilt in eight directions, and the distortion.

        Part of the error grows with the square of the tilt; the mean over a normal distribution of the tilt is
        that of the points 0 and sqrt(3) standard uncertainties, with the weights 2/3 and 1/3 (Gauss-Hermite).
        """
        made = []
        for k in range(DIRECTIONS):
            lean = tilted(
                math.sqrt(3.0) * self.u_tilt_rad, 2.0 * math.pi * k / DIRECTIONS, self.distance_widths * width
            )
            made.append(Variant("tilt", 1.0 / (3.0 * DIRECTIONS), Projection(width, height, lean)))
        return [*made, Variant("distortion", 1.0, Projection(width, height, radial=self.u_radial))]

    def description(self) -> str:
        """What is assumed."""
        return (
            f"camera not calibrated: assumed tilt {math.degrees(self.u_tilt_rad):.2g} deg, distortion "
            f"{100 * self.u_radial:.2g} % at the corner (standard uncertainties)"
        )


@dataclass(frozen=True)
class CalibratedCamera:
    """A camera whose view was measured with a target in the plane of motion.

    Parameters
    ----------
    width, height : int
        Of the picture the calibration was made with, px.
    parameters : ndarray, shape (5,)
        Stretch a, shear b, perspective p and q (both 1 / half diagonal), radial distortion k: homography
        ``[[1 + a, b, 0], [b, 1 - a, 0], [p / R, q / R, 1]]``.
    covariance : ndarray, shape (5, 5)
    scale_px_per_m : float
        At the picture's centre.
    u_scale_px_per_m : float
    """

    width: int
    height: int
    parameters: NDArray[np.float64]
    covariance: NDArray[np.float64]
    scale_px_per_m: float
    u_scale_px_per_m: float

    def __post_init__(self) -> None:
        parameters = as_numbers(self.parameters, "camera calibration: parameters")
        covariance = as_numbers(self.covariance, "camera calibration: covariance")
        good = parameters.shape == (5,) and covariance.shape == (5, 5)
        good = good and bool(np.all(np.isfinite(parameters)) and np.all(np.isfinite(covariance)))
        if not good or np.linalg.eigvalsh(0.5 * (covariance + covariance.T)).min() < -1e-9 * np.abs(covariance).max():
            raise VisionInputError("camera calibration: needs 5 finite parameters and their 5 x 5 covariance")
        if not self.scale_px_per_m > 0.0:
            raise VisionInputError(f"camera calibration: scale {self.scale_px_per_m} px/m; needs a positive number")
        object.__setattr__(self, "parameters", parameters)
        object.__setattr__(self, "covariance", 0.5 * (covariance + covariance.T))

    def nominal(self, width: int, height: int) -> Projection | None:
        """The measured projection; refuses a film of another size."""
        if (width, height) != (self.width, self.height):
            raise VisionInputError(
                f"camera calibration is for pictures of {self.width} x {self.height}, the film has {width} x {height}; "
                "calibrate with the film's own settings"
            )
        return projection_of(self.parameters, width, height)

    def variants(self, width: int, height: int) -> list[Variant]:
        """One per independent direction of the covariance."""
        scale = np.sqrt(np.maximum(np.diag(self.covariance), 1e-30))
        values, vectors = np.linalg.eigh(self.covariance / np.outer(scale, scale))
        made = []
        for value, vector in zip(values, vectors.T, strict=True):
            step = math.sqrt(max(float(value), 0.0)) * vector
            term = "distortion" if abs(step[4]) > np.hypot(*step[2:4]) + np.hypot(*step[:2]) else "tilt"
            made.append(Variant(term, 1.0, projection_of(self.parameters + step * scale, width, height)))
        return made

    def description(self) -> str:
        """What was measured."""
        return f"camera calibrated: {self.scale_px_per_m / 1e3:.3f} px/mm, distortion {100 * self.parameters[4]:.3f} %"


def projection_of(parameters: NDArray[np.float64], width: int, height: int) -> Projection:
    """Projection of the five parameters of `CalibratedCamera`."""
    a, b, p, q, k = (float(v) for v in parameters)
    half = float(np.hypot(0.5 * (width - 1), 0.5 * (height - 1)))
    return Projection(width, height, np.array([[1 + a, b, 0.0], [b, 1 - a, 0.0], [p / half, q / half, 1.0]]), k)
