"""The compiled frame fit: all bodies through one frame in one call, and through many frames of a film in memory.

A call expects, covers, fits, assesses, accepts a body and goes on to its children. It does for a body of which nothing
is doubtful what `tracking.body_tracker` and `fitting.icgn` do in Python, with the same arithmetic in the same order, so
that the bits are the same. Places are predicted as `tracking.body_tracker` has it.

The walk does what `tracking.stretches.forward_rows` does per frame, for frames of which nothing is doubtful: compare
with the frame before, expect the bodies, filter the part of the frame that holds them, fit them, store the fits. At the
first doubt it stops in the middle of the frame, and Python goes on there.

Cache: functions here call compiled functions of other files, whose changes numba's disk cache does not notice. The
digest of all their sources is closed over by the cached entries (`fit_bodies`, `walk`), which makes it part of the
cache's key; what lies between is not cached itself. Elements of arrays are copied one by one: whole slices would
compile messages about their shapes, for seconds.

Records: arrays of all bodies of a film, in one order. Pixels of all bodies lie one after the other; those of body i are
``start[i] .. start[i] + n_pixels[i] - 1``. Trackers and fitters keep their state in views of these arrays, so that
nothing is copied between the two ways to fit a frame.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from vision import fitting
from vision.bodies import occlusion
from vision.bodies.occlusion import mark_covered
from vision.film import source
from vision.film.source import SATURATED_SHARE
from vision.fitting.assessment import Assessed, Blocks, BodyFacts, assess
from vision.fitting.base import MARGIN_PX, region_at
from vision.fitting.frame_spline import prefilter, saturated_inside
from vision.fitting.icgn import CHANGE_SUSPECTED, FAR_PX, QUIET
from vision.fitting.kernels import F32, F64, I32, I64, Region, Settings, State, Subset, fit_rigid
from vision.fitting.light import HIDDEN_SUSPECTED, Squares, may_show_light, noise_left
from vision.fitting.pose_covariance import PATTERN_EXCESS, TUKEY_FACTOR
from vision.kernel_cache import cached_njit
from vision.results import flags
from vision.results.flags import FrameFlag

# up to where a fit is accepted without a second look; frozen into the compiled code, whose key holds this file
MIN_INLIER = 0.3
MAX_JUMP_RAD = math.radians(8.0)
MAX_JUMP_PX = 12.0
USUAL_SHARE = 0.85
"""Least correlation as a share of the usual one; blur lowers it slowly, a wrong pose abruptly."""
NOISE_ONLY = 1.15
"""Residuals up to this many times the noise of the still frames are taken for noise."""
MIN_GAIN = 0.6
"""Flicker changes the light by some per cent; where the contrast changes more than by this factor, up or down, another
surface may hide the body."""
COVERED_SHARE = 0.1
"""Share of visible pixels that do not agree; noise alone makes 0.003."""
COVERED = np.uint16(int(FrameFlag.COVERED))


def digest_of_sources() -> str:
    """Of all files whose compiled functions are called from here or by those, or whose constants they hold."""
    digest = hashlib.sha256()
    for folder in (Path(__file__).parent, Path(fitting.__file__).parent):
        for path in sorted(folder.rglob("*.py")):
            digest.update(path.read_bytes())
    for module in (occlusion, source, flags):
        digest.update(Path(str(module.__file__)).read_bytes())
    return digest.hexdigest()


def uncounted(function: Callable[..., Any]) -> Any:
    """Compile a function that allocates nothing: counting references to the arrays it is given costs time twice."""
    return inner(function, _nrt=False)


def inner(function: Callable[..., Any], **options: bool) -> Any:
    """Compile a function that only compiled code calls, without what Python would need to call it: a third less time.

    From Python it cannot be called.
    """
    compile_with: Any = njit  # its types do not name all options
    return compile_with(nogil=True, no_cpython_wrapper=True, no_cfunc_wrapper=True, **options)(function)


U8 = NDArray[np.uint8]


class Bodies(NamedTuple):
    """What does not change while a film is tracked, of m bodies.

    ``order`` (m,) parents first, ``parent`` (m,) or -1; ``start``, ``n_pixels`` (m,); ``offset`` and ``columns``
    of `fitting.template`, flat; ``centre`` (m, 2), ``radius`` (m,), ``box`` (m, 4) left, right, top, bottom;
    ``noise_normal`` (m, 5, 5); ``averaged``, ``noise``, ``least_zncc``, ``contrast`` (m,); the blocks of
    `fitting.assessment.Blocks`, ``first`` and ``groups`` flat, their numbers in ``runs`` (m, 2): start and count,
    ``freedom`` (m, sizes); the ``squares`` of `fitting.light`, flat, pixels as above, and ``square_runs`` (m, 2) where
    each body's begin and their count; ``in_front`` (m, m), 1 where the second may hide the first; groups of pixels for
    `bodies.occlusion`, ``around`` flat, ``arounds`` (m, 2) start and count; ``distance`` (m, height, width).
    """

    order: I64
    parent: I64
    start: I64
    n_pixels: I64
    offset: F32
    columns: F32
    centre: F64
    radius: F64
    box: F64
    noise_normal: F64
    averaged: F64
    noise: F64
    least_zncc: F64
    contrast: F64
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


class History(NamedTuple):
    """The last three places of each body, oldest first: ``known`` (m,) of them, ``step`` (m, 3), ``place`` (m, 3, 3); a
    place is turn, x and y of the centre."""

    known: I64
    step: I64
    place: F64

    @classmethod
    def empty(cls, m: int) -> History:
        """Of bodies that have never been placed."""
        return cls(np.zeros(m, dtype=np.int64), np.zeros((m, 3), dtype=np.int64), np.zeros((m, 3, 3)))


class States(NamedTuple):
    """What is carried over from frame to frame: ``weight``, ``work`` and ``at`` of `kernels.State`, and covered
    pixels, flat; ``scale`` (m,); ``apart`` (m,), 1 where Python has to fit the body (light or scale have changed, a
    cautious start); ``usual`` (m, 2) correlation and gain; places in the picture, and in the parents' axes; room for
    the coefficients of a frame."""

    weight: F32
    work: F32
    at: I32
    covered: U8
    scale: F64
    apart: U8
    usual: F64
    absolute: History
    relative: History
    coefficient: F32


class Found(NamedTuple):
    """What is filled in, per body: expected pose and region (y0, y1, x0, x1; y0 = -1 where too little of the body is
    inside), pose, covariance, coherence. ``figures`` (m, 5):
    correlation, inlier, noise, gain, seen; ``sums`` (m, 10): the numbers of `kernels.RigidFit`; ``normal``,
    ``inverse`` (m, 5, 5); ``lacking`` (m,) of `fitting.assessment.assess`, which gave ``variance`` (m, 2); ``flag``
    (m,)."""

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
    """Columns of a `results.pose_table.PoseTable`, to be filled from row ``first`` on, which is step ``first_step`` of
    the tracker; ``frame`` are their numbers."""

    frame: I64
    first: int
    first_step: int
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
    """Where a walk ended: ``at`` (2,) place in the order of the bodies and step; ``expected`` and ``box`` (4,),
    rectangle of all bodies and that of the newest filtered part, with its ``n_saturated`` (1,); ``begun`` (1,), how
    the fits of the frame ended, 0 before them."""

    at: I64
    expected: I64
    box: I64
    n_saturated: I64
    begun: I64


@uncounted
def predict_place(history: History, body: int, step: int, place: F64) -> None:
    """Place of a body at a step: constant acceleration from three neighbours, else the newest known one."""
    known, last = history.known[body], history.place[body]
    for k in range(3):
        if step != history.step[body, known - 1] + 1 or known < 2:
            place[k] = last[known - 1, k]
        elif known == 2:
            place[k] = 2.0 * last[1, k] - last[0, k]
        else:
            place[k] = 3.0 * last[2, k] - 3.0 * last[1, k] + last[0, k]


@uncounted
def add_place(history: History, body: int, step: int, turn: float, x: float, y: float) -> None:
    """Record the place of a body at a step; after a gap its history starts anew."""
    known = history.known[body]
    if known > 0 and step != history.step[body, known - 1] + 1:
        known = 0
    if known == 3:
        for k in range(2):
            history.step[body, k] = history.step[body, k + 1]
            for j in range(3):
                history.place[body, k, j] = history.place[body, k + 1, j]
        known = 2
    history.step[body, known] = step
    history.place[body, known, 0], history.place[body, known, 1], history.place[body, known, 2] = turn, x, y
    history.known[body] = known + 1


@uncounted
def parent_at(bodies: Bodies, states: States, body: int, step: int) -> int:
    """Number of the parent whose place at a step is known, else -1."""
    parent, absolute = bodies.parent[body], states.absolute
    if parent < 0 or absolute.known[parent] == 0 or absolute.step[parent, absolute.known[parent] - 1] != step:
        return -1
    return parent


@uncounted
def expect_body(bodies: Bodies, states: States, found: Found, body: int, step: int) -> None:
    """As `BodyTracker.predict`, with the region that holds the body."""
    pose, box = found.expected[body], bodies.box[body]
    parent = parent_at(bodies, states, body, step)
    if parent >= 0 and states.relative.known[body] > 0:
        predict_place(states.relative, body, step, pose)
        there = states.absolute.place[parent, states.absolute.known[parent] - 1]
        cosine, sine = math.cos(there[0]), math.sin(there[0])
        x, y = pose[1], pose[2]
        pose[0], pose[1], pose[2] = (
            pose[0] + there[0],
            there[1] + cosine * x - sine * y,
            there[2] + sine * x + cosine * y,
        )
    else:
        predict_place(states.absolute, body, step, pose)
    pose[1], pose[2] = pose[1] - bodies.centre[body, 0], pose[2] - bodies.centre[body, 1]
    size = (bodies.distance.shape[1], bodies.distance.shape[2])
    x, y = bodies.centre[body, 0] + pose[1], bodies.centre[body, 1] + pose[2]
    region = found.region[body]
    region[0], region[1], region[2], region[3] = region_at(
        pose[0], x, y, (box[0], box[1], box[2], box[3]), size, MARGIN_PX
    )


@uncounted
def place_body(bodies: Bodies, states: States, body: int, step: int, pose: F64) -> None:
    """As `BodyTracker.place`."""
    x, y = bodies.centre[body, 0] + pose[1], bodies.centre[body, 1] + pose[2]
    add_place(states.absolute, body, step, pose[0], x, y)
    parent = parent_at(bodies, states, body, step)
    if parent >= 0:
        there = states.absolute.place[parent, states.absolute.known[parent] - 1]
        cosine, sine = math.cos(there[0]), math.sin(there[0])
        x, y = x - there[1], y - there[2]
        add_place(states.relative, body, step, pose[0] - there[0], cosine * x + sine * y, cosine * y - sine * x)


ALL_DONE, NOT_BEGUN, DOUBTFUL, OUTSIDE = 0, 1, 2, 3
"""How `go_on` ends: no body is left; Python must fit the next; the next is fitted, and Python must judge it; the next
is not inside the part of the frame."""


@uncounted
def is_good(bodies: Bodies, states: States, found: Found, body: int) -> bool:
    """Whether a fit passes every test of `BodyTracker` and none of `IcgnFitter` asks for another."""
    figures, pose, expected = found.figures[body], found.pose[body], found.expected[body]
    zncc, inlier, noise, gain = figures[0], figures[1], figures[2], figures[3]
    for k in range(3):
        if found.ratio[body, -1, k] > CHANGE_SUSPECTED:
            return False
    noise_only = noise <= NOISE_ONLY * bodies.noise[body] * max(gain, 1.0)
    if not (zncc >= bodies.least_zncc[body] and (noise_only or zncc >= USUAL_SHARE * states.usual[body, 0])):
        return False
    share, changed = bodies.contrast[body], gain / states.usual[body, 1]
    if not MIN_GAIN * share <= changed <= 1.0 / MIN_GAIN / share:
        return False
    x, y = abs(pose[1] - expected[1]), abs(pose[2] - expected[2])
    if not (inlier >= MIN_INLIER and abs(pose[0] - expected[0]) <= MAX_JUMP_RAD):
        return False
    if not (max(x, y) <= FAR_PX and x + y <= MAX_JUMP_PX):
        return False
    total = 0.0
    for j in range(3):
        for k in range(3):
            total += found.covariance[body, j, k]
    return math.isfinite(total) and found.covariance[body, 0, 0] > 0.0


@inner
def cover(bodies: Bodies, states: States, found: Found, body: int, step: int) -> Any:
    """As `Occlusion.covered` at the poses that `FilmTracker` takes; returns a view of ``states.covered``."""
    start, count = bodies.start[body], bodies.n_pixels[body]
    covered = states.covered[start : start + count]
    for i in range(count):
        covered[i] = 0
    offset = bodies.offset[2 * start : 2 * (start + count)].reshape(2, count)
    begin, groups = bodies.arounds[body, 0], bodies.arounds[body, 1]
    around = bodies.around[begin : begin + 3 * groups].reshape(3, groups)
    here = found.expected[body]
    for other in range(bodies.order.size):
        if bodies.in_front[body, other] == 0:
            continue
        known = states.absolute.known[other]
        placed = known > 0 and states.absolute.step[other, known - 1] == step
        there = found.pose[other] if placed else found.expected[other]
        cosine, sine = math.cos(there[0]), math.sin(there[0])
        x = bodies.centre[body, 0] + here[1] - bodies.centre[other, 0] - there[1]
        y = bodies.centre[body, 1] + here[2] - bodies.centre[other, 1] - there[2]
        seen = (here[0] - there[0], cosine * x + sine * y, cosine * y - sine * x)
        mark_covered(offset, around, seen, bodies.distance[other], bodies.centre[other], covered)
    return covered


@inner
def fit_body(
    part: Region, settings: Settings, bodies: Bodies, states: States, found: Found, body: int, step: int
) -> bool:
    """Fit one body from its expected pose and say whether it is good; ``found`` is filled in either way."""
    start, count = bodies.start[body], bodies.n_pixels[body]
    covered = cover(bodies, states, found, body, step)
    offset = bodies.offset[2 * start : 2 * (start + count)].reshape(2, count)
    columns = bodies.columns[4 * start : 4 * (start + count)].reshape(4, count)
    weight, at = states.weight[start : start + count], states.at[start : start + count]
    work = states.work[5 * start : 5 * (start + count)].reshape(5, count)
    centre, pose, figures = bodies.centre[body], found.pose[body], found.figures[body]
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
        bodies.noise[body],
        QUIET,
        PATTERN_EXCESS,
        TUKEY_FACTOR,
    )
    out = Assessed(
        found.variance[body], found.covariance[body], found.inverse[body], found.ratio[body], found.blocks[body]
    )
    found.lacking[body] = assess(facts, Blocks(starts, groups, bodies.freedom[body]), fit, work, weight, out)
    if found.lacking[body] != 0:
        return False
    figures[0], figures[1], figures[2] = out.figures[1], sums.inlier / count, math.sqrt(out.figures[0])
    figures[3], figures[4] = fit.gain, sums.seen / count
    if not is_good(bodies, states, found, body):
        return False
    hidden = figures[4] - figures[1]
    found.flag[body] = COVERED if hidden > COVERED_SHARE else np.uint16(0)
    if not hidden > HIDDEN_SUSPECTED:
        return True
    begin, n_squares = bodies.square_runs[body, 0], bodies.square_runs[body, 1]
    squares = Squares(
        bodies.squares.pixel[start : start + count],
        bodies.squares.grey[start : start + count],
        bodies.squares.first[begin + body : begin + body + n_squares + 1],
        bodies.squares.middle[begin : begin + n_squares],
    )
    noise = noise_left(bodies.noise[body], fit.gain, bodies.averaged[body])
    return not may_show_light(squares, work[1], work[2], fit.gain, noise)


@inner
def go_on(
    part: Region,
    n_saturated: int,
    settings: Settings,
    bodies: Bodies,
    states: States,
    found: Found,
    at: I64,
) -> int:
    """Fit the bodies in order from the ``at[0]``-th on at step ``at[1]``, in the filtered ``part`` of a frame.

    Goes on to the next while bodies are good, whose poses it records; ``at[0]`` is then where it stopped, and the
    answer why (`ALL_DONE` and beyond); `found.region` tells of which part it has need.
    """
    height, width = part.coefficient.shape
    y0, x0 = int(part.origin_y), int(part.origin_x)
    step = at[1]
    for position in range(at[0], bodies.order.size):
        at[0], body = position, bodies.order[position]
        if parent_at(bodies, states, body, step) >= 0:
            expect_body(bodies, states, found, body, step)
        region = found.region[body]
        inside = region[0] >= y0 and region[1] <= y0 + height and region[2] >= x0 and region[3] <= x0 + width
        saturated = 2 * n_saturated > SATURATED_SHARE * bodies.n_pixels[body]
        if states.apart[body] != 0 or region[0] < 0:
            return NOT_BEGUN
        if not inside:
            return OUTSIDE
        if saturated:
            return NOT_BEGUN
        if not fit_body(part, settings, bodies, states, found, body, step):
            return DOUBTFUL
        figures, usual = found.figures[body], states.usual[body]
        states.scale[body] = found.sums[body, 3]
        usual[0] = figures[0] if usual[0] == 0.0 else 0.9 * usual[0] + 0.1 * figures[0]
        usual[1] += 0.1 * (figures[3] - usual[1])
        place_body(bodies, states, body, step, found.pose[body])
    at[0] = bodies.order.size
    return ALL_DONE


def _compiled(digest: str) -> Callable[..., int]:
    """The compiled call; ``digest`` is closed over, and thereby part of the key of numba's cache."""

    @cached_njit(nogil=True)
    def fit_bodies(
        part: Region,
        n_saturated: int,
        settings: Settings,
        bodies: Bodies,
        states: States,
        found: Found,
        at: I64,
    ) -> int:
        """As `go_on`."""
        if len(digest) == 0:
            return NOT_BEGUN
        return go_on(part, n_saturated, settings, bodies, states, found, at)

    return fit_bodies


fit_bodies = _compiled(digest_of_sources())


@uncounted
def repeats(film: Film, k: int) -> bool:
    """Whether the watched pixels of a frame are those of the frame before."""
    here, before = film.frames[k, film.watched_y], film.frames[k - 1, film.watched_y]
    same = True
    for x in range(film.watched_x0, film.watched_x1):
        same &= here[x] == before[x]
    return same


@uncounted
def union_of(found: Found, box: I64) -> bool:
    """Fill in the rectangle that holds all expected regions; False where there is none."""
    box[0], box[1], box[2], box[3] = 1 << 30, 0, 1 << 30, 0
    for body in range(found.region.shape[0]):
        region = found.region[body]
        if region[0] >= 0:
            box[0], box[1] = min(box[0], region[0]), max(box[1], region[1])
            box[2], box[3] = min(box[2], region[2]), max(box[3], region[3])
    return box[1] > 0


@uncounted
def copy_box(one: I64, other: I64) -> None:
    """Copy a rectangle."""
    for k in range(4):
        other[k] = one[k]


@inner
def filtered(film: Film, k: int, box: I64, buffer: F32) -> tuple[Any, int]:
    """Coefficients of a rectangle of a frame, in ``buffer``, and the number of its pixels inside saturated areas."""
    y0, y1, x0, x1 = box[0], box[1], box[2], box[3]
    height, width = y1 - y0, x1 - x0
    picture = np.empty((height, width), film.frames.dtype)
    for y in range(height):
        line = film.frames[k, y0 + y]
        for x in range(width):
            picture[y, x] = line[x0 + x]
    coefficient = buffer[: height * width].reshape(height, width)
    brightest = prefilter(picture, coefficient)
    return coefficient, saturated_inside(picture, film.saturated) if brightest >= film.saturated else 0


@uncounted
def store(rows: Rows, row: int, found: Found) -> None:
    """Store the fits of all bodies."""
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


def _compiled_walk(digest: str) -> Callable[..., int]:
    """The compiled walk; ``digest`` is closed over, and thereby part of the key of numba's cache."""

    @cached_njit(nogil=True)
    def walk(
        film: Film,
        settings: Settings,
        bodies: Bodies,
        states: States,
        found: Found,
        rows: Rows,
        stop: Stop,
    ) -> int:
        """Track the rows in turn; returns how many were done and says in ``stop`` where it ended."""
        at, box, expected = stop.at, stop.box, stop.expected
        for done in range(rows.frame.size):
            index, row, at[0], at[1] = rows.frame[done], rows.first + done, 0, rows.first_step + done
            k, stop.begun[0] = index - film.first, 0
            if index >= film.watched_from and k >= 1 and repeats(film, k):
                return done
            for body in range(bodies.order.size):
                if states.absolute.known[body] == 0:
                    return done
                expect_body(bodies, states, found, body, at[1])
            first = found.region[bodies.order[0]]
            if len(digest) == 0 or first[0] < 0 or not union_of(found, expected):
                return done
            copy_box(expected, box)
            coefficient, stop.n_saturated[0] = filtered(film, k, box, states.coefficient)
            while True:
                part = Region(coefficient, float(box[2]), float(box[0]))
                ended = go_on(part, stop.n_saturated[0], settings, bodies, states, found, at)
                if ended == ALL_DONE:
                    break
                stop.begun[0] = ended
                if ended != OUTSIDE:
                    return done
                region = found.region[bodies.order[at[0]]]
                inside = region[0] >= expected[0] and region[1] <= expected[1]
                inside &= region[2] >= expected[2] and region[3] <= expected[3]
                copy_box(expected if inside else region, box)
                coefficient, stop.n_saturated[0] = filtered(film, k, box, states.coefficient)
            store(rows, row, found)
        return rows.frame.size

    return walk


walk = _compiled_walk(digest_of_sources())
