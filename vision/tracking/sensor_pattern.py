"""Estimate and subtract the fixed pattern of the sensor: pattern noise, dust, static reflections.

The still frames have it in common with the template, where it looks like texture that does not move; a body that has
hardly moved is held back by it, and its residuals do not show it. Once the body has moved, it shows in every frame at
the same pixels. Method: the reference, moved to the poses found, is subtracted from frames of the film; what is left
is averaged pixel by pixel over the frames in which the body has moved there by more than `MOVED_PX`, and shrunk by what
noise alone would leave. Pixels whose differences scatter by more than noise keep their grey values: something else
moves there.
The film less its pattern is then tracked again, and taken if its residuals are smaller.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.bodies.masks import build_masks
from vision.film.source import Corrected, FrameSource, saturated_grey
from vision.fitting.base import ROUNDING_GREY, region_of
from vision.fitting.bspline import HALF_TAPS, noise_gain
from vision.fitting.pose_covariance import PATTERN_EXCESS
from vision.fitting.template import Template, noise_normal_matrix
from vision.reference.camera_faults import is_coarsely_quantised
from vision.reference.prepared_film import PreparedFilm
from vision.results.pose_table import PoseTable
from vision.tracking.film_tracker import FilmTracker

INSIDE = 0.999  # of an interpolated mask: all four pixels around lie in the body, but for rounding
MOVED_PX = 1.5  # in the middle or half way to the rim, from which a body has moved: a grain of texture and more
LEAST_ROWS = 8  # of a body that has moved, for their median: choice
MOST_ROWS = 100  # of each body that are looked at: the pattern is then known to a tenth of the noise
SCATTER = 1.6  # of a pixel's differences over what noise and pattern explain: more, and something else moves there
APART_PX = 3.0  # between the least and the most moved third of the rows: other texture lies there then
COMMON = 0.7  # of the pattern's power, that both of these thirds show: what comes from the body, they do not
POWER = 0.1  # least, of the pattern over the noise: it costs a twentieth of the standard uncertainty
LEAST_COMMON_PIXELS = 500  # that both thirds know: the common power is then known to a twentieth
SOON = 3.0  # rows that have moved by up to this many times `MOVED_PX` have only just begun to move
HELD_PX = 0.5  # how far a picture of pure noise that stands still can hold a body back
LEFT_OVER = 1.25  # measured on disturbed films of wood, felt and speckle: their shares are 0.5, 0.25 and 0.05
BETTER = 0.85  # residual variance of the second tracking over the first below which the pattern is taken


class PatternCorrectedFilm(Corrected):
    """A film whose frames have a fixed pattern taken off; saturated pixels stay so. Grey values are float32."""

    def __init__(self, film: FrameSource, pattern: NDArray[np.float32]) -> None:
        super().__init__(film)
        self._pattern, self._top = pattern, saturated_grey(film)

    def read_region(self, index: int, y0: int, y1: int, x0: int, x1: int) -> NDArray[Any]:
        grey = self.film.read_region(index, y0, y1, x0, x1)
        return np.where(grey >= self._top, np.float32(self._top), grey - self._pattern[y0:y1, x0:x1])


def travel_px(ready: PreparedFilm, table: PoseTable) -> NDArray[np.float64]:
    """How far bodies have moved in the middle and half way to the rim, px, (n, m)."""
    radius = np.array([template.radius_px for template in ready.templates])
    return np.asarray(np.hypot(table.pose[..., 1], table.pose[..., 2]) + 0.5 * radius * np.abs(table.pose[..., 0]))


def find_moved_rows(ready: PreparedFilm, table: PoseTable) -> NDArray[np.bool_]:
    """Rows and bodies, (n, m), that are found and have moved by more than `MOVED_PX` in the middle or at the rim."""
    return ~table.is_lost & (travel_px(ready, table) > MOVED_PX)


def residual_variance(ready: PreparedFilm, table: PoseTable) -> NDArray[np.float64]:
    """Median variance of the noise in the rows that have moved, over that of the still frames, per body, (m,); 1 where
    few have."""
    moved = find_moved_rows(ready, table)
    still = max(ready.reference.noise_grey, ROUNDING_GREY) ** 2 * (
        float(noise_gain().mean()) ** 2 + 1.0 / ready.reference.n_averaged
    )
    counts = moved.sum(axis=0)
    return np.array(
        [
            float(np.median(table.noise_grey[moved[:, i], i] ** 2)) / still if counts[i] >= LEAST_ROWS else 1.0
            for i in range(moved.shape[1])
        ]
    )


def _variance_growth(ready: PreparedFilm, table: PoseTable) -> NDArray[np.float64]:
    """`residual_variance` (m,) as far as motion made it grow: against rows at rest where these are noisier than the
    template knows, and no more than soon after the motion began (what grows later comes from the body)."""
    excess, way, moved = residual_variance(ready, table), travel_px(ready, table), find_moved_rows(ready, table)
    at_rest = ~table.is_lost & (table.frame < ready.reference.n_averaged)[:, None]
    for i, template in enumerate(ready.templates):
        if ready.skips_blocks or is_coarsely_quantised(template, ready.grey_step):
            continue  # what is rounded away at rest comes back later
        variance = table.noise_grey[:, i].astype(float) ** 2
        soon = moved[:, i] & (way[:, i] < SOON * MOVED_PX)
        if soon.any() and at_rest[:, i].any():
            whole = float(np.median(variance[moved[:, i]]))
            excess[i] *= min(float(np.median(variance[soon])) / whole, 1.0) / max(
                float(np.median(variance[at_rest[:, i]])) * excess[i] / whole, 1.0
            )
    return excess


def pattern_bias_variance(ready: PreparedFilm, table: PoseTable) -> NDArray[np.float64]:
    """Variance of (turn, x, y), (n, m, 3), rad^2 and px^2, of bodies that what the still frames have in common may hold
    back.

    Residuals that grow once a body has moved show noise that stood still in the still frames: a pattern that could not
    be taken off, a coarse step of the grey values, a codec. While the body has moved by less than `MOVED_PX` that is in
    reference and frame alike, and no residual shows it.
    """
    excess = _variance_growth(ready, table)
    near = (travel_px(ready, table) < MOVED_PX) & (table.frame >= ready.reference.n_averaged)[:, None]
    added = np.zeros((*near.shape, 3))
    if ready.film.compression is not None:
        return added  # the budget's term for the codec has it
    for i, template in enumerate(ready.templates):
        if excess[i] > PATTERN_EXCESS:
            share = _noise_share(template, 0.5 * (excess[i] - 1.0) * max(template.noise_grey, ROUNDING_GREY) ** 2)
            reach = HELD_PX * np.array([2.0 / template.radius_px, 1.0, 1.0])
            added[:, i] = np.where(near[:, i, None], (np.minimum(share, 1.0) * reach) ** 2, 0.0)
    return added


def _noise_share(template: Template, variance: float) -> NDArray[np.float64]:
    """Part of a body's squared slopes for (turn, x, y), (3,), that noise of a variance makes in the template."""
    dx, dy = template.offset_px.astype(float)
    return np.asarray((noise_normal_matrix(dx, dy, variance).diagonal() / template.normal.diagonal())[:3])


def residual_pattern_inflation(ready: PreparedFilm, pattern_grey: float) -> NDArray[np.float64]:
    """Factor of the variances of (turn, x, y), (m, 3), for what is left of a pattern of a given rms after it was taken
    off: the more of a body's slopes the pattern made up, the more of it the poses had in them when it was estimated."""
    return 1.0 + LEFT_OVER * np.array([_noise_share(template, pattern_grey**2) for template in ready.templates])


def estimate_pattern(film: FrameSource, ready: PreparedFilm, table: PoseTable) -> NDArray[np.float32] | None:
    """The pattern of ``film``, grey, (height, width), zero where it is not known; None where there is none to speak of.

    ``ready`` may be the film less an earlier estimate of its pattern.
    """
    sums = _sum_differences(film, ready, table)
    noise2 = max(ready.reference.noise_grey, ROUNDING_GREY) ** 2
    return None if sums is None else _significant_pattern(sums, noise2)


def sampled_rows(ready: PreparedFilm, table: PoseTable) -> NDArray[np.intp]:
    """The rows, in order, in which differences from the reference are looked at."""
    chosen = _select_rows_by_body(ready, table)
    return np.unique(np.concatenate([rows for rows, _ in chosen.values()])) if chosen else np.zeros(0, dtype=np.intp)


def _select_rows_by_body(ready: PreparedFilm, table: PoseTable) -> dict[int, tuple[NDArray[np.intp], NDArray[np.intp]]]:
    """Rows of each body (by index) that are looked at, spread over its way, and the third of the way (0 to 2) in which
    each lies; empty where no body has moved far enough."""
    way, moved = travel_px(ready, table), find_moved_rows(ready, table)
    chosen: dict[int, tuple[NDArray[np.intp], NDArray[np.intp]]] = {}  # body: rows, and the third of the way of each
    apart = 0.0
    for i in range(len(ready.templates)):
        rows = np.flatnonzero(moved[:, i])
        if rows.size < LEAST_ROWS:
            continue
        rows = rows[np.argsort(way[rows, i], kind="stable")]
        rows = rows[np.unique(np.linspace(0, rows.size - 1, MOST_ROWS).astype(int))]
        third = np.minimum(3 * np.arange(rows.size) // rows.size, 2)
        apart = max(apart, float(np.median(way[rows[third == 2], i]) - np.median(way[rows[third == 0], i])))
        chosen[i] = rows, third
    return chosen if apart >= APART_PX else {}


def _sum_differences(film: FrameSource, ready: PreparedFilm, table: PoseTable) -> NDArray[np.float64] | None:
    """Count, sum and sum of squares (first axis) of what rows differ from the reference, by pixel, in the least moved
    third, the middle and the furthest (second axis), (3, 3, height, width); None where bodies have not moved far
    enough."""
    shape = (film.height, film.width)
    chosen = _select_rows_by_body(ready, table)
    if not chosen:
        return None
    sums = np.zeros((3, 3, *shape))
    masks = build_masks(ready.bodies, *shape)
    for i, (rows, third) in chosen.items():
        for row, part in zip(rows, third, strict=True):
            pose = table.pose[row, i]
            box = region_of(ready.templates[i], pose, *shape, margin_px=HALF_TAPS)
            if box is None:
                continue
            frame = film.read_region(int(table.frame[row]), *box)
            found = _subtract_reference(ready, frame, (box[0], box[2]), pose, ready.templates[i].centre_px, masks[i])
            if found is not None:
                difference, known = found
                grey = difference[known]
                there = sums[:, part, box[0] : box[1], box[2] : box[3]]
                for k, values in enumerate((np.ones_like(grey), grey, grey**2)):
                    there[k][known] += values
    return sums


def _significant_pattern(sums: NDArray[np.float64], noise_variance: float) -> NDArray[np.float32] | None:
    """Pattern (height, width), grey, from counts, sums and squares (3) of the differences in each third (3) of the way,
    (3, 3, height, width); None where the first and the last third do not show the same."""
    count, total, squares = sums.sum(axis=1)
    enough = count >= LEAST_ROWS / 2
    if not enough.any():
        return None
    number = np.maximum(count, 1.0)
    mean = total / number
    scatter = squares / number - mean**2
    # the template holds the pattern too, another one in each of the frames
    typical = float(np.median(scatter[enough]))
    usable = enough & (scatter < SCATTER**2 * max(min(typical, 4.0 * noise_variance), noise_variance))
    both = usable & (sums[0, 0] >= 3.0) & (sums[0, 2] >= 3.0)
    if np.count_nonzero(both) < LEAST_COMMON_PIXELS:
        return None
    power = float(np.mean(mean[both] ** 2 - scatter[both] / number[both]))
    # what comes from the body (defocus, blur, another scale) is not at the same pixels when other texture lies there
    near, far = (sums[1, part][both] / sums[0, part][both] for part in (0, 2))
    common = float(np.mean(near * far))
    if power < POWER * noise_variance or common < COMMON * power:
        return None
    pattern = mean * power / (power + scatter / number)
    return np.where(usable, pattern, 0.0).astype(np.float32)


def _subtract_reference(
    ready: PreparedFilm,
    frame: NDArray[Any],
    corner: tuple[int, int],
    pose: NDArray[np.float64],
    centre: tuple[float, float],
    mask: NDArray[np.bool_],
) -> tuple[NDArray[np.float32], NDArray[np.bool_]] | None:
    """Part of a frame, whose first pixel is at ``corner`` (y, x), less the reference at a pose with the light matched,
    and its pixels of the body that have moved, each (h, w); None of too few."""
    height, width = frame.shape
    c, s = np.cos(pose[0]), np.sin(pose[0])
    matrix = np.array([[c, -s, 0.0], [s, c, 0.0]])
    origin = np.array(corner[::-1], dtype=float)
    matrix[:, 2] = np.array(centre) + pose[1:] - matrix[:, :2] @ centre - origin
    size = (width, height)
    there = cv2.warpAffine(ready.reference.picture, matrix, size, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
    inside = cv2.warpAffine(mask.astype(np.float32), matrix, size, flags=cv2.INTER_LINEAR) >= INSIDE
    y, x = np.nonzero(inside)
    place = np.stack([x, y]) + origin[:, None]
    way = matrix[:, :2] @ place + matrix[:, 2:] + origin[:, None] - place
    far = np.hypot(*way) > MOVED_PX
    inside[y[~far], x[~far]] = False
    if np.count_nonzero(inside) < 100:
        return None
    seen, expected = frame[inside].astype(np.float64), there[inside].astype(np.float64)
    centred = expected - expected.mean()
    gain = float(centred @ seen) / max(float(centred @ centred), 1e-9)
    light = seen.mean() + gain * (there - expected.mean())
    return (frame - light).astype(np.float32), inside


WORTH = 0.995  # residual variance of a round over that of the one before from which no further one is tried
TRACKED_AGAIN = 2  # times that the whole film is tracked again at most

Prepare = Callable[[PatternCorrectedFilm], PreparedFilm]
Pattern = NDArray[np.float32]


def correct_pattern(ready: PreparedFilm, table: PoseTable, prepare: Prepare) -> tuple[PreparedFilm, Pattern] | None:
    """The film less its pattern, prepared by ``prepare``, and the pattern, grey, (height, width); None where there is
    none whose removal fits the sampled rows better.

    ``ready`` may be the film less an earlier estimate.
    """
    film = ready.film.film if isinstance(ready.film, PatternCorrectedFilm) else ready.film
    best: tuple[PreparedFilm, Pattern] | None = None
    sample = table.rows(sampled_rows(ready, table))
    before = residual_variance(ready, sample).mean()
    now = ready
    while True:  # each round but the last makes the variance smaller
        pattern = estimate_pattern(film, now, sample)
        if pattern is None:
            break
        cleaned = prepare(PatternCorrectedFilm(film, pattern))
        again = refit_rows(cleaned, sample)
        after = residual_variance(cleaned, again).mean()
        first = best is None and now.film is film
        if again.is_lost.sum() > sample.is_lost.sum() or not after <= (BETTER * before if first else before):
            break
        best, settled = (cleaned, pattern), not after <= WORTH * before
        if settled:
            break
        now, sample, before = cleaned, again, after
    return best


def refit_rows(ready: PreparedFilm, table: PoseTable) -> PoseTable:
    """New table of the rows fitted again, each from its own poses; a body that is lost there stays lost."""
    tracker, again = FilmTracker(ready), PoseTable.empty(table.frame, len(ready.bodies))
    for row in range(table.frame.size):
        tracker.clear_histories()
        tracker.place(-1, table.pose[row])
        tracker.fit_frame(int(table.frame[row]), 0, search=False)
        tracker.store(again, row)
    return again


def is_pattern_suspected(ready: PreparedFilm, table: PoseTable) -> bool:
    """Whether residuals ask for a pattern and bodies have moved far enough to tell one."""
    return bool(np.any(residual_variance(ready, table) > PATTERN_EXCESS)) and sampled_rows(ready, table).size > 0


def is_improvement(
    before: tuple[PreparedFilm, PoseTable], after: tuple[PreparedFilm, PoseTable], is_first: bool
) -> bool:
    """Whether no row more is lost without the pattern, and the residual variance is lower, clearly so at first."""
    found = int(before[1].is_lost.sum()) - int(after[1].is_lost.sum())
    old, new = (float(residual_variance(*of).mean()) for of in (before, after))
    return found >= 0 and new <= (BETTER * old if is_first and not found else old)
