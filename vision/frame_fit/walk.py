"""The compiled walk through many frames of a film whose frames lie in memory as they are read.

What `tracking.stretches.forward_step` does per frame, for frames of which nothing is doubtful: compare with the frame
before, expect the bodies, filter the part of the frame that holds them, fit them, store the fits. At the first doubt it
stops in the middle of the frame, and Python goes on there. `vision.frame_fit.compiling` says how it is cached.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numba import njit

from vision.fitting.kernel_records import F32, I64, Region, Settings
from vision.fitting.prefilter import prefilter, saturated_inside
from vision.frame_fit.compiled import ALL_DONE, OUTSIDE, go_on
from vision.frame_fit.compiling import digest_of_sources, inner, uncounted
from vision.frame_fit.places import expect_body
from vision.frame_fit.records import Bodies, Film, Found, Limits, Rows, States, Stop


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
        figures, rows.flag[row, body] = found.figures[body], 0
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


def _compiled(digest: str) -> Callable[..., int]:
    """The compiled walk; ``digest`` is closed over, and thereby part of the key of numba's cache."""

    @njit(cache=True, nogil=True)
    def walk(
        film: Film,
        settings: Settings,
        limits: Limits,
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
                expect_body(bodies, states, found, limits.margin_px, body, at[1])
            first = found.region[bodies.order[0]]
            if len(digest) == 0 or first[0] < 0 or not union_of(found, expected):
                return done
            copy_box(expected, box)
            coefficient, stop.n_saturated[0] = filtered(film, k, box, states.coefficient)
            while True:
                part = Region(coefficient, float(box[2]), float(box[0]))
                ended = go_on(part, stop.n_saturated[0], settings, limits, bodies, states, found, at)
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


walk = _compiled(digest_of_sources())
