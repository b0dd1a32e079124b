"""Detect parts of an outline that move against the rest: two bodies in one outline, a joint or a crack.

The weights of a fit leave out what does not agree with the body, so that an outline over two bodies is tracked by one
of them, and nothing in a single frame tells why the rest does not agree: it may be hidden. Method: the outline is cut
into tiles; in frames spread over the motion each tile is shifted from where the body's pose has it to where it fits the
frame best, from its shift in the frame before. A hidden tile fits nowhere; one that fits elsewhere, in many frames, by
more than its uncertainty and clearly better, moves. A common change of scale is allowed for. Only bodies whose
residuals are coherent, or of which much does not agree, are looked at. A body that bends gently has no such part: its
tiles are shifted across its length by the square of their place along it.

Bodies of which something hides a part are fitted once more without it, and confirmed or widened. Weights suppress what
hides a body, but not all of it: where it is like the body, some of its pixels keep their weight.
Method: squares of the template in which many pixels do not agree are left out altogether, and the rest is fitted from
the pose found. Where both poses agree within what leaving pixels out makes of noise, the first, which uses more of the
body, stands without the flag, and its uncertainty is at least their difference; where they do not, the flag stays and
their difference goes into the uncertainty.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vision.angles import turn_matrix
from vision.fitting.assessment import COHERENT, HIDDEN_SHARE, template_blocks
from vision.fitting.base import ROUNDING_GREY, Fit, region_of
from vision.fitting.frame_spline import FrameSpline
from vision.fitting.icgn import IcgnFitter
from vision.fitting.illumination import SIGNIFICANT_U
from vision.fitting.kernels import Places, Region, Subset, place_pixels, sample_frame
from vision.fitting.template import Template
from vision.frame_fit.judgement import MIN_INLIER, SAME_INLIER
from vision.reference.first_light import MOST_GAIN
from vision.reference.prepared_film import PreparedFilm
from vision.results.flags import FrameFlag
from vision.results.pose_table import PoseTable, pose_difference
from vision.tracking.segments import AGREE_PX
from vision.uncertainty.coherence import inflate_covariance

TILE_PX = 24  # side of a tile
LEAST_PIXELS = TILE_PX**2 // 4  # of a tile that is fitted by itself: a quarter of it
ROWS = 24  # of a body that are looked at, spread over its way
ITERATIONS = 6  # of a tile's fit
MOST_LEFT, LEFT_CONTRAST = 2.5, 0.03  # of the noise's variance and of the texture's: a tile that fits leaves no more
SEEN = 0.8  # share of a tile that lies in the picture
MOST_STEP_PX = 4.0  # further from its last place a tile is not looked for
MOST_TURN_RAD = MOST_STEP_PX / TILE_PX  # by which its rim moves about as far
LEAST_PX = 0.5  # a tile has moved, a body sags, by more, and by more than `SIGNIFICANT_U` standard uncertainties
EXPLAINED = 0.5  # share of what is left, beyond noise or a rigid motion, that a shift or a sag must explain
OFTEN = 0.25  # share of the rows in which it has
LEAST_TILES = 3  # that must have moved: a motion has three unknowns
COMMON, ALONE = 0.4, 0.15  # share of them that share a motion, and of a tile's way that it may be off that: choice
SHARE = 0.1  # share of the tiles that must have moved
F64 = NDArray[np.float64]


@dataclass(frozen=True)
class MovingParts:
    """What moves against the rest of a body's outline."""

    share: float
    """Of the tiles that can be judged."""
    most_px: float
    """Largest shift."""
    at_px: tuple[float, float]
    """Middle of the tile with the largest shift (x, y), in the reference."""
    bends: bool = False
    """Whether the shifts are those of a body that bends."""


def find_moving_parts(ready: PreparedFilm, table: PoseTable) -> dict[str, MovingParts]:
    """Parts that move against the rest of their outline, by the name of the body: share of its tiles, largest shift,
    px, where that is, and whether the body bends; bodies without any are left out."""
    found = {}
    for i, template in enumerate(ready.templates):
        if not _needs_test(table, i):
            continue
        parts = _find_moving_tiles(ready, template, *_sample_poses(table, i, template.radius_px))
        if parts is not None:
            found[template.name] = parts
    return found


def _needs_test(table: PoseTable, i: int) -> bool:
    """Whether the residuals of the i-th body are coherent enough to test its outline for moving parts."""
    good = ~table.is_lost[:, i]
    if np.count_nonzero(good) < ROWS // 3:
        return False
    inlier = table.inlier[good, i]
    coherence = table.ratio[good, i, -1].max(axis=1)
    coherence = coherence[np.isfinite(coherence)]
    ratio = float(np.median(coherence)) if coherence.size else 0.0
    return bool(
        ratio > COHERENT
        or np.median(inlier) < SAME_INLIER * np.quantile(inlier, 1.0 - OFTEN)
        or inlier.max() < SAME_INLIER
    )


def _sample_poses(table: PoseTable, i: int, radius_px: float) -> tuple[NDArray[np.int64], F64]:
    """Frame numbers (k,) and poses (k, 3; turn, x, y), in order, of at most `ROWS` rows evenly spread over the way of
    the i-th body; ``radius_px``: what a turn counts by."""
    rows = np.flatnonzero(~table.is_lost[:, i])
    pose = table.pose[rows, i]
    step = np.hypot(*np.diff(pose[:, 1:], axis=0).T) + 0.5 * radius_px * np.abs(np.diff(pose[:, 0]))
    way = np.concatenate([[0.0], np.cumsum(step + 1e-6)])
    chosen = np.unique(np.searchsorted(way, np.linspace(0.0, way[-1], ROWS)).clip(0, rows.size - 1))
    return table.frame[rows[chosen]], pose[chosen]


def _find_moving_tiles(
    ready: PreparedFilm, template: Template, frame: NDArray[np.int64], pose: F64
) -> MovingParts | None:
    """Parts of one outline that move against its poses (k, 3) in frames (k,), a bend or a second body; None where none
    do."""
    tiles = _tiles(template)
    if len(tiles) < 4:
        return None
    frames, film = FrameSpline(ready.film), ready.film
    place = np.zeros((len(frame), len(tiles), 3))
    u = np.full((len(frame), len(tiles)), np.nan)
    better = np.zeros(u.shape, dtype=bool)
    for row, index in enumerate(frame.tolist()):
        box = region_of(template, pose[row], film.height, film.width, TILE_PX)
        if box is None:
            continue
        part = frames.filtered_part(index, box)
        region = Region(part.coefficient, float(part.box[2]), float(part.box[0]))
        for k, tile in enumerate(tiles):
            start = place[row - 1, k] if row else np.zeros(3)
            place[row, k], u[row, k], better[row, k] = tile.fit_shift(region, pose[row], start)
    middle, shift = np.array([tile.middle for tile in tiles]), place[..., :2]
    far = np.hypot(*middle.T)
    for row in range(len(frame)):
        known = np.isfinite(u[row]) & (far > far.max() / 3.0)
        if known.any():
            shift[row] -= np.median(np.sum(shift[row, known] * middle[known], axis=1) / far[known] ** 2) * middle
    size = np.where(np.isfinite(u), np.hypot(*np.moveaxis(shift, 2, 0)), 0.0)
    moved = better & (size > np.maximum(LEAST_PX, SIGNIFICANT_U * np.nan_to_num(u, nan=np.inf)))
    known = np.isfinite(u).sum(axis=0)
    judged = known >= OFTEN * len(frame)
    often = judged & (moved.sum(axis=0) >= np.maximum(OFTEN * known, 3))
    moved &= often
    enough = np.count_nonzero(often) >= max(LEAST_TILES, SHARE * np.count_nonzero(judged))
    if not (enough and _is_common_motion(place, moved, middle)):
        bent = _largest_sag(shift, u, middle)
        if bent is None:
            return None
        x, y = middle[bent[1]] + template.centre_px
        return MovingParts(1.0, bent[0], (float(x), float(y)), bends=True)
    largest = np.where(moved, size, 0.0)
    worst = int(np.argmax(largest.max(axis=0)))
    x, y = middle[worst] + template.centre_px
    return MovingParts(float(often.sum() / judged.sum()), float(largest.max()), (float(x), float(y)))


def _largest_sag(shift: F64, u: F64, middle: F64) -> tuple[float, int] | None:
    """Largest sag of a bent outline, px, and the index of the tile at its end, by shifts (frames, tiles, 2), their
    ``u`` (frames, tiles) and the tiles' middles (tiles, 2), px; None where the tiles show no bend.

    A bend is to the same side in a quarter of the frames.
    """
    axis = np.linalg.svd(middle - middle.mean(axis=0), full_matrices=False)[2][0]
    along, across = middle @ axis, np.array([-axis[1], axis[0]])
    half = 0.5 * float(np.ptp(along))
    if half < 1.5 * TILE_PX:
        return None
    way = (along - 0.5 * (along.max() + along.min())) / half
    design = np.column_stack([np.ones(way.size), way, way**2])
    sags, certain = np.zeros(len(shift)), np.zeros(len(shift), dtype=bool)
    for row in range(len(shift)):
        known = np.flatnonzero(np.isfinite(u[row]))
        if known.size < 2 * LEAST_TILES or np.ptp(way[known]) < 1.5:
            continue
        weight = 1.0 / u[row, known]
        there, off = design[known] * weight[:, None], (shift[row, known] @ across) * weight
        inverse = np.linalg.pinv(there.T @ there)
        left = off - there @ (inverse @ (there.T @ off))
        straight = off - there[:, :2] @ np.linalg.lstsq(there[:, :2], off, rcond=None)[0]
        sags[row] = inverse[2] @ (there.T @ off)
        u_sag = np.sqrt(inverse[2, 2] * max(float(left @ left) / (known.size - 3), 1.0))
        explains = 1.0 - float(left @ left) / max(float(straight @ straight), 1e-9)
        certain[row] = explains > EXPLAINED and abs(sags[row]) > max(LEAST_PX, SIGNIFICANT_U * u_sag)
    if np.count_nonzero(certain) < max(OFTEN * len(shift), 3) or abs(np.sign(sags[certain]).sum()) < certain.sum():
        return None
    worst = int(np.argmax(np.where(certain, np.abs(sags), 0.0)))
    return float(abs(sags[worst])), int(np.argmax(np.abs(way)))


def _is_common_motion(place: F64, moved: NDArray[np.bool_], middle: F64) -> bool:
    """Whether tiles that ``moved`` (frames, tiles), at ``place`` (frames, tiles, 3), did so together in most frames, as
    a body does and a reflection does not; ``middle`` (tiles, 2), px.

    The body's pose may be that of one part or a compromise of two, so that there may be two motions against it.
    """
    judged, together = 0, 0
    for row in range(len(place)):
        at = np.flatnonzero(moved[row])
        if at.size < LEAST_TILES:
            continue
        most = 0
        for seed in at:
            x, y = (middle[at] - middle[seed]).T
            turn = place[row, seed, 2]
            told = place[row, seed, :2] + turn * np.column_stack([-y, x])
            off = np.hypot(*(place[row, at, :2] - told).T)
            most = max(most, int(np.count_nonzero(off < LEAST_PX + ALONE * np.hypot(*place[row, at, :2].T))))
        judged += 1
        together += most >= max(LEAST_TILES, COMMON * at.size)
    return judged > 0 and together >= 0.5 * judged


class _Tile:
    """Pixels of one square of a template."""

    def __init__(self, template: Template, pixels: NDArray[np.intp]) -> None:
        self._template, n = template, pixels.size
        self._offset = np.ascontiguousarray(template.offset_px[:, pixels])
        self._columns = np.ascontiguousarray(template.columns[:, pixels])
        self.middle = self._offset.mean(axis=1).astype(float)
        # shift along x and y, turn about its own middle, gain, offset, and light that falls on one side of the tile
        self._inside = (self._offset - self._offset.mean(axis=1, keepdims=True)).astype(float)
        (x, y), (slope_x, slope_y) = self._inside, self._columns[1:3]
        turn = slope_y * x - slope_x * y
        self._design = np.vstack([self._columns[1:3], turn, self._columns[3], np.ones(n), self._inside]).astype(float)
        self._work, self._at = np.zeros((4, n), dtype=np.float32), np.zeros(n, dtype=np.int32)
        self._nothing = np.zeros(n, dtype=np.uint8)
        self.contrast = float(np.var(self._columns[3]))
        inverse = np.linalg.pinv(self._design @ self._design.T, rcond=1e-12)
        self._solved = inverse @ self._design
        # a film without noise, or with saturated still frames, is rounded to whole grey values all the same
        self._noise = max(template.noise_grey, ROUNDING_GREY)
        self.u_px = self._noise * float(np.sqrt(max(inverse[0, 0], inverse[1, 1])))

    def fit_shift(self, region: Region, pose: F64, start: F64) -> tuple[F64, float, bool]:
        """Place (x, y, px, turn, rad) where the tile fits, against the body's ``pose``, in the template's axes, by
        steps from ``start``; standard uncertainty of x and y, px, NaN where it fits nowhere; whether it fits clearly
        better there than at the pose."""
        noise2, place, found = self._noise**2, start.copy(), None
        at_rest = self._fit_step(region, pose, np.zeros(3))
        for _ in range(ITERATIONS):
            found = self._fit_step(region, pose, place)
            if found is None:
                return start, np.nan, False
            # the frame at this place shows the template moved by the step: go against it
            place = place - found[0]
            if not (np.hypot(*(place - start)[:2]) < MOST_STEP_PX and abs(place[2] - start[2]) < MOST_TURN_RAD):
                return start, np.nan, False
            if np.hypot(*found[0][:2]) < AGREE_PX:
                break
        if found is None or found[1] > MOST_LEFT * noise2 + LEFT_CONTRAST * self.contrast:
            return start, np.nan, False
        before = self.contrast if at_rest is None else max(at_rest[1] - noise2, 0.0)
        u = self.u_px * float(np.sqrt(max(found[1] / noise2, 1.0)))
        return place, u, found[1] - noise2 < (1.0 - EXPLAINED) * before

    def _fit_step(self, region: Region, pose: F64, place: F64) -> tuple[F64, float] | None:
        """Step (x, y, turn) to take off ``place`` (x, y, turn, against ``pose``) for the tile to fit better, and mean
        square of what is left, grey^2; None where the tile fits nowhere."""
        value, visible = self._work[0], self._work[1]
        offset = (turn_matrix(place[2]) @ self._inside + (self.middle + place[:2])[:, None]).astype(np.float32)
        subset = Subset(offset, self._columns, self._nothing, *self._template.centre_px, self._template.radius_px)
        places = Places(self._work[2], self._work[3], self._at)
        place_pixels(region, subset, pose, places, visible)
        sample_frame(region, places, value, visible)
        n_seen = np.count_nonzero(visible)
        if n_seen < SEEN * visible.size:
            return None
        if n_seen == visible.size:
            q = self._solved @ value
        else:
            q = np.linalg.lstsq((self._design * visible).T, value * visible, rcond=None)[0]
        if not 1.0 / MOST_GAIN < q[3] < MOST_GAIN:
            return None
        left = (value - q @ self._design) * visible
        return q[:3] / q[3], float(left @ left) / n_seen


def _tiles(template: Template) -> list[_Tile]:
    """Squares of the outline with enough pixels and texture to find their place."""
    x, y = np.floor((template.offset_px - template.offset_px.min(axis=1, keepdims=True)) / TILE_PX).astype(int)
    number = y * (1 << 12) + x
    tiles = [_Tile(template, np.flatnonzero(number == k)) for k in np.unique(number)]
    return [tile for tile in tiles if tile._nothing.size >= LEAST_PIXELS and SIGNIFICANT_U * tile.u_px < 2.0]


LEVEL = 1  # squares of 16 px
DOUBTED = 0.3  # a pixel of less weight does not agree; of normal noise 4 % have less
MANY = 0.15  # share of such pixels in a square that is left out
AGREE_SIGMA = 2.5  # standard deviations up to which a pixel agrees


def confirm_hidden(ready: PreparedFilm, table: PoseTable, doubted: NDArray[np.bool_]) -> int:
    """Confirm or widen rows of ``table`` flagged `COVERED` by a fit without the hidden part; returns the number that
    lost the flag. Bodies that are ``doubted`` (m,) keep it."""
    covered = (table.flag & np.uint16(int(FrameFlag.COVERED))) != 0
    cleared = 0
    for i, template in enumerate(ready.templates):
        rows = np.flatnonzero(covered[:, i] & ~table.is_lost[:, i])
        if not rows.size:
            continue
        frames, squares = FrameSpline(ready.film), template.get_or_make(template_blocks)
        # each carries its weights from row to row
        fitters = (IcgnFitter(template, frames), IcgnFitter(template, frames))
        fitters[0].reset(cautious=True)
        square = np.repeat(squares.groups[LEVEL], np.diff(squares.first))
        for row in rows:
            again = _fit_without_squares(ready, table, int(row), i, fitters, square)
            if again is None:
                continue
            off = pose_difference(again.pose, table.pose[row, i])
            variance = again.covariance.diagonal()
            if np.any(off**2 > AGREE_SIGMA**2 * variance):
                table.covariance[row, i] += np.diag(off**2)
            elif again.seen - again.inlier < HIDDEN_SHARE and not doubted[i]:
                own = table.covariance[row, i]
                table.covariance[row, i] = inflate_covariance(own, np.maximum(off**2 / own.diagonal(), 1.0))
                table.flag[row, i] &= ~np.uint16(int(FrameFlag.COVERED))
                cleared += 1
    return cleared


def _fit_without_squares(
    ready: PreparedFilm,
    table: PoseTable,
    row: int,
    i: int,
    fitters: tuple[IcgnFitter, IcgnFitter],
    square: NDArray[np.int32],
) -> Fit | None:
    """Fit of the i-th body in a row without the squares (``square`` (n,): that of each pixel) in which pixels do not
    agree; None where it fails or too little is left. One fitter finds them, the other fits without."""
    (fitter, second), pose, frame = fitters, table.pose[row, i], int(table.frame[row])
    others = {j: table.pose[row, j] for j in ready.occlusion.in_front[i] if not table.is_lost[row, j]}
    hidden = ready.occlusion.hidden_pixels(i, pose, others)
    first = fitter.fit(ready.film, frame, pose, hidden)
    if not first.converged:
        return None
    seen = hidden == 0
    doubtful = (fitter.state()["weight"] < DOUBTED) & seen
    count = int(square.max()) + 1
    share = np.bincount(square[doubtful], minlength=count) / np.maximum(np.bincount(square[seen], minlength=count), 1)
    left_out = np.where(share[square] > MANY, np.uint8(1), hidden)
    if np.count_nonzero(left_out == 0) < MIN_INLIER * left_out.size:
        return None
    again = second.fit(ready.film, frame, first.pose, left_out)
    return again if again.converged and np.isfinite(again.covariance).all() else None
