"""What the compiled frame fit takes and gives: arrays of all bodies of a film, in one order.

Pixels of all bodies lie one after the other; those of body i are ``start[i] .. start[i] + n_pixels[i] - 1``. Trackers
and fitters keep their state in views of these arrays, so that nothing is copied between the two ways to fit a frame.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vision.fitting.kernel_records import F32, F64, I32, I64

U8 = NDArray[np.uint8]


class Bodies(NamedTuple):
    """What does not change while a film is tracked, of m bodies.

    ``order`` (m,) parents first, ``parent`` (m,) or -1; ``start``, ``n_pixels`` (m,); ``offset`` and ``columns``
    of `fitting.template`, flat; ``centre`` (m, 2), ``radius`` (m,), ``box`` (m, 4) left, right, top, bottom;
    ``noise_normal`` (m, 5, 5); ``averaged``, ``noise``, ``least_zncc``, ``contrast`` (m,); the blocks of
    `fitting.assessment.Blocks`, ``first`` and ``groups`` flat, their numbers in ``runs`` (m, 2): start and count,
    ``freedom`` (m, sizes); ``in_front`` (m, m), 1 where the second may hide the first; groups of pixels for
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
    in_front: U8
    arounds: I64
    around: F64
    distance: F32


class Limits(NamedTuple):
    """Up to where a fit is accepted without a second look: constants of `tracking.body_tracker`, `fitting.icgn` and
    `fitting.assessment`."""

    usual_share: float
    noise_only: float
    least_gain: float
    least_inlier: float
    most_turn: float
    most_jump_px: float
    most_shift_px: float
    most_hidden: float
    suspected: float
    saturated_share: float
    margin_px: int
    quiet: float
    excess: float
    factor: float


class History(NamedTuple):
    """The last three places of each body, oldest first: ``known`` (m,) of them, ``step`` (m, 3), ``place`` (m, 3, 3); a
    place is turn, x and y of the centre."""

    known: I64
    step: I64
    place: F64


class States(NamedTuple):
    """What is carried over from frame to frame: ``weight``, ``work`` and ``at`` of `kernel_records.State`, and covered
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
    correlation, inlier, noise, gain, seen; ``sums`` (m, 10): the numbers of `kernel_records.RigidFit`; ``normal``,
    ``inverse`` (m, 5, 5); ``lacking`` (m,) of `fitting.assessment.assess`, which gave ``variance`` (m, 2)."""

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
