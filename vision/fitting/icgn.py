"""Rigid inverse-compositional Gauss-Newton fit with Tukey weights: the tracker's default engine.

Method: S. Baker and I. Matthews, Lucas-Kanade 20 years on, Int. J. Comput. Vis. 56, 2004 (inverse
composition); gain and offset are solved in the same 5 x 5 system as turn and shift, so flicker does not bias
the pose. The frame, not the template, is sampled, by cubic B-splines. Weights start from those of the previous frame
and follow the residuals of each iteration. The loop itself is compiled (`vision.fitting.kernels`). A fit that breaks
down or does not converge returns ``converged = False``; nothing is raised.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vision.film.source import SATURATED_SHARE, FrameSource, saturated_grey
from vision.fitting.assessment import (
    COHERENT,
    N_LEVELS,
    TOO_FEW,
    UNKNOWN,
    Assessed,
    BodyFacts,
    Ratios,
    assess_fit,
    coherence_ratios,
    template_blocks,
)
from vision.fitting.base import FAILED, LEAST_NOISE_GREY, MARGIN_PX, Fit, region_of
from vision.fitting.bspline import HALF_TAPS, noise_gain
from vision.fitting.frame_spline import FrameSpline
from vision.fitting.illumination import LocalIllumination
from vision.fitting.kernels import (
    Places,
    Region,
    RigidFit,
    Settings,
    State,
    Subset,
    fit_rigid,
    place_pixels,
    sample_frame,
    tukey_weights,
)
from vision.fitting.pose_covariance import PATTERN_EXCESS, TUKEY_FACTOR, pose_covariance
from vision.fitting.slow_changes import (
    FOCUS,
    LIGHT,
    TILT,
    UNCHANGED,
    Changes,
    SlowChanges,
    combine_changes,
    with_even_illumination,
)
from vision.fitting.template import Template


class FitMemory(NamedTuple):
    """What a fitter carries over, and works in: arrays of `kernels.State`; ``scale`` and ``apart`` (1,), the
    last 1 where the next fit is not a plain one: a cautious start, or light or scale that have changed."""

    weight: NDArray[np.float32]
    work: NDArray[np.float32]
    at: NDArray[np.int32]
    scale: NDArray[np.float64]
    apart: NDArray[np.uint8]

    @classmethod
    def empty(cls, n_pixels: int) -> FitMemory:
        weight, work = np.ones(n_pixels, dtype=np.float32), np.zeros((5, n_pixels), dtype=np.float32)
        return cls(weight, work, np.zeros(n_pixels, dtype=np.int32), np.zeros(1), np.zeros(1, dtype=np.uint8))


class FirstFit(NamedTuple):
    """A first fit from the expected pose that compiled code has done and assessed, with the answer of `assess_fit`."""

    found: RigidFit
    pose: NDArray[np.float64]
    out: Assessed
    lacking: int


TOLERANCE_PX = 0.002
"""Last step of any pixel. With part of the body covered the weights converge slowly: at 0.02 px such fits stopped up
to eight standard uncertainties short."""
STOP_U = 0.1
"""Or: what is left, judged by how fast the steps shrink, over its standard uncertainty. Along the grain of wood a step
of 0.002 px is a small part of that, and asking for it loses frames."""
MAX_ITERATIONS = 80
"""Most fits take two; where noise in the template holds a body of weak texture back, the steps shrink slowly."""
FAR_PX = MARGIN_PX - HALF_TAPS - 2  # a fit that ends further than this from where it began is repeated from there
CHANGE_ROUNDS = 5  # fits of a frame, each under the scale, or the local light, of the one before: choice
QUIET = 0.7
"""The residuals of a body may be quieter than the still frames by this factor, since darker parts of a picture are."""


def fit_settings() -> Settings:
    return Settings(noise_gain(), LEAST_NOISE_GREY, TOLERANCE_PX, STOP_U, MAX_ITERATIONS)


class IcgnFitter:
    """Fits one body; carries the weights of its pixels over from frame to frame."""

    def __init__(self, template: Template, frames: FrameSpline | None = None, memory: FitMemory | None = None) -> None:
        self.template = template
        self._frames = frames
        self._light = LocalIllumination(template)
        self._followed = self._clipped = self._coded = False
        self._settings = fit_settings()
        self.blocks = template.get_or_make(template_blocks)
        self._facts = BodyFacts(
            template.columns,
            template.noise_normal,
            float(template.n_averaged),
            float(template.noise_grey),
            QUIET,
            PATTERN_EXCESS,
            TUKEY_FACTOR,
        )
        memory = FitMemory.empty(template.n_pixels) if memory is None else memory
        self._weight, self._work, self._at, self._scale, self._apart = memory
        self._uncovered = np.zeros(template.n_pixels, dtype=np.uint8)
        self.reset()

    def reset(self, cautious: bool = False) -> None:
        """Forget the weights, noise, light and scale of the previous frame; the next fit begins with equal weights or,
        if ``cautious``, with those that the grey values at its first pose suggest.

        Equal weights mislead a fit where much of the body is hidden, the others one that starts further away.
        """
        self._cautious = cautious
        self._weight.fill(1.0)
        self._scale[0] = 2.0
        self._changes: Changes = UNCHANGED
        self._light.reset()
        self._note_special_case()

    def state(self) -> dict[str, NDArray[Any]]:
        own = {"weight": self._weight, "scale": np.array(self._scale[0]), "changes": np.array(self._changes)}
        return own | self._light.state()

    def restore(self, arrays: dict[str, NDArray[Any]]) -> None:
        self._weight[:], self._scale[0] = arrays["weight"], float(arrays["scale"])
        self._changes = tuple(arrays["changes"].tolist())
        self._light.restore(arrays)
        self._note_special_case()

    def fit(
        self,
        film: FrameSource,
        index: int,
        pose: NDArray[np.float64],
        covered: NDArray[np.uint8] | None,
        first_fit: FirstFit | None = None,
    ) -> Fit:
        """Fit the body in frame ``index`` from ``pose`` (turn, x, y); ``covered`` (n,): 1 at hidden pixels;
        ``first_fit``: one from there that compiled code has done. Weights, light and scale are kept for the next frame
        unless the fit breaks down."""
        result = self._fit_once(film, index, pose, covered, first_fit)
        if result.converged and max(abs(result.pose[1] - pose[1]), abs(result.pose[2] - pose[2])) > FAR_PX:
            # the fit ended where the border of the spline filter spoils the samples
            result = self._fit_once(film, index, result.pose, covered)
        self._note_special_case()
        return result

    def _note_special_case(self) -> None:
        """Note whether the next fit needs more than the compiled loop."""
        self._apart[0] = self._cautious or self._changes != UNCHANGED or self._light.needs_test

    def _fit_once(
        self,
        film: FrameSource,
        index: int,
        start: NDArray[np.float64],
        covered: NDArray[np.uint8] | None,
        first_fit: FirstFit | None = None,
    ) -> Fit:
        """Fit from the pose ``start``, with light and scale estimated anew until the residuals show no other change;
        ``covered`` (n,) is 1 at hidden pixels."""
        template = self.template
        region = region_of(template, start, film.height, film.width)
        if region is None:
            return FAILED
        if self._frames is None or self._frames.film is not film:
            self._frames = FrameSpline(film)
        part = self._frames.filtered_part(index, region)
        coefficient, (y0, _, x0, _) = part.coefficient, part.box
        # turned pixels may fall on one another, two at most
        if 2 * part.n_saturated > SATURATED_SHARE * template.n_pixels:
            saturated = part.saturated_pixels(saturated_grey(film))
            if (
                saturated is not None
                and self._count_marked(saturated, start, y0, x0) > SATURATED_SHARE * template.n_pixels
            ):
                # not a number: the compiled loop leaves out every sample that such a coefficient enters
                coefficient = np.where(saturated, np.float32(np.nan), coefficient)
        self._clipped, self._coded = part.n_saturated > 0, film.compression is not None
        hidden = self._uncovered if covered is None else covered
        if first_fit is None:
            result = self._fit_pose(coefficient, (y0, x0), start, hidden)
        else:
            result = self._conclude_fit(first_fit.found, first_fit.pose, first_fit)
        self._followed = False
        for _ in range(CHANGE_ROUNDS):
            if not result.converged or not self._update_slow_changes(result):
                break
            result = self._fit_pose(coefficient, (y0, x0), result.pose, hidden)
        for k in range(0 if self._clipped else CHANGE_ROUNDS):
            if not result.converged or not self._light.update(
                result, self._work[1], self._work[2], self._changes, k == 0
            ):
                break
            # its squares say all that the gradients did
            self._changes = with_even_illumination(self._changes)
            result = self._fit_pose(coefficient, (y0, x0), result.pose, hidden)
        return result

    def _update_slow_changes(self, fit: Fit) -> bool:
        """Update the smooth changes in use (of light, scale, tilt, blur) by the residuals of ``fit``, the last one;
        return whether they changed, so that another fit is needed."""
        more = UNCHANGED
        suspected = any(one > COHERENT for one in fit.coherence.ratio[-1].tolist())
        if not suspected and self._changes == UNCHANGED:
            return False
        weight, residual = self._weight * self._work[1], self._work[2]
        if self._changes != UNCHANGED and not self._followed:
            # what is in use is a parameter like others, which no threshold holds back
            self._followed = True
            more = self._slow_changes().update(weight, residual, fit.gain, self._changes)
        elif suspected:
            noise_variance = max(fit.noise_grey, LEAST_NOISE_GREY) ** 2
            # where light is known from place to place, or grey values are cut off
            left_out: tuple[str, ...] = LIGHT if self._light.light is not None else TILT if self._clipped else ()
            left_out += FOCUS if self._coded else ()  # a codec blurs, too, and the budget has a term for it
            more = self._slow_changes().measure(weight, residual, fit.gain, noise_variance, left_out, self._changes)
        both = combine_changes(self._changes, more)
        if more == UNCHANGED or both is None:
            return False
        self._changes = both
        return True

    def _slow_changes(self) -> SlowChanges:
        return self.template.get_or_make(SlowChanges)

    def _fit_pose(
        self,
        coefficient: NDArray[np.float32],
        corner: tuple[int, int],
        start: NDArray[np.float64],
        hidden: NDArray[np.uint8],
    ) -> Fit:
        """Fit from the pose ``start`` under the light and scale known so far, in coefficients of a region whose first
        pixel is at ``corner`` (y, x); updates the weights, the noise and the columns in use."""
        template, changed, offset_px = self.template, self._changes != UNCHANGED, self.template.offset_px
        columns = template.columns
        if changed:
            coefficient = self._slow_changes().correct_coefficients(coefficient, corner, start, self._changes)
            offset_px = self._slow_changes().offset_px(self._changes)
            columns = self._slow_changes().columns(self._changes)
        pose = np.array(start, dtype=float)
        coefficient = self._light.correct_coefficients(coefficient, corner, start)
        self._facts = self._facts._replace(columns=columns)
        subset = Subset(offset_px, columns, hidden, *template.centre_px, template.radius_px)
        region = Region(coefficient, float(corner[1]), float(corner[0]))
        if self._cautious:
            self._initialise_weights(region, subset, pose)
            self._cautious = False
        state = State(pose, self._weight, self._work, self._at, float(self._scale[0]))
        return self._conclude_fit(fit_rigid(region, subset, self._settings, state), pose)

    def _conclude_fit(self, found: RigidFit, pose: NDArray[np.float64], first_fit: FirstFit | None = None) -> Fit:
        """Fit at the pose ``pose`` that a loop ``found``, assessed (``first_fit``: already assessed by compiled code),
        its covariance inflated for light and scale; `FAILED`, after a reset, where the loop broke down."""
        if found.iterations <= 0 or not math.isfinite(sum(pose.tolist())):
            self.reset()
            return FAILED
        self._scale[0] = found.sums.scale
        fit = self._assess(found, pose, first_fit)
        if self._changes != UNCHANGED:
            root = np.sqrt(self._slow_changes().variance_factor(self._changes))
            fit = replace(fit, covariance=fit.covariance * root[:, None] * root)
        return self._light.inflate_covariance(fit)

    def _initialise_weights(self, region: Region, subset: Subset, pose: NDArray[np.float64]) -> None:
        """Set weights and scale by the differences of the region's grey values at a pose from the reference's, less
        their median; leave them where no pixel is visible."""
        value, visible = self._work[0], self._work[1]
        places = Places(self._work[3], self._work[4], self._at)
        place_pixels(region, subset, pose, places, visible)
        sample_frame(region, places, value, visible)
        seen = visible > 0.0
        if seen.any():
            difference = value - subset.columns[3]
            difference -= np.median(difference[seen])
            self._scale[0] = max(1.4826 * float(np.median(np.abs(difference[seen]))), LEAST_NOISE_GREY)
            tukey_weights(difference, float(self._scale[0]), self._weight)

    def _count_marked(self, marked: NDArray[np.bool_], pose: NDArray[np.float64], y0: int, x0: int) -> int:
        """Number of the body's pixels at a pose that are marked in the region whose corner is (y0, x0)."""
        dx, dy = self.template.offset_px
        cosine, sine = math.cos(pose[0]), math.sin(pose[0])
        columns = np.rint(self.template.centre_px[0] + pose[1] - x0 + cosine * dx - sine * dy).astype(np.intp)
        rows = np.rint(self.template.centre_px[1] + pose[2] - y0 + sine * dx + cosine * dy).astype(np.intp)
        inside = (rows >= 0) & (rows < marked.shape[0]) & (columns >= 0) & (columns < marked.shape[1])
        return int(np.count_nonzero(marked[rows[inside], columns[inside]]))

    def _assess(self, found: RigidFit, pose: NDArray[np.float64], first_fit: FirstFit | None = None) -> Fit:
        """Fit with quality figures and covariance from the sums of the last iteration; `FAILED` where too few pixels
        agree."""
        sums, n = found.sums, self.template.n_pixels
        if first_fit is None:
            ratios = np.empty((N_LEVELS, 3)), np.empty((N_LEVELS, 3))
            out = Assessed(np.empty(2), np.empty((3, 3)), np.empty((5, 5)), *ratios)
            lacking = assess_fit(self._facts, self.blocks, found, self._work, self._weight, out)
        else:
            out, lacking = first_fit.out, first_fit.lacking
        if lacking == TOO_FEW:
            return FAILED
        covariance, coherence = out.covariance, Ratios(out.ratio, out.blocks)
        variance, zncc = out.figures.tolist()
        if lacking:
            covariance, coherence = self._assess_at_length(found, variance)
        return Fit(
            pose=pose,
            covariance=covariance,
            zncc=zncc,
            inlier=sums.inlier / n,
            seen=sums.seen / n,
            gain=found.gain,
            noise_grey=math.sqrt(variance),
            iterations=found.iterations,
            converged=True,
            coherence=coherence,
            level=sums.value / max(sums.weight, 1.0),
        )

    def _assess_at_length(self, found: RigidFit, variance: float) -> tuple[NDArray[np.float64], Ratios]:
        """Covariance (3, 3) and coherence where a fixed pattern may be in the noise or the matrix is nearly singular;
        ``variance`` of the residuals, grey^2."""
        template, gain = self.template, found.gain
        covariance, inverse = pose_covariance(found.normal, variance, gain, found.noise_gain, template)
        if inverse is None:
            return covariance, UNKNOWN
        white = covariance.diagonal() * (1.0 + gain**2 / template.n_averaged)
        influence = inverse[:3] / gain
        return covariance, coherence_ratios(
            self.blocks, self._facts.columns, self._work, self._weight, influence, white
        )
