"""Illumination that varies over a body: detection, estimation and correction in a fit.

It may change in any way: the edge of a shadow, a reflection that stays while the body moves. Gradients
(`vision.fitting.slow_changes`) do not follow an edge. Method: the body is cut into squares of `TILE_PX`; in each the
median of the residuals over the grey value (a shade, which multiplies), or of the residuals themselves (a glow, which
adds), is what the light has changed by. Between the middles of the squares it is interpolated, and the frame is brought
back to even light. A square whose residuals scatter by much more than noise once that is taken out shows something else
than the body under another light: it is left as it is, and loses its weight as before. The local light takes
information from the pose; the covariance grows by that.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vision.fitting.assessment import COHERENT, HIDDEN_SHARE
from vision.fitting.base import LEAST_NOISE_GREY, MEDIAN_U, Fit
from vision.fitting.bspline import noise_gain
from vision.fitting.kernels import F32, F64, I32, I64
from vision.fitting.slow_changes import MOST_LIGHT, Changes, illumination_factor
from vision.fitting.template import TILE_PX, Template
from vision.kernel_cache import cached_njit, inner_njit


def row_median(values: F64) -> F64:
    """Median of what is known in each row; several times faster than `numpy.nanmedian` on rows this short."""
    ordered, count = np.sort(values, axis=1), np.isfinite(values).sum(axis=1)
    row = np.arange(len(values))
    return np.asarray(0.5 * (ordered[row, (count - 1) // 2] + ordered[row, count // 2]))


def drop_isolated_squares(change: F64) -> F64:
    """Copy of a map of squares (rows, columns; NaN: unknown) without those of whose neighbours fewer than half are
    known: significant by chance."""
    known = np.pad(np.isfinite(change).astype(int), 1)
    rows, columns = change.shape
    inside = np.pad(np.ones(change.shape, dtype=int), 1)
    near, there = (
        sum(one[y : y + rows, x : x + columns] for y in range(3) for x in range(3)) - one[1:-1, 1:-1]
        for one in (known, inside)
    )
    return np.where(2 * near >= there, change, np.nan)


def fill_unknown_squares(change: F64) -> F64:
    """Copy of a map of squares (rows, columns) in which unknown ones (NaN) have, step by step, the mean of their known
    neighbours; zeros where none is known."""
    values = change.copy()
    while np.isnan(values).any():
        padded = np.pad(values, 1, constant_values=np.nan)
        near = np.stack([padded[:-2, 1:-1], padded[2:, 1:-1], padded[1:-1, :-2], padded[1:-1, 2:]])
        known = np.isfinite(near)
        if not known.any():
            return np.zeros_like(values)
        mean = np.where(known, near, 0.0).sum(axis=0) / np.maximum(known.sum(axis=0), 1)
        unknown = np.isnan(values) & known.any(axis=0)
        values[unknown] = mean[unknown]
    return values


LEAST_PIXELS = TILE_PX**2 // 4  # of a square that is looked at: a quarter of it
SAME_TEXTURE = 2.5
"""Scatter of the residuals in a square, and difference of neighbouring ones, over those of noise, up to which it shows
the same texture: an edge of the light lies between few of them, another surface between all."""
EDGE = 0.3  # scatter that is allowed besides, over what the light has changed by: an edge may run through the square
USABLE = 8.0  # residuals over the noise up to which they tell whether light is added or multiplied
SIGNIFICANT_U = 6.0  # a square's change over its standard uncertainty from which it counts
LEAST_CELLS = 4  # of significant squares: fewer may be a glint
BETTER = 0.9  # misfit of all pixels with the local light taken out over that without, at most
OUTLYING = 3.0  # a residual of more standard deviations counts as one of so many
SETTLED = 0.5  # a field that changes by less than this many standard uncertainties in all squares needs no further fit
ROUNDING = 1e-3  # relative, by which a first look is wider than what decides, whose numbers round otherwise
MAX_VARIANCE_INFLATION = 3.0  # of the turn, that local light may cost: choice; beyond it the uncertainty has it


@dataclass(frozen=True)
class Illumination:
    """Change of the light in every square, (rows, columns): ``shade``, a share, and ``glow``, grey; whether the glow is
    what still changes."""

    shade: F64
    glow: F64
    glows: bool = False


class Squares(NamedTuple):
    """Squares of templates: their ``pixel`` numbers (n,), one square's after the other's, and ``grey`` values (n,) in
    that order; ``first``, where each square begins and the last ends; ``middle``, its mean grey value."""

    pixel: I32
    grey: F64
    first: I64
    middle: F64


@inner_njit()
def select_median(values: F64, n: int) -> float:
    """Median of the first ``n`` of ``values``, which are reordered."""
    low, high, at = 0, n - 1, n // 2
    while low < high:
        pivot = values[(low + high) // 2]
        i, j = low, high
        while i <= j:
            while values[i] < pivot:
                i += 1
            while values[j] > pivot:
                j -= 1
            if i <= j:
                values[i], values[j] = values[j], values[i]
                i, j = i + 1, j - 1
        if at <= j:
            high = j
        elif at >= i:
            low = i
        else:
            break
    if n % 2:
        return values[at]
    below = values[0]
    for i in range(1, at):
        below = max(below, values[i])
    return 0.5 * (below + values[at])


@cached_njit(nogil=True)
def can_show_illumination(squares: Squares, visible: F32, residual: F32, gain: float, noise: float) -> bool:
    """Whether enough squares have residuals (n,) beyond ``noise``, their standard deviation by noise, grey, for
    `IlluminationField.detect` to be run; ``visible`` (n,): 1 at pixels that are seen, else 0; ``gain``: of the fit.

    Never False where that finds one: a median beyond a bound has half of its values beyond it, and a scatter below one
    half of them below. By that most squares of a body that something hides in part are done with in one look.
    """
    room = np.empty(visible.size)
    found_shade = found_glow = 0
    for k in range(squares.middle.size):
        start, end = squares.first[k], squares.first[k + 1]
        if end - start < LEAST_PIXELS:
            continue
        middle, least = (
            max(gain * squares.middle[k], 1.0),
            (1.0 - ROUNDING) * SIGNIFICANT_U * MEDIAN_U * noise / math.sqrt(end - start),
        )
        count = loud_shade = loud_glow = 0
        for j in range(start, end):
            i = squares.pixel[j]
            seen, size = visible[i] > 0.0, abs(residual[i])
            count += seen
            loud_glow += seen & (size > least)
            loud_shade += seen & (size * middle > least * max(gain * squares.grey[j], 1.0))
        if count < LEAST_PIXELS:
            continue
        for glows in (False, True):
            if 2 * (loud_glow if glows else loud_shade) < count:
                continue
            n = 0
            for j in range(start, end):
                i = squares.pixel[j]
                if visible[i] > 0.0:
                    room[n] = residual[i] if glows else residual[i] / max(gain * squares.grey[j], 1.0)
                    n += 1
            change = select_median(room, n) * (1.0 if glows else middle)
            size = abs(change)
            if (
                size * math.sqrt(count) < (1.0 - ROUNDING) * SIGNIFICANT_U * MEDIAN_U * noise
                or size > (1.0 + ROUNDING) * MOST_LIGHT * middle
            ):
                continue
            most, near = (1.0 + ROUNDING) * (SAME_TEXTURE * noise + EDGE * size) / 1.4826, 0
            for j in range(start, end):
                i = squares.pixel[j]
                off = residual[i] - change * (1.0 if glows else gain * squares.grey[j] / middle)
                near += (visible[i] > 0.0) & (abs(off) <= most)
            believed = 2 * near >= count
            found_glow, found_shade = found_glow + (glows & believed), found_shade + (believed & (not glows))
        if max(found_glow, found_shade) >= LEAST_CELLS:
            return True
    return False


class IlluminationField:
    """The squares of one template."""

    def __init__(self, template: Template) -> None:
        self._template = template
        left, right, top, bottom = template.box_px
        self._origin = np.array([left, top])
        self.shape = (max(1, round((bottom - top) / TILE_PX)), max(1, round((right - left) / TILE_PX)))
        self._size = np.array([(right - left + 1.0) / self.shape[1], (bottom - top + 1.0) / self.shape[0]])
        place = (template.offset_px.astype(float) - self._origin[:, None]) / self._size[:, None]
        column, row = (
            np.clip(np.floor(one), 0, most - 1).astype(int) for one, most in zip(place, self.shape[::-1], strict=True)
        )
        cell = row * self.shape[1] + column
        count = np.bincount(cell, minlength=self.shape[0] * self.shape[1])
        self._cell = cell
        self._grey = template.columns[3].astype(float) + template.mean_grey
        self._middle_grey = (np.bincount(cell, self._grey, count.size) / np.maximum(count, 1)).reshape(self.shape)
        order = np.argsort(cell, kind="stable")
        self.squares = Squares(
            order.astype(np.int32), self._grey[order], np.append(0, np.cumsum(count)), self._middle_grey.reshape(-1)
        )
        self._offset = template.offset_px.astype(float)
        self._factor: F64 | None = None

    @cached_property
    def _members(self) -> NDArray[np.intp]:
        return _pad_by_square(self._cell, self._middle_grey.size, self._cell.size)

    @cached_property
    def _pairs(self) -> list[tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.intp]]]:
        """Neighbouring pixels, and which pairs of them begin in each square."""
        n = self._middle_grey.size
        return [
            (one, other, _pad_by_square(self._cell[one], n, one.size))
            for one, other in _neighbour_pairs(self._template)
        ]

    def detect(
        self, visible: NDArray[np.float32], residual: NDArray[np.float32], gain: float, noise: float
    ) -> F64 | None:
        """Change of light that residuals (n,) of a fit under even light show, grey, (rows, columns); None where they
        show none. ``noise`` is the standard deviation of a residual that is noise, grey."""
        if not can_show_illumination(self.squares, visible, residual, gain, noise):
            return None
        seen, left = visible > 0.0, residual.astype(float)
        found = self._fit_change(None, left, seen, gain, noise)
        if found is None or np.count_nonzero(found[1] > SIGNIFICANT_U) < LEAST_CELLS:
            return None
        change = found[0] / self._unit(found[2], gain)
        before, after = (
            _clipped_chi_square(one[seen], noise) for one in (left, left - self._interpolate(change, self._offset))
        )
        return change if after <= BETTER * before else None

    def estimate_light(
        self, factor: F64, visible: NDArray[np.float32], residual: NDArray[np.float32], gain: float, noise: float
    ) -> Illumination | None:
        """First estimate of the light from residuals (n,) of a fit under even light; ``factor`` (rows, columns): what
        that light was multiplied by in the squares' middles. None where they show no change."""
        found = self._fit_change(None, residual.astype(float), visible > 0.0, gain, noise)
        if found is None:
            return None
        return self._add_change(Illumination(factor - 1.0, np.zeros(self.shape), found[2]), found[0])

    def update_light(
        self,
        light: Illumination,
        visible: NDArray[np.float32],
        residual: NDArray[np.float32],
        gain: float,
        noise: float,
    ) -> Illumination | None:
        """The light by residuals (n,) of a fit under ``light``; ``noise`` is a residual's standard deviation by noise,
        grey. None where the residuals show no other light."""
        found = self._fit_change(light, residual.astype(float), visible > 0.0, gain, noise)
        if found is None:
            return None
        change, sure, glows = found
        if glows == light.glows:
            return self._add_change(light, change) if sure.max() > SETTLED else None
        # what was taken for one is the other
        unit = self._unit(False, gain)
        if glows:
            return self._add_change(Illumination(np.zeros(self.shape), light.shade / unit, True), change)
        return self._add_change(Illumination(light.shade + light.glow * unit, np.zeros(self.shape), False), change)

    def _unit(self, glows: bool, gain: float) -> F64:
        """What a change by one grey level in the middle of a square is: a grey level of glow, a share of shade."""
        return np.ones(self.shape) if glows else 1.0 / (gain * np.maximum(self._middle_grey, 1.0))

    def _fit_change(
        self, light: Illumination | None, residual: F64, seen: NDArray[np.bool_], gain: float, noise: float
    ) -> tuple[F64, F64, bool] | None:
        """Change of light of every square (rows, columns), grey of glow or share of shade; change over its standard
        uncertainty in the squares believed; whether it is glow. None where none is believed. ``light``: None for even.
        """
        off = np.append(np.where(seen, residual, np.nan), np.nan)[self._members]
        count = np.isfinite(off).sum(axis=1)
        enough = np.flatnonzero(count >= LEAST_PIXELS)
        if not enough.size:
            return None
        off, grey = off[enough], gain * np.append(self._grey, np.nan)[self._members[enough]]
        middle = np.maximum(gain * self._middle_grey.reshape(-1)[enough], 1.0)
        change = row_median(off)
        glows = self._is_additive(light, change, off, grey / middle[:, None], (middle, enough, noise))
        if not glows:
            change = row_median(off / np.maximum(grey, 1.0)) * middle
        u = MEDIAN_U * noise / np.sqrt(count[enough])
        off -= change[:, None] * (1.0 if glows else grey / middle[:, None])
        scatter = 1.4826 * row_median(np.abs(off))
        whole = np.full(self.shape[0] * self.shape[1], np.nan)
        believed = (scatter < SAME_TEXTURE * noise + EDGE * np.abs(change)) & (np.abs(change) < MOST_LIGHT * middle)
        left = np.full(residual.size + 1, np.nan)
        left[self._members[enough]] = off
        believed &= self._square_noise(left[:-1])[enough] < SAME_TEXTURE * noise
        whole[enough[believed]] = change[believed]
        known = drop_isolated_squares(whole.reshape(self.shape)).reshape(-1)
        sure = np.abs(known[enough]) / u
        if not np.isfinite(sure).any():
            return None
        return fill_unknown_squares(known.reshape(self.shape)) * self._unit(glows, gain), sure[np.isfinite(sure)], glows

    def _square_noise(self, residual: F64) -> F64:
        """Noise (squares,), grey, from differences of neighbouring residuals (n,), along the noisier axis."""
        rough = np.zeros(self._members.shape[0])
        for one, other, squares in self._pairs:
            apart = np.append(np.abs(residual[one] - residual[other]), np.nan)[squares]
            known = np.isfinite(apart).any(axis=1)
            rough[known] = np.maximum(rough[known], 1.4826 / np.sqrt(2.0) * row_median(apart[known]))
        return rough

    def _is_additive(
        self,
        light: Illumination | None,
        change: F64,
        off: F64,
        share: F64,
        squares: tuple[F64, NDArray[np.intp], float],
    ) -> bool:
        """Whether light is added, by the texture's contrast; of k squares with p pixels: ``change`` (k,), residuals
        ``off`` (k, p), ``share`` (k, p) of grey over the square's middle; ``squares``: middle grey (k,), indices (k,),
        noise."""
        middle, which, noise = squares
        whole = change.copy()
        if light is not None:
            whole += light.glow.reshape(-1)[which] + light.shade.reshape(-1)[which] * middle
        # a shade changes the contrast inside a square by the share that it changes the light
        contrast, left = whole[:, None] * (share - 1.0), off - change[:, None]
        use = np.abs(left) < USABLE * noise
        power = float(np.sum(contrast[use] ** 2))
        found = float(np.sum(contrast[use] * left[use])) / power if power > 0.0 else 0.0
        return found + (0.0 if light is None or light.glows else 1.0) < 0.5

    def variance_inflation(self) -> F64:
        """Factor of the variances of (turn, x, y), (3,): what is left of the information where each square has a light
        of its own."""
        if self._factor is None:
            template = self._template
            design = np.vstack([template.columns.astype(float), np.ones(template.n_pixels)])
            cells = self._members.shape[0]
            across = np.stack([np.bincount(self._cell, row, cells) for row in design[:3]])
            # the squares' own block is diagonal
            left = (
                template.normal[:3, :3] - (across / np.maximum(np.bincount(self._cell, minlength=cells), 1)) @ across.T
            )
            alone, with_field = (_inverse_diagonal(one) for one in (template.normal, left))
            self._factor = np.maximum(with_field / np.maximum(alone[:3], 1e-300), 1.0)
        return self._factor

    def _add_change(self, light: Illumination, more: F64) -> Illumination:
        """The light with ``more`` (rows, columns) of it: added where it glows, else multiplied and limited."""
        if light.glows:
            return Illumination(light.shade, light.glow + more, True)
        return Illumination(
            np.clip((1.0 + light.shade) * (1.0 + more) - 1.0, -MOST_LIGHT, MOST_LIGHT / (1.0 - MOST_LIGHT)),
            light.glow,
            False,
        )

    def middles_px(self) -> F64:
        """Offsets (2, rows, columns) of the squares' middles from the body's."""
        rows, columns = self.shape
        y, x = np.mgrid[0:rows, 0:columns] + 0.5
        return np.stack([x, y]) * self._size[:, None, None] + self._origin[:, None, None]

    def correct_coefficients(
        self, coefficient: NDArray[np.float32], corner: tuple[int, int], pose: F64, light: Illumination
    ) -> NDArray[np.float32]:
        """Spline coefficients of a region, whose first pixel is at ``corner`` (y, x), brought back to even light for
        the body at ``pose``."""
        template = self._template
        height, width = coefficient.shape
        cosine, sine = math.cos(pose[0]), math.sin(pose[0])
        right = np.arange(corner[1], corner[1] + width) - (template.centre_px[0] + pose[1])
        down = np.arange(corner[0], corner[0] + height) - (template.centre_px[1] + pose[2])
        place = np.stack(
            [
                (cosine * right)[None, :] + (sine * down)[:, None],
                (cosine * down)[:, None] - (sine * right)[None, :],
            ]
        ).reshape(2, -1)
        shade, glow = (self._interpolate(one, place).reshape(height, width) for one in (light.shade, light.glow))
        return np.asarray((coefficient - glow) / np.maximum(1.0 + shade, 1.0 - MOST_LIGHT), dtype=np.float32)

    def _interpolate(self, values: F64, offset: F64) -> F64:
        """Values (n,) at offsets (2, n), px, x then y, from the body's middle: linear between the middles of the
        squares, whose ``values`` are (rows, columns)."""
        if not values.any():
            return np.zeros(offset.shape[1])
        place = (offset - self._origin[:, None]) / self._size[:, None] - 0.5
        rows, columns = self.shape
        x, y = np.clip(place[0], 0.0, columns - 1.0), np.clip(place[1], 0.0, rows - 1.0)
        column, row = np.minimum(x.astype(int), max(columns - 2, 0)), np.minimum(y.astype(int), max(rows - 2, 0))
        fx, fy = x - column, y - row
        next_column, next_row = np.minimum(column + 1, columns - 1), np.minimum(row + 1, rows - 1)
        above = values[row, column] * (1.0 - fx) + values[row, next_column] * fx
        below = values[next_row, column] * (1.0 - fx) + values[next_row, next_column] * fx
        return np.asarray(above * (1.0 - fy) + below * fy)


def _inverse_diagonal(normal: F64) -> F64:
    scale = 1.0 / np.sqrt(np.maximum(normal.diagonal(), 1e-300))
    return np.asarray(np.linalg.pinv(normal * scale[:, None] * scale, hermitian=True).diagonal() * scale**2)


def _pad_by_square(square: NDArray[np.intp], n_squares: int, padding: int) -> NDArray[np.intp]:
    """Indices (n_squares, most) of what lies in each square, by the square of each item (n,), padded with
    ``padding``."""
    count = np.bincount(square, minlength=n_squares)
    order = np.argsort(square, kind="stable")
    places = np.full((n_squares, int(count.max(initial=1))), padding)
    places[square[order], np.arange(square.size) - np.repeat(np.cumsum(count) - count, count)] = order
    return places


def _neighbour_pairs(template: Template) -> list[tuple[NDArray[np.intp], NDArray[np.intp]]]:
    """Neighbouring pixels of a template: indices (k,) of pixels and (k,) of those to their right, then of pixels and of
    those below."""
    x, y = np.rint(template.offset_px - template.offset_px.min(axis=1, keepdims=True)).astype(int)
    grid = np.full((y.max() + 2, x.max() + 2), -1)
    grid[y, x] = np.arange(x.size)
    found = []
    for beside in (grid[y, x + 1], grid[y + 1, x]):
        one = np.flatnonzero(beside >= 0)
        found.append((one, beside[one]))
    return found


def _clipped_chi_square(residual: F64, noise: float) -> float:
    return float(np.mean(np.minimum(np.abs(residual) / noise, OUTLYING) ** 2)) if residual.size else 0.0


ALIKE = 0.7  # correlation of the changes that two fits show, from which they are the same light
MEAN_NOISE_GAIN = float(noise_gain().mean())
"""Frozen into compiled code."""


@cached_njit(nogil=True)
def residual_noise(noise_grey: float, gain: float, n_averaged: float) -> float:
    """Standard deviation of a residual that is noise, grey."""
    return max(noise_grey, LEAST_NOISE_GREY) * math.sqrt(MEAN_NOISE_GAIN**2 + gain**2 / n_averaged)


class LocalIllumination:
    """What the light of one body is; even at first."""

    def __init__(self, template: Template) -> None:
        self._template = template
        self.reset()

    def reset(self) -> None:
        self.light: Illumination | None = None
        self._shown: F64 | None = None

    @property
    def needs_test(self) -> bool:
        """Whether the next fit must be asked about the light, however good it is."""
        return self.light is not None or self._shown is not None

    def state(self) -> dict[str, NDArray[Any]]:
        """Arrays of the present illumination, ``shade``, ``glow`` and ``glows``, and of the candidate that is not yet
        accepted, ``shown``; empty where there is none."""
        light, nothing = self.light, np.zeros((0, 0))
        return {
            "shade": nothing if light is None else light.shade,
            "glow": nothing if light is None else light.glow,
            "glows": np.array(light is not None and light.glows),
            "shown": nothing if self._shown is None else self._shown,
        }

    def restore(self, arrays: dict[str, NDArray[Any]]) -> None:
        shade, shown = arrays["shade"], arrays["shown"]
        self.light = Illumination(shade, arrays["glow"], bool(arrays["glows"])) if shade.size else None
        self._shown = shown if shown.size else None

    def update(
        self,
        fit: Fit,
        visible: NDArray[np.float32],
        residual: NDArray[np.float32],
        changes: Changes,
        is_first_fit: bool,
    ) -> bool:
        """Update ``light`` from residuals (n,) of a fit, where ``visible`` (n,) is 1 at seen pixels, else 0; return
        whether it changed (fit again). A first change must show in two frames; ``changes``: smooth ones in use."""
        hidden = fit.seen - fit.inlier > HIDDEN_SHARE
        suspected = hidden or any(one > COHERENT for one in fit.coherence.ratio[-1].tolist())
        if self.light is None and not (is_first_fit and suspected):
            if is_first_fit:
                self._shown = None
            return False
        field, noise = self._squares(), self._noise(fit.gain)
        if self.light is not None:
            light = field.update_light(self.light, visible, residual, fit.gain, noise)
        else:
            change = (
                field.detect(visible, residual, fit.gain, noise)
                if field.variance_inflation()[0] <= MAX_VARIANCE_INFLATION
                else None
            )
            before, self._shown = self._shown, change
            if change is None or before is None or np.corrcoef(before.ravel(), change.ravel())[0, 1] < ALIKE:
                return False
            factor = illumination_factor(changes, *(field.middles_px() / self._template.radius_px))
            light = field.estimate_light(factor, visible, residual, fit.gain, noise)
        if light is None:
            return False
        self.light, self._shown = light, None
        return True

    def correct_coefficients(
        self, coefficient: NDArray[np.float32], corner: tuple[int, int], pose: F64
    ) -> NDArray[np.float32]:
        if self.light is None:
            return coefficient
        return self._squares().correct_coefficients(coefficient, corner, pose, self.light)

    def inflate_covariance(self, fit: Fit) -> Fit:
        if self.light is None:
            return fit
        root = np.sqrt(self._squares().variance_inflation())
        return replace(fit, covariance=fit.covariance * root[:, None] * root)

    def _squares(self) -> IlluminationField:
        return self._template.get_or_make(IlluminationField)

    def _noise(self, gain: float) -> float:
        return residual_noise(self._template.noise_grey, gain, float(self._template.n_averaged))
