"""Fit of a mark: as `vision.fitting.icgn`, with only the motions that its pixels can show.

A round dot shows no turn, a straight line no motion along itself. Gain, offset and these motions are fitted by inverse
composition with Tukey's weights; samples, weights and sums are those of the fit of bodies. A mark has hundreds of
pixels, so that NumPy serves for the rest.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from vision.angles import turn_matrix
from vision.errors import BodyError
from vision.film.source import FrameSource, saturated_grey
from vision.fitting.assessment import coherence_ratios, template_blocks
from vision.fitting.base import FAILED, MARGIN_PX, Fit, Fitter, region_of
from vision.fitting.bspline import noise_gain
from vision.fitting.frame_spline import FrameSpline
from vision.fitting.icgn import QUIET, SCALE_FLOOR_GREY
from vision.fitting.kernels import Places, Region, Subset, mean_noise_gain, place_pixels, sample_frame, tukey_weights
from vision.fitting.pose_covariance import MOST_PATTERN, TUKEY_FACTOR
from vision.fitting.template import Template, design_columns, noise_normal_matrix
from vision.marks.mark import LineMark, Mark
from vision.reference.still_average import Reference

MAX_ITERATIONS = 60
TOLERANCE_PX = 0.002  # of a step that ends the fit
STOP_U = 0.05  # of the remaining steps, in standard uncertainties, at which it ends too
TURN_U_RAD = 0.01
"""A point whose turn in one frame is known better than this is followed with its turn."""
LEAST_U_PX = 1.0
"""A mark known worse than this in one frame is refused."""
UNTURNED = 1e-18
"""Variance of a turn that is not fitted, rad^2: a variance of nothing means a failed fit elsewhere."""
F64 = NDArray[np.float64]


def mark_template(mark: Mark, reference: Reference) -> tuple[Template, F64]:
    """Pixels of a mark with their sensitivities, and the motions (3, k) that they show: columns of (turn, x, y)."""
    height, width = reference.picture.shape
    mask = mark.mask(height, width) & ~reference.saturated
    rows, cols = np.nonzero(mask)
    if rows.size < 20:
        raise BodyError(
            f"mark {mark.name}: {rows.size} usable pixels in the {width} x {height} picture, at least 20 needed; draw "
            "it larger or inside"
        )
    centre = (float(cols.mean()), float(rows.mean()))
    columns, dx, dy = design_columns(reference.picture, mask, centre)
    noise = max(reference.noise_grey, 0.3)
    template = Template(
        name=mark.name,
        centre_px=centre,
        offset_px=np.stack([dx, dy]).astype(np.float32),
        columns=np.ascontiguousarray(columns[:, :4].T, dtype=np.float32),
        mean_grey=float(reference.picture[mask].mean()),
        normal=columns.T @ columns,
        radius_px=float(np.hypot(dx, dy).max()),
        noise_normal=noise_normal_matrix(dx, dy, noise**2 / reference.n_averaged),
        n_averaged=reference.n_averaged,
        box_px=(float(dx.min()), float(dx.max()), float(dy.min()), float(dy.max())),
        noise_grey=noise,
    )
    return template, _motions(mark, template)


def _motions(mark: Mark, template: Template) -> F64:
    if isinstance(mark, LineMark):
        choices = [np.array([[1.0, 0.0], [0.0, mark.normal[0]], [0.0, mark.normal[1]]])]
    else:
        choices = [np.eye(3), np.eye(3)[:, 1:]]
    for motions in choices:
        inverse = _restricted_inverse(template.normal - template.noise_normal, motions)
        if inverse is None:
            continue
        u = template.noise_grey * np.sqrt(np.diag(_expand_motions(motions) @ inverse @ _expand_motions(motions).T)[:3])
        if u[0] < TURN_U_RAD * (1.0 if motions.shape[1] == 3 else 100.0) and max(u[1], u[2]) < LEAST_U_PX:
            return motions
    what = "edge" if isinstance(mark, LineMark) else "spot with contrast in all directions"
    raise BodyError(f"mark {mark.name}: there is no {what} to follow; look at its place on the first frame")


class MarkFitter(Fitter):
    """Fits one mark; carries the weights of its pixels over from frame to frame."""

    def __init__(self, template: Template, motions: F64, frames: FrameSpline) -> None:
        self.template, self.motions = template, motions
        is_line = motions.shape[1] == 2 and motions[0, 0] != 0.0
        self._along = np.array([-motions[2, 1], motions[1, 1]]) if is_line else None
        self._frames = frames
        self._design = np.vstack([template.columns, np.ones(template.n_pixels)]).astype(float)
        self._reduced = _expand_motions(motions).T @ self._design  # (k + 2, n)
        self._blocks = template.get_or_make(template_blocks)
        n = template.n_pixels
        self._work, self._at = np.zeros((5, n), dtype=np.float32), np.zeros(n, dtype=np.int32)
        self._nothing = np.zeros(n, dtype=np.uint8)
        self.reset()

    def reset(self, cautious: bool = False) -> None:
        """Forget the weights of the frame before."""
        self._weight = np.ones(self.template.n_pixels, dtype=np.float32)

    def fit(self, film: FrameSource, index: int, pose: F64, covered: NDArray[np.uint8] | None) -> Fit:
        found = self._fit_once(film, index, pose, covered)
        if found.converged and np.abs(found.pose[1:] - pose[1:]).max() > MARGIN_PX - 9:
            found = self._fit_once(film, index, found.pose, covered)
        return found

    def _fit_once(self, film: FrameSource, index: int, start: F64, covered: NDArray[np.uint8] | None) -> Fit:
        template = self.template
        box = region_of(template, start, film.height, film.width)
        if box is None:
            return FAILED
        part = self._frames.filtered_part(index, box)
        coefficient = part.coefficient
        saturated = part.saturated_pixels(saturated_grey(film))
        if saturated is not None:
            coefficient = np.where(saturated, np.float32(np.nan), coefficient)
        region = Region(coefficient, float(part.box[2]), float(part.box[0]))
        hidden = self._nothing if covered is None else covered
        subset = Subset(template.offset_px, template.columns, hidden, *template.centre_px, template.radius_px)
        places = Places(self._work[3], self._work[4], self._at)
        value, visible, residual = self._work[0], self._work[1], self._work[2]
        pose, before, rate = np.array(start, dtype=float), np.inf, 0.0
        for iteration in range(1, MAX_ITERATIONS + 1):
            place_pixels(region, subset, pose, places, visible)
            sample_frame(region, places, value, visible)
            weight = (self._weight * visible).astype(float)
            normal = (self._reduced * weight) @ self._reduced.T
            inverse = _invert_or_none(normal)
            if inverse is None:
                return FAILED
            q = inverse @ (self._reduced @ (weight * value))
            gain = float(q[-2])
            if abs(gain) < 1e-3 or not np.all(np.isfinite(q)):
                return FAILED
            residual[:] = value - self._reduced.T @ q
            scale = max(1.4826 * float(np.median(np.abs(residual[visible > 0.0]))), SCALE_FLOOR_GREY)
            tukey_weights(residual, scale, self._weight)
            step = self.motions @ q[:-2] / gain
            if not (abs(step[0]) < 1.0 and np.abs(step[1:]).max() < 100.0):
                return FAILED
            pose[0] -= step[0]
            pose[1:] -= (turned := turn_matrix(pose[0])) @ step[1:]
            variance = float(np.sum(weight * residual**2) / max(weight.sum(), 1.0))
            size = float(np.max(np.abs(q[:-2]) / np.sqrt(np.maximum(np.diag(inverse)[:-2] * variance, 1e-30))))
            rate, before = max(min(size / before, 0.95), 0.7 * rate), size
            small = max(abs(step[0]) * template.radius_px, abs(step[1]), abs(step[2])) < TOLERANCE_PX
            if iteration > 1 and (small or (size < 1.0 and size * rate / (1.0 - rate) < STOP_U)):
                if self._along is not None:
                    # left free, a line slides along itself ever faster, as it is predicted to go on
                    slide = turned @ self._along
                    pose[1:] += slide * ((start - pose)[1:] @ self._along) / (slide @ self._along)
                return self._assess(pose, gain, scale, mean_noise_gain(places, visible, noise_gain()), iteration)
        return FAILED

    def _assess(self, pose: F64, gain: float, scale: float, kappa: float, iterations: int) -> Fit:
        """Quality figures and covariance from the last iteration."""
        template = self.template
        value, visible, residual = (row.astype(float) for row in self._work[:3])
        weight = self._weight * visible
        total, seen = float(weight.sum()), float(visible.sum())
        free = 1.0 - len(self._reduced) / max(seen, len(self._reduced) + 1.0)
        if total <= 2.0 * len(self._reduced):
            return FAILED
        variance = float(np.sum(weight * residual**2)) / (total * free)
        still = QUIET * template.noise_grey * min(abs(gain), 1.0)
        variance = max(variance, still**2 * (kappa + gain**2 / template.n_averaged))
        spread = float(np.sum(weight * value**2)) / total - (float(np.sum(weight * value)) / total) ** 2
        explained = 1.0 - variance * free / spread if spread > 0.0 else 0.0
        normal = (self._design * weight) @ self._design.T
        noise = variance / (kappa + gain**2 / template.n_averaged)
        inverse = _restricted_inverse(normal - normal[4, 4] / template.n_pixels * template.noise_normal, self.motions)
        if inverse is None:
            inverse = _restricted_inverse(normal * (1.0 - MOST_PATTERN), self.motions)
        if inverse is None:
            return FAILED
        out = _expand_motions(self.motions)
        influence = out @ inverse @ out.T  # of all five parameters per score
        covariance = TUKEY_FACTOR * noise * (influence @ normal @ influence)[:3, :3] / gain**2
        covariance[0, 0] = max(covariance[0, 0], UNTURNED)
        white = np.maximum(covariance.diagonal() * (1.0 + gain**2 / template.n_averaged), 1e-30)
        ratios = coherence_ratios(self._blocks, template.columns, self._work, self._weight, influence[:3] / gain, white)
        return Fit(
            pose=pose.copy(),
            covariance=covariance,
            zncc=math.copysign(math.sqrt(max(explained, 0.0)), gain),
            inlier=float(np.sum(visible * (np.abs(residual) < 3.0 * scale))) / template.n_pixels,
            seen=seen / template.n_pixels,
            gain=gain,
            noise_grey=math.sqrt(variance),
            iterations=iterations,
            converged=True,
            coherence=ratios,
        )


def _expand_motions(motions: F64) -> F64:
    """Columns (5, k + 2) of the five parameters: the motions, gain and offset."""
    k = motions.shape[1]
    out = np.zeros((5, k + 2))
    out[:3, :k], out[3, k], out[4, k + 1] = motions, 1.0, 1.0
    return out


def _restricted_inverse(normal: F64, motions: F64) -> F64 | None:
    """Inverse of a normal matrix (5, 5) restricted to the motions, gain and offset."""
    return _invert_or_none(_expand_motions(motions).T @ normal @ _expand_motions(motions))


def _invert_or_none(normal: F64) -> F64 | None:
    """Inverse of a normal matrix; None where it is not positive."""
    diagonal = normal.diagonal()
    if not (diagonal.min() > 0.0 and np.isfinite(normal.sum())):
        return None
    scale = 1.0 / np.sqrt(diagonal)
    both = scale[:, None] * scale
    if np.linalg.eigvalsh(normal * both)[0] < 1e-6:
        return None
    return np.asarray(np.linalg.inv(normal * both) * both)
