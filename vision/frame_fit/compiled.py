"""The compiled frame fit: all bodies through one frame in one call, and through many frames of a film in memory.

Elements of arrays are copied one by one: whole slices would compile messages about their shapes, for seconds.

Records: arrays of all bodies of a film, in one order. Pixels of all bodies lie one after the other; those of body i are
``start[i] .. start[i] + n_pixels[i] - 1``. Trackers and fitters keep their state in views of these arrays, so that
nothing is copied between the two ways to fit a frame.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vision.bodies.occlusion import mark_covered, relative_pose
from vision.film.source import SATURATED_SHARE
from vision.fitting.assessment import COHERENT, HIDDEN_SHARE, Assessed, Blocks, BodyFacts, assess_fit
from vision.fitting.frame_spline import count_saturated_inside, prefilter
from vision.fitting.icgn import FAR_PX, QUIET
from vision.fitting.illumination import Squares, can_show_illumination, residual_noise
from vision.fitting.kernels import F32, F64, I32, I64, Region, Settings, State, Subset, fit_rigid
from vision.fitting.pose_covariance import PATTERN_EXCESS, TUKEY_FACTOR
from vision.frame_fit.judgement import Figures, Standards, has_odd_gain, judge_fit, update_usual_quality
from vision.frame_fit.motion import Motion, expect_bodies, expect_body, is_placed, place_body, placed_parent
from vision.kernel_cache import cached_njit, inner_njit
from vision.results.flags import FAILURE

FAILED = int(FAILURE)
U8 = NDArray[np.uint8]


class Bodies(NamedTuple):
    """What does not change while a film is tracked, of m bodies.

    ``order`` (m,) parents first; ``start``, ``n_pixels`` (m,); ``offset`` and ``columns`` of `fitting.template`, flat;
    ``radius`` (m,), ``box`` (m, 4) left, right, top, bottom; ``noise_normal`` (m, 5, 5); ``averaged`` (m,); blocks of
    `fitting.assessment.Blocks`, ``first`` and ``groups`` flat, their numbers in ``runs`` (m, 2): start and count,
    ``freedom`` (m, sizes); the ``squares`` of `fitting.illumination`, flat, pixels as above, and ``square_runs`` (m, 2)
    where each body's begin and their count; ``in_front`` (m, m), 1 where the second may hide the first; groups of
    pixels for `bodies.occlusion`, ``around`` flat, ``arounds`` (m, 2) start and count; ``distance`` (m, height, width).
    """

    order: I64
    start: I64
    n_pixels: I64
    offset: F32
    columns: F32
    radius: F64
    box: F64
    noise_normal: F64
    averaged: F64
    runs: I64
    first: I64
    groups: I32
    freedom: F64
    squares: Squares
    square_runs: I64
    in_front: U8
    arounds: I64
    around: F64
    distance: F32


class States(NamedTuple):
    """What is carried over from frame to frame: ``weight``, ``work`` and ``at`` of `kernels.State`, and covered
    pixels, flat; ``scale`` (m,); ``apart`` (m,), 1 where Python has to fit the body (light or scale have changed, a
    cautious start); room for the coefficients of a frame."""

    weight: F32
    work: F32
    at: I32
    covered: U8
    scale: F64
    apart: U8
    motion: Motion
    standards: Standards
    coefficient: F32


class FitOutputs(NamedTuple):
    """What is filled in, per body: expected pose and region (y0, y1, x0, x1; y0 = -1 where too little of the body is
    inside), pose, covariance, coherence; ``figures`` (m, 6) are `Figures`; ``sums`` (m, 10) the numbers of
    `kernels.RigidFit`; ``normal``, ``inverse`` (m, 5, 5); ``lacking`` (m,) of `fitting.assessment.assess`, which gave
    ``variance`` (m, 2); ``flag`` (m,)."""

    expected: F64
    region: I64
    pose: F64
    covariance: F64
    ratio: F64
    blocks: F64
    figures: F64
    sums: F64
    normal: F64
    inverse: F64
    variance: F64
    lacking: I64
    flag: NDArray[np.uint16]


class Film(NamedTuple):
    """Frames ``first`` and following as they lie in memory, (n, height, width); from frame ``watched_from`` on a frame
    is doubtful whose pixels ``watched_x0 .. watched_x1 - 1`` of row ``watched_y`` are those of the frame before;
    ``saturated`` is the smallest grey value that says no more than "too bright"."""

    frames: NDArray[Any]
    first: int
    saturated: int
    watched_from: int
    watched_y: int
    watched_x0: int
    watched_x1: int


class Rows(NamedTuple):
    """Columns of a `results.pose_table.PoseTable`, to be filled from row ``first`` on, which is the
    ``first_ordinal``-th that the tracker fits; ``frame`` are their numbers."""

    frame: I64
    first: int
    first_ordinal: int
    pose: F64
    covariance: F64
    zncc: F64
    inlier: F64
    noise_grey: F64
    gain: F64
    flag: NDArray[np.uint16]
    ratio: F64
    blocks: F64


class Stop(NamedTuple):
    """Where a walk ended: ``at`` (2,) position in the order of the bodies and ordinal of the frame; ``expected`` and
    ``box`` (4,), rectangle of all bodies and that of the newest filtered part, with its ``n_saturated`` (1,); ``begun``
    (1,), how the fits of the frame ended, 0 before them."""

    at: I64
    expected: I64
    box: I64
    n_saturated: I64
    begun: I64


ALL_DONE, NOT_BEGUN, DOUBTFUL, OUTSIDE = 0, 1, 2, 3
"""How `fit_remaining_bodies` ends: no body is left; Python must fit the next, whose covered pixels are marked; the next
is fitted, and Python must judge it; the next is not inside the part of the frame."""


@inner_njit(_nrt=False)
def is_accepted(states: States, found: FitOutputs, body: int) -> bool:
    """Whether a body's (index) fit needs no look by Python: coherent with white noise, no failure flag, usual gain,
    within `FAR_PX` of where it was expected. Sets its ``found.flag``, which stays as it was where residuals are
    coherent."""
    for k in range(3):
        if found.ratio[body, -1, k] > COHERENT:
            return False
    pose, expected, figures = found.pose[body], found.expected[body], read_figures(found, body)
    flag = judge_fit(states.standards, body, figures, pose, expected, found.covariance[body])
    found.flag[body] = flag
    if flag & FAILED or has_odd_gain(states.standards, body, figures.gain):
        return False
    return max(abs(pose[1] - expected[1]), abs(pose[2] - expected[2])) <= FAR_PX


@inner_njit(_nrt=False)
def read_figures(found: FitOutputs, body: int) -> Figures:
    figures = found.figures[body]
    return Figures(figures[0], figures[1], figures[2], figures[3], figures[4], figures[5])


@inner_njit()
def mark_hidden_pixels(bodies: Bodies, states: States, found: FitOutputs, body: int, ordinal: int) -> Any:
    """Mark the pixels of a body (index) that those in front hide, at their poses where placed in the ``ordinal``-th
    tracked frame, else where expected; returns a view of ``states.covered``."""
    start, count = bodies.start[body], bodies.n_pixels[body]
    covered = states.covered[start : start + count]
    for i in range(count):
        covered[i] = 0
    offset = bodies.offset[2 * start : 2 * (start + count)].reshape(2, count)
    begin, groups = bodies.arounds[body, 0], bodies.arounds[body, 1]
    around, centre = bodies.around[begin : begin + 3 * groups].reshape(3, groups), states.motion.centre
    for other in range(bodies.order.size):
        if bodies.in_front[body, other] == 0:
            continue
        there = found.pose[other] if is_placed(states.motion, other, ordinal) else found.expected[other]
        seen = relative_pose(found.expected[body], centre[body], there, centre[other])
        mark_covered(offset, around, seen, bodies.distance[other], centre[other], covered)
    return covered


@inner_njit()
def fit_body(
    part: Region, settings: Settings, bodies: Bodies, states: States, found: FitOutputs, body: int, ordinal: int
) -> bool:
    """Fit one body (index) in the ``ordinal``-th tracked frame from its expected pose into ``found``; return whether it
    is accepted."""
    start, count = bodies.start[body], bodies.n_pixels[body]
    covered = mark_hidden_pixels(bodies, states, found, body, ordinal)
    offset = bodies.offset[2 * start : 2 * (start + count)].reshape(2, count)
    columns = bodies.columns[4 * start : 4 * (start + count)].reshape(4, count)
    weight, at = states.weight[start : start + count], states.at[start : start + count]
    work = states.work[5 * start : 5 * (start + count)].reshape(5, count)
    centre, pose, figures = states.motion.centre[body], found.pose[body], found.figures[body]
    for k in range(3):
        pose[k] = found.expected[body, k]
    subset = Subset(offset, columns, covered, centre[0], centre[1], bodies.radius[body])
    fit = fit_rigid(part, subset, settings, State(pose, weight, work, at, states.scale[body]))
    sums, numbers = fit.sums, found.sums[body]
    numbers[0], numbers[1], numbers[2], numbers[3] = fit.iterations, fit.gain, fit.noise_gain, sums.scale
    numbers[4], numbers[5], numbers[6] = sums.weight, sums.squares, sums.inlier
    numbers[7], numbers[8], numbers[9] = sums.seen, sums.value, sums.value2
    for j in range(5):
        for k in range(5):
            found.normal[body, j, k] = fit.normal[j, k]
    if fit.iterations <= 0 or not math.isfinite(pose[0] + pose[1] + pose[2]):
        return False
    first, runs = bodies.runs[body, 0], bodies.runs[body, 1]
    sizes = bodies.freedom.shape[1]
    starts = bodies.first[first + body : first + body + runs + 1]
    groups = bodies.groups[sizes * first : sizes * (first + runs)].reshape(sizes, runs)
    facts = BodyFacts(
        columns,
        bodies.noise_normal[body],
        bodies.averaged[body],
        states.standards.noise_grey[body],
        QUIET,
        PATTERN_EXCESS,
        TUKEY_FACTOR,
    )
    out = Assessed(
        found.variance[body], found.covariance[body], found.inverse[body], found.ratio[body], found.blocks[body]
    )
    found.lacking[body] = assess_fit(facts, Blocks(starts, groups, bodies.freedom[body]), fit, work, weight, out)
    if found.lacking[body] != 0:
        return False
    figures[0], figures[1], figures[2] = out.figures[1], sums.inlier / count, math.sqrt(out.figures[0])
    figures[3], figures[4], figures[5] = fit.gain, sums.seen / count, sums.value / max(sums.weight, 1.0)
    if not is_accepted(states, found, body):
        return False
    if not figures[4] - figures[1] > HIDDEN_SHARE:
        return True
    begin, n_squares = bodies.square_runs[body, 0], bodies.square_runs[body, 1]
    squares = Squares(
        bodies.squares.pixel[start : start + count],
        bodies.squares.grey[start : start + count],
        bodies.squares.first[begin + body : begin + body + n_squares + 1],
        bodies.squares.middle[begin : begin + n_squares],
    )
    noise = residual_noise(states.standards.noise_grey[body], fit.gain, bodies.averaged[body])
    return not can_show_illumination(squares, work[1], work[2], fit.gain, noise)


@cached_njit(nogil=True)
def fit_remaining_bodies(
    part: Region,
    n_saturated: int,
    settings: Settings,
    bodies: Bodies,
    states: States,
    found: FitOutputs,
    at: I64,
) -> int:
    """Fit bodies of the ``at[1]``-th tracked frame, from the ``at[0]``-th in order on, in its filtered ``part``,
    recording poses while fits are good; ``at[0]`` becomes where it stopped, the answer is why (`ALL_DONE` and beyond).

    `found.region` tells of which part it has need.
    """
    height, width = part.coefficient.shape
    y0, x0 = int(part.origin_y), int(part.origin_x)
    size, ordinal = (bodies.distance.shape[1], bodies.distance.shape[2]), at[1]
    for position in range(at[0], bodies.order.size):
        at[0], body = position, bodies.order[position]
        if placed_parent(states.motion, body, ordinal) >= 0:
            expect_body(states.motion, body, ordinal, bodies.box, size, found.expected, found.region)
        region = found.region[body]
        inside = region[0] >= y0 and region[1] <= y0 + height and region[2] >= x0 and region[3] <= x0 + width
        is_apart = states.apart[body] != 0 or region[0] < 0
        if not (is_apart or inside):
            return OUTSIDE
        if is_apart or 2 * n_saturated > SATURATED_SHARE * bodies.n_pixels[body]:
            mark_hidden_pixels(bodies, states, found, body, ordinal)
            return NOT_BEGUN
        if not fit_body(part, settings, bodies, states, found, body, ordinal):
            return DOUBTFUL
        states.scale[body] = found.sums[body, 3]
        update_usual_quality(states.standards, body, read_figures(found, body))
        place_body(states.motion, body, ordinal, found.pose[body])
    at[0] = bodies.order.size
    return ALL_DONE


@inner_njit(_nrt=False)
def is_repeated(film: Film, k: int) -> bool:
    here, before = film.frames[k, film.watched_y], film.frames[k - 1, film.watched_y]
    same = True
    for x in range(film.watched_x0, film.watched_x1):
        same &= here[x] == before[x]
    return same


@inner_njit(_nrt=False)
def copy_box(one: I64, other: I64) -> None:
    for k in range(4):
        other[k] = one[k]


@inner_njit()
def filter_region(film: Film, k: int, box: I64, buffer: F32) -> tuple[Any, int]:
    """Spline coefficients (h, w) of the rectangle ``box`` (y0, y1, x0, x1) of the ``k``-th frame in memory, made in
    ``buffer`` and a view of it, and the number of its pixels inside saturated areas."""
    y0, y1, x0, x1 = box[0], box[1], box[2], box[3]
    height, width = y1 - y0, x1 - x0
    picture = np.empty((height, width), film.frames.dtype)
    for y in range(height):
        line = film.frames[k, y0 + y]
        for x in range(width):
            picture[y, x] = line[x0 + x]
    coefficient = buffer[: height * width].reshape(height, width)
    brightest = prefilter(picture, coefficient)
    return coefficient, count_saturated_inside(picture, film.saturated) if brightest >= film.saturated else 0


@inner_njit(_nrt=False)
def store_row(rows: Rows, row: int, found: FitOutputs) -> None:
    """Copy what was found of all bodies in a frame into row ``row`` of the pose table whose columns ``rows`` holds."""
    for body in range(found.pose.shape[0]):
        figures, rows.flag[row, body] = found.figures[body], found.flag[body]
        for j in range(3):
            rows.pose[row, body, j] = found.pose[body, j]
            for k in range(3):
                rows.covariance[row, body, j, k] = found.covariance[body, j, k]
        for j in range(found.ratio.shape[1]):
            for k in range(3):
                rows.ratio[row, body, j, k] = found.ratio[body, j, k]
                rows.blocks[row, body, j, k] = found.blocks[body, j, k]
        rows.zncc[row, body], rows.inlier[row, body] = figures[0], figures[1]
        rows.noise_grey[row, body], rows.gain[row, body] = figures[2], figures[3]


@cached_njit(nogil=True)
def track_rows(
    film: Film,
    settings: Settings,
    bodies: Bodies,
    states: States,
    found: FitOutputs,
    rows: Rows,
    stop: Stop,
) -> int:
    """Track the frames that ``rows`` names, in order, and fill its columns; return how many were done. The next one
    ended at a body or frame that Python must look at, as ``stop`` says."""
    at, box, expected = stop.at, stop.box, stop.expected
    size = (bodies.distance.shape[1], bodies.distance.shape[2])
    for done in range(rows.frame.size):
        index, row, at[0], at[1] = rows.frame[done], rows.first + done, 0, rows.first_ordinal + done
        k, stop.begun[0] = index - film.first, 0
        if index >= film.watched_from and k >= 1 and is_repeated(film, k):
            return done
        for body in range(bodies.order.size):
            if states.motion.absolute.known[body] == 0:
                return done
        inside = expect_bodies(states.motion, at[1], bodies.box, size, found.expected, found.region, expected)
        if not inside or found.region[bodies.order[0], 0] < 0:
            return done
        copy_box(expected, box)
        coefficient, stop.n_saturated[0] = filter_region(film, k, box, states.coefficient)
        while True:
            part = Region(coefficient, float(box[2]), float(box[0]))
            ended = fit_remaining_bodies(part, stop.n_saturated[0], settings, bodies, states, found, at)
            if ended == ALL_DONE:
                break
            stop.begun[0] = ended
            if ended != OUTSIDE:
                return done
            region = found.region[bodies.order[at[0]]]
            inside = region[0] >= expected[0] and region[1] <= expected[1]
            inside &= region[2] >= expected[2] and region[3] <= expected[3]
            copy_box(expected if inside else region, box)
            coefficient, stop.n_saturated[0] = filter_region(film, k, box, states.coefficient)
        store_row(rows, row, found)
    return rows.frame.size
