"""Smooth illumination gradients, scale, tilt and blur of a body: estimated from residuals, corrected in the frame.

Gain and offset follow light that changes everywhere alike. A lamp that moves with the body, a shadow's slow edge, or
bands of a lamp's flicker in a rolling picture multiply the grey values by a factor that grows across the body; a body
that comes nearer is larger, one that tilts is shorter one way, one that leaves the plane of focus is blurred, and its
contours drag the pose where they do not balance. Six groups of terms, each fitted only where the
residuals ask for it, since on weak texture they take information from the pose: the covariance then grows by what they
take.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.fitting.bspline import gradient
from vision.fitting.template import Template

GROUPS: dict[str, slice] = {
    "light": slice(0, 2),
    "scale": slice(2, 3),
    "bend": slice(3, 6),
    "stretch": slice(6, 7),
    "shear": slice(7, 8),
    "focus": slice(8, 9),
}
"""Places of each group's amplitudes: the light's factor along x and y, the scale, the factor along xx, xy and yy, and
the stretch along x less that along y, and along the diagonals; places in units of the body's radius, scale and stretch
as the share by which it has grown; variance of the Gaussian by which the body is blurred, px^2."""
N_TERMS = 9  # light along x and y, scale, bend, stretch, shear, focus
ASKED_FOR = 25.0  # chi-squared of a group from which it is believed: one fit in a hundred thousand by chance
PERHAPS = 3.0  # chi-squared with weights over that without, at most
MAX_VARIANCE_INFLATION = 2.0
"""Factor of the variance of the turn by which a group may be paid for, at most: what can hardly be told from the pose
(a tilt about a diagonal, of a long body or one whose grain runs along it) would follow noise. It is left to the
uncertainty."""
MOST_LIGHT = 0.6  # by which light may change over a body's radius, or in a square: more is a shadow's black
MOST_STRAIN = 0.05  # by which a body may grow, stretch or shear in the picture: it leaves the plane of motion

Changes = tuple[float, ...]
REACH_PX = 12  # of the widest blur: six standard deviations
UNCHANGED: Changes = (0.0,) * N_TERMS
LIGHT, TILT, FOCUS = ("light", "bend"), ("stretch", "shear"), ("focus",)
SHAPE = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0])  # terms of the body's shape and focus, not of the light
BLURS = np.array([0.0, 0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0])
"""Variances, px^2, for which a blurred template is made."""
MOST = np.where(np.arange(N_TERMS) == N_TERMS - 1, BLURS[-1], np.where(SHAPE == 1.0, MOST_STRAIN, MOST_LIGHT))
"""Largest amplitudes that are followed."""


class SlowChanges:
    """The terms of one template."""

    def __init__(self, template: Template) -> None:
        self._template = template
        grey = template.columns[3].astype(float) + template.mean_grey
        dx, dy = template.offset_px.astype(float)
        x, y = dx / template.radius_px, dy / template.radius_px
        # a larger body shows at each place what was nearer to its middle
        scale = -(template.columns[1] * dx + template.columns[2] * dy)
        along = template.columns[2] * dy - template.columns[1] * dx
        across = -(template.columns[1] * dy + template.columns[2] * dx)
        self._blurred = _blurred_sensitivities(template)
        blur = (self._blurred[1, 3] - self._blurred[0, 3]) / BLURS[1]
        terms = np.stack([grey * x, grey * y, scale, grey * x * x, grey * x * y, grey * y * y, along, across, blur])
        design = np.vstack([template.columns.astype(float), np.ones(template.n_pixels)])
        self._across = terms @ design.T
        # what the five parameters of the fit cannot follow
        follow = np.linalg.lstsq(template.normal, self._across.T, rcond=None)[0]
        self._terms = terms - follow.T @ design
        self._products = terms @ terms.T
        left = self._terms @ self._terms.T
        self._inverses = {part.start: np.linalg.pinv(left[part, part]) for part in GROUPS.values()}
        self._factors: dict[tuple[int, ...], NDArray[np.float64]] = {}

    def variance_factor(self, changes: Changes) -> NDArray[np.float64]:
        """Factor of the variances of (turn, x, y), (3,), for the terms that are in use."""
        rows = _rows_in_use(changes)
        used = tuple(rows.tolist())
        if used not in self._factors:
            normal, across = self._template.normal, self._across[rows]
            whole = np.block([[normal, across.T], [across, self._products[np.ix_(rows, rows)]]])
            scale = 1.0 / np.sqrt(np.maximum(whole.diagonal(), 1e-300))
            with_terms = np.linalg.pinv(whole * scale[:, None] * scale, rcond=1e-9).diagonal()[:3]
            alone = np.linalg.pinv(normal * scale[:5, None] * scale[:5], rcond=1e-9).diagonal()[:3]
            self._factors[used] = np.maximum(with_terms / np.maximum(alone, 1e-300), 1.0)
        return self._factors[used]

    def measure(
        self,
        weight: NDArray[np.float32],
        residual: NDArray[np.float32],
        gain: float,
        noise_variance: float,
        left_out: tuple[str, ...] = (),
        changes: Changes = UNCHANGED,
    ) -> Changes:
        """Amplitudes, beyond ``changes`` in use, of the group of terms that explains the residuals (n,) of a fit best;
        `UNCHANGED` where each may be chance. ``noise_variance``: of a residual, grey^2; ``left_out``: names of `GROUPS`
        not asked."""
        terms = self._terms_at(changes)
        w = weight.astype(float)
        weighted = w * residual
        # sums, not products of matrices, whose order of adding may depend on threads
        right = np.sum(weighted * terms, axis=1)
        by_noise = gain * float(np.sum(w)) * self._blur_noise_term(changes[8])
        right[8] -= by_noise
        if right[8] < by_noise:  # the noise of the reference is not known well enough to tell
            left_out = (*left_out, "focus")
        best, found = ASKED_FOR, UNCHANGED
        for part in (own for name, own in GROUPS.items() if name not in left_out):
            if PERHAPS * right[part] @ self._inverses[part.start] @ right[part] < best * max(noise_variance, 1e-9):
                continue  # far too little, whatever the weights
            rows = np.arange(N_TERMS)[part]
            if self.variance_factor(_amplitude_vector(rows, np.ones(rows.size)))[0] > MAX_VARIANCE_INFLATION:
                continue
            amplitude = self._solve_terms(terms, rows, w, right)
            if amplitude is not None and (chi2 := float(amplitude @ right[part]) / max(noise_variance, 1e-9)) > best:
                best, found = chi2, _amplitude_vector(rows, amplitude / gain)
        return found

    def update(
        self, weight: NDArray[np.float32], residual: NDArray[np.float32], gain: float, changes: Changes
    ) -> Changes:
        """Change of the amplitudes of the groups in use since ``changes``, by the residuals (n,) of a fit; `UNCHANGED`
        where none is in use or the pixels do not tell."""
        rows = _rows_in_use(changes)
        w, terms = weight.astype(float), self._terms_at(changes)
        right = np.zeros(N_TERMS)
        right[rows] = [float(np.sum(w * residual * terms[row])) for row in rows]
        if changes[8]:
            right[8] -= gain * float(np.sum(w)) * self._blur_noise_term(changes[8])
        amplitude = self._solve_terms(terms, rows, w, right) if rows.size else None
        return UNCHANGED if amplitude is None else _amplitude_vector(rows, amplitude / gain)

    def _blur_noise_term(self, variance: float) -> float:
        """What the reference's noise adds per pixel to the products of residuals and the blur's term, grey^2 / px^2, at
        a blur of ``variance``, px^2: a blurred reference has less noise, so that frames seem the more blurred the
        noisier it is."""
        noise2 = self._template.noise_grey**2 / self._template.n_averaged
        now, more = (
            cv2.getGaussianKernel(2 * REACH_PX + 1, math.sqrt(v)).ravel()
            if v > 0.0
            else np.eye(2 * REACH_PX + 1)[REACH_PX]
            for v in (variance, BLURS[1])
        )
        return float(noise2 * (now[REACH_PX] ** 2 - float(now @ more) ** 2) / BLURS[1])

    def _terms_at(self, changes: Changes) -> NDArray[np.float64]:
        """Design rows (9, n) of the smooth changes, that of the blur at the body's present blur."""
        if changes[8] <= 0.0:
            return self._terms
        terms, k = self._terms.copy(), _next_blur(changes)
        design = np.vstack([self.columns(changes).astype(float), np.ones(self._template.n_pixels)])
        blur = (self._blurred[k, 3] - self._blurred[k - 1, 3]).astype(float) / (BLURS[k] - BLURS[k - 1])
        terms[8] = blur - np.linalg.lstsq(design @ design.T, design @ blur, rcond=None)[0] @ design
        return terms

    def _solve_terms(
        self, terms: NDArray[np.float64], rows: NDArray[np.intp], weight: NDArray[np.float64], rhs: NDArray[np.float64]
    ) -> NDArray[np.float64] | None:
        """Amplitudes (k,) of the terms with indices ``rows`` (k,), by weights (n,) and products ``rhs`` (9,); None
        where the pixels do not tell them apart."""
        normal = np.empty((rows.size, rows.size))
        for i, one in enumerate(rows):
            weighted = weight * terms[one]
            for j, other in enumerate(rows[: i + 1]):
                normal[i, j] = normal[j, i] = float(np.sum(weighted * terms[other]))
        scale = 1.0 / np.sqrt(np.maximum(normal.diagonal(), 1e-300))
        if np.linalg.eigvalsh(normal * scale[:, None] * scale)[0] < 1e-3:
            return None
        return np.asarray(np.linalg.solve(normal, rhs[rows]))

    def offset_px(self, changes: Changes) -> NDArray[np.float32]:
        """Places of the template's pixels on a body of another scale and tilt."""
        _, _, scale, _, _, _, along, across, _ = changes
        stretch = np.array([[1.0 + scale + along, across], [across, 1.0 + scale - along]])
        dx, dy = self._template.offset_px.astype(float)
        return np.stack([a * dx + b * dy for a, b in stretch]).astype(np.float32)

    def columns(self, changes: Changes) -> NDArray[np.float32]:
        """Sensitivities (4, n) of the template as blurred as the body is."""
        if changes[8] <= 0.0:
            return self._template.columns
        k = _next_blur(changes)
        share = np.float32((changes[8] - BLURS[k - 1]) / (BLURS[k] - BLURS[k - 1]))
        return np.asarray(self._blurred[k - 1] + share * (self._blurred[k] - self._blurred[k - 1]))

    def correct_coefficients(
        self, coefficient: NDArray[np.float32], corner: tuple[int, int], pose: NDArray[np.float64], changes: Changes
    ) -> NDArray[np.float32]:
        """Spline coefficients of a region, whose first pixel is at ``corner`` (y, x), divided by the change of light
        over the body at ``pose``."""
        template = self._template
        cosine, sine = math.cos(pose[0]) / template.radius_px, math.sin(pose[0]) / template.radius_px
        height, width = coefficient.shape
        right = np.arange(corner[1], corner[1] + width) - (template.centre_px[0] + pose[1])
        down = np.arange(corner[0], corner[0] + height) - (template.centre_px[1] + pose[2])
        x = (cosine * right)[None, :] + (sine * down)[:, None]
        y = (cosine * down)[:, None] - (sine * right)[None, :]
        return np.asarray(
            coefficient / np.maximum(illumination_factor(changes, x, y), 1.0 - MOST_LIGHT), dtype=np.float32
        )


def _next_blur(changes: Changes) -> int:
    """Index of the first of `BLURS` beyond a blur, of the last where there is none."""
    return min(int(np.searchsorted(BLURS, changes[8], side="right")), len(BLURS) - 1)


def _blurred_sensitivities(template: Template) -> NDArray[np.float32]:
    """Sensitivities (k, 4, n) to turn, x, y and gain of the template blurred by each of the k `BLURS`, variances, px^2;
    all the same where the template has no patch."""
    found = np.repeat(template.columns[None], len(BLURS), axis=0)
    if template.patch is None:
        return found
    dx, dy = template.offset_px.astype(float)
    columns = np.rint(dx + template.centre_px[0] - template.patch_corner_px[0]).astype(np.intp)
    rows = np.rint(dy + template.centre_px[1] - template.patch_corner_px[1]).astype(np.intp)
    for k, variance in enumerate(BLURS[1:], start=1):
        picture = cv2.GaussianBlur(template.patch, (0, 0), math.sqrt(variance), borderType=cv2.BORDER_REPLICATE)
        gx, gy = (slope[rows, columns].astype(float) for slope in gradient(picture))
        found[k] = np.stack([gy * dx - gx * dy, gx, gy, picture[rows, columns] - template.mean_grey])
    return found


def illumination_factor(changes: Changes, x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    """What the light is multiplied by at places in units of the body's radius."""
    along_x, along_y, _, xx, xy, yy, _, _, _ = changes
    return np.asarray(1.0 + x * (along_x + xx * x + xy * y) + y * (along_y + yy * y))


def with_even_illumination(changes: Changes) -> Changes:
    return tuple((np.array(changes) * SHAPE).tolist())


def combine_changes(one: Changes, other: Changes) -> Changes | None:
    """Both changes together; None where that is more than is followed. Nothing is sharper than the still frames."""
    both = np.add(one, other)
    both[8] = max(both[8], 0.0)
    return tuple(both.tolist()) if np.all(np.abs(both) <= MOST) else None


def _rows_in_use(changes: Changes) -> NDArray[np.intp]:
    """Places of the amplitudes of all groups that are not zero."""
    used = [np.arange(N_TERMS)[part] for part in GROUPS.values() if any(changes[part])]
    return np.concatenate(used) if used else np.zeros(0, dtype=np.intp)


def _amplitude_vector(rows: NDArray[np.intp], amplitude: NDArray[np.float64]) -> Changes:
    whole = np.zeros(N_TERMS)
    whole[rows] = amplitude
    return tuple(whole.tolist())
