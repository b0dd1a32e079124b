"""Standard uncertainty of tracked poses: before tracking, per frame, and the physical limit.

Model: independent grey noise of variance s2 per pixel. A spline sample between pixels carries only ``kappa *
s2`` (`bspline.noise_gain`) but the samples are correlated, so that the pose keeps the covariance of white
noise; the residual variance must therefore be divided by kappa. The averaged reference of n frames adds ``s2
/ n`` to each residual, and its own noise looks like texture: its expected share N of the normal matrix M
tells nothing about the pose, so the covariance is ``(M - N)^-1 M (M - N)^-1`` and not ``M^-1``. After the
zero is set on the mean of the n still frames, the common error of all angles is that of the mean of n single
ones. Common and per-frame part stay separate: the first cancels in differences between frames, the second does not.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vision.arrays import as_numbers
from vision.errors import BodyError
from vision.fitting.template import TUKEY, Template, design_columns, invert_normal

PATTERN_EXCESS = 1.5  # residual variance over that of the still frames from which a fixed pattern is suspected
MOST_PATTERN = 0.75  # largest share of the normal matrix, in any direction, that is taken for noise


def _tukey_factor() -> float:
    """Factor from (weighted residual variance, inverse weighted normal matrix) to the covariance of Tukey's estimate.

    For normal noise of variance one: covariance = E[psi^2] / E[psi']^2 (Huber, Robust Statistics, 1981, ch.
    7) in units of the inverse unweighted matrix, which is E[w] times the inverse weighted one.
    """
    u = np.linspace(-TUKEY, TUKEY, 200001)  # points of the integral
    density = np.exp(-0.5 * u * u) / np.sqrt(2.0 * np.pi)
    ratio2 = (u / TUKEY) ** 2
    weight = (1.0 - ratio2) ** 2

    def mean(values: NDArray[np.float64]) -> float:
        # the integrands and their slopes vanish at both ends, where the plain sum is accurate
        return float(np.sum(values * density) * (u[1] - u[0]))

    residual = mean(weight * u * u) / mean(weight)
    slope = mean((1.0 - ratio2) * (1.0 - 5.0 * ratio2))  # derivative of psi
    return mean((weight * u) ** 2) / slope**2 * mean(weight) / residual


TUKEY_FACTOR = _tukey_factor()


def pose_covariance(
    weighted_normal: NDArray[np.float64],
    residual_variance: float,
    gain: float,
    noise_gain: float,
    template: Template,
) -> tuple[NDArray[np.float64], NDArray[np.float64] | None]:
    """Covariance (3, 3) of (turn, x, y), rad and px, from one frame's noise, without the reference's part, by the
    weighted normal matrix (5, 5), and the inverse (5, 5) of that matrix less its share of noise; NaN and None where
    singular.

    ``residual_variance`` is the weighted mean square of the residuals, grey^2, with the degrees of freedom taken off,
    ``noise_gain`` the mean kappa of the samples.
    """
    noise = residual_variance / (noise_gain + gain**2 / template.n_averaged)
    inverse = _noise_corrected_inverse(weighted_normal, noise, template)
    if inverse is None or not np.isfinite(residual_variance):
        return np.full((3, 3), np.nan), None
    return TUKEY_FACTOR * noise * (inverse @ weighted_normal @ inverse)[:3, :3] / gain**2, inverse


def _noise_corrected_inverse(
    weighted_normal: NDArray[np.float64], noise: float, template: Template
) -> NDArray[np.float64] | None:
    """Inverse (5, 5) of the normal matrix less the part that ``noise``, a variance, makes of it and that tells nothing
    about the pose; None where that is singular.

    Noise beyond that of the still frames may be a pattern of the sensor: the still frames have it in common, so it is
    in the template, where it looks like texture and stays where it is. Half of the excess is then in the template, the
    other half in the frame.
    """
    part = weighted_normal[4, 4] / template.n_pixels * template.noise_normal
    still = template.noise_grey**2
    if noise > PATTERN_EXCESS * still > 0.0:
        part = part * (1.0 + 0.5 * (noise / still - 1.0) * template.n_averaged)
    inverse = invert_normal(weighted_normal - part)
    if inverse is not None and noise <= PATTERN_EXCESS * still:
        return inverse
    if not np.all(np.isfinite(weighted_normal)):
        return None
    whole = np.linalg.eigvals(np.linalg.lstsq(weighted_normal, part, rcond=None)[0]).real.max() if part.any() else 0.0
    if whole > MOST_PATTERN:
        # where noise would explain the texture altogether, some of it is something else; u becomes large, not infinite
        inverse = invert_normal(weighted_normal - part * (MOST_PATTERN / whole))
    return inverse


def predicted_u_angle(template: Template, noise_grey: float) -> float:
    """Standard uncertainty of the angle, rad, to expect of one frame whose noise has the standard deviation
    ``noise_grey``, the common part of the zero included, with all pixels visible and no motion blur; NaN without
    texture."""
    inverse = invert_normal(template.normal - template.noise_normal)
    if inverse is None:
        return float("nan")
    variance = (inverse @ template.normal @ inverse)[0, 0]
    # Tukey's weights cost 2.6 % against least squares on normal noise
    efficiency = 0.95
    return float(noise_grey * np.sqrt(variance * (1.0 + 1.0 / template.n_averaged) / efficiency))


def cramer_rao_bound(picture: ArrayLike, mask: ArrayLike, noise_grey: float) -> tuple[float, float, float]:
    """Smallest standard deviations of an unbiased estimate of (angle, rad, x, y, px) from the pixels of ``picture``
    (height, width) that ``mask`` marks; ``noise_grey``: standard deviation of a pixel's noise.

    The template is taken as known without noise; gain and offset are unknown too (five parameters).

    Parameters
    ----------
    picture : ndarray, shape (height, width)
        Noise-free picture of the body.
    mask : ndarray of bool, shape (height, width)
        Pixels used.
    noise_grey : float
        Standard deviation of the noise per pixel, in the picture's units, quantisation included.

    Returns
    -------
    u_angle_rad, u_x_px, u_y_px : float

    Raises
    ------
    VisionInputError
        No picture or mask of numbers; a `BodyError` when the masked region is empty or has no texture.

    Examples
    --------
    >>> import numpy as np
    >>> import vision
    >>> speckle = np.random.default_rng(1).normal(128.0, 30.0, (60, 80))
    >>> u_angle_rad, u_x_px, u_y_px = vision.cramer_rao_bound(speckle, np.ones((60, 80), bool), noise_grey=2.0)
    >>> bool(u_angle_rad < 1e-4)
    True
    """
    grey, used = as_numbers(picture, "picture", 2), as_numbers(mask, "mask", 2, np.bool_)
    if used.shape != grey.shape or not used.any():
        raise BodyError(f"Cramer-Rao bound: found {used.sum()} pixels of a mask {used.shape}, a picture {grey.shape}")
    rows, cols = np.nonzero(used)
    columns, _, _ = design_columns(grey, used, (float(cols.mean()), float(rows.mean())))
    inverse = invert_normal(columns.T @ columns)
    if inverse is None:
        raise BodyError("Cramer-Rao bound: the masked region has no texture, so its pose has no bound")
    bound = noise_grey * np.sqrt(np.diag(inverse)[:3])
    return float(bound[0]), float(bound[1]), float(bound[2])
