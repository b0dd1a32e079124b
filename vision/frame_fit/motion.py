"""Motion prediction: constant acceleration of each body relative to its parent.

A placement is a body's turn and the place (x, y) of its centre in the picture. The placement of a child is kept in the
axes of its parent as well, so that a jack that rides on a moving whippen is predicted with the whippen's motion in the
same frame. An ordinal is the running number of a tracked frame. All functions are compiled; Python calls them, too.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from vision.fitting.base import MARGIN_PX, region_at
from vision.fitting.kernels import F64, I64
from vision.fitting.template import Template
from vision.kernel_cache import cached_njit, inner_njit


class History(NamedTuple):
    """The last three placements of each of m bodies, oldest first: ``known`` (m,) of them, ``ordinal`` (m, 3),
    ``place`` (m, 3, 3)."""

    known: I64
    ordinal: I64
    place: F64

    @classmethod
    def empty(cls, m: int) -> History:
        return cls(np.zeros(m, dtype=np.int64), np.zeros((m, 3), dtype=np.int64), np.zeros((m, 3, 3)))


class Motion(NamedTuple):
    """Of m bodies: number of the ``parent`` (m,) or -1, ``centre`` (m, 2) in the reference, and placements, in the
    picture and in the parents' axes."""

    parent: I64
    centre: F64
    absolute: History
    relative: History

    @classmethod
    def from_templates(cls, templates: Sequence[Template], parents: Sequence[int | None] | None = None) -> Motion:
        m = len(templates)
        numbers = [-1 if parent is None else parent for parent in parents or [None] * m]
        centre = np.array([template.centre_px for template in templates], dtype=float)
        return cls(np.array(numbers, dtype=np.int64), centre, History.empty(m), History.empty(m))


@inner_njit(_nrt=False)
def predict_place(history: History, body: int, ordinal: int, place: F64) -> None:
    """Fill ``place`` (turn, x, y) of a body in the ``ordinal``-th tracked frame, extrapolated from its last placements,
    three at most, where they are those of the frames just before, else the newest known one."""
    known, last = history.known[body], history.place[body]
    for k in range(3):
        if ordinal != history.ordinal[body, known - 1] + 1 or known < 2:
            place[k] = last[known - 1, k]
        elif known == 2:
            place[k] = 2.0 * last[1, k] - last[0, k]
        else:
            place[k] = 3.0 * last[2, k] - 3.0 * last[1, k] + last[0, k]


@inner_njit(_nrt=False)
def add_place(history: History, body: int, ordinal: int, turn: float, x: float, y: float) -> None:
    """Record the placement of a body in the ``ordinal``-th tracked frame: turn, rad, and place of its centre, px; a gap
    restarts its history."""
    known = history.known[body]
    if known > 0 and ordinal != history.ordinal[body, known - 1] + 1:
        known = 0
    if known == 3:
        for k in range(2):
            history.ordinal[body, k] = history.ordinal[body, k + 1]
            for j in range(3):
                history.place[body, k, j] = history.place[body, k + 1, j]
        known = 2
    history.ordinal[body, known] = ordinal
    history.place[body, known, 0], history.place[body, known, 1], history.place[body, known, 2] = turn, x, y
    history.known[body] = known + 1


@cached_njit(nogil=True, _nrt=False)
def is_placed(motion: Motion, body: int, ordinal: int) -> bool:
    absolute = motion.absolute
    return absolute.known[body] > 0 and absolute.ordinal[body, absolute.known[body] - 1] == ordinal


@inner_njit(_nrt=False)
def placed_parent(motion: Motion, body: int, ordinal: int) -> int:
    parent = motion.parent[body]
    return parent if parent >= 0 and is_placed(motion, parent, ordinal) else -1


@cached_njit(nogil=True, _nrt=False)
def expect_pose(motion: Motion, body: int, ordinal: int, is_moving: bool, pose: F64) -> None:
    """Fill ``pose`` (turn rad, shift x, y px) with a body's expected pose in the ``ordinal``-th tracked frame:
    predicted if ``is_moving``, else the newest known; via its parent where that is placed."""
    parent = placed_parent(motion, body, ordinal)
    history = motion.relative if parent >= 0 and motion.relative.known[body] > 0 else motion.absolute
    if is_moving:
        predict_place(history, body, ordinal, pose)
    else:
        for k in range(3):
            pose[k] = history.place[body, history.known[body] - 1, k]
    if parent >= 0 and motion.relative.known[body] > 0:
        there = motion.absolute.place[parent, motion.absolute.known[parent] - 1]
        cosine, sine = math.cos(there[0]), math.sin(there[0])
        x, y = pose[1], pose[2]
        pose[0], pose[1], pose[2] = (
            pose[0] + there[0],
            there[1] + cosine * x - sine * y,
            there[2] + sine * x + cosine * y,
        )
    pose[1], pose[2] = pose[1] - motion.centre[body, 0], pose[2] - motion.centre[body, 1]


@inner_njit(_nrt=False)
def expect_body(
    motion: Motion, body: int, ordinal: int, boxes: F64, size: tuple[int, int], pose: F64, region: I64
) -> None:
    """Fill in the ``pose`` (m, 3) expected of a body, and the ``region`` (m, 4) of a frame of ``size`` that holds it
    there (`region_at`); ``boxes`` (m, 4) are left, right, top and bottom of the bodies."""
    here, box, centre = pose[body], boxes[body], motion.centre[body]
    expect_pose(motion, body, ordinal, True, here)
    around = (box[0], box[1], box[2], box[3])
    x, y, margin = centre[0] + here[1], centre[1] + here[2], np.int64(MARGIN_PX)
    y0, y1, x0, x1 = region_at(here[0], x, y, around, size, margin)
    region[body, 0], region[body, 1], region[body, 2], region[body, 3] = y0, y1, x0, x1


@cached_njit(nogil=True, _nrt=False)
def expect_bodies(
    motion: Motion, ordinal: int, boxes: F64, size: tuple[int, int], pose: F64, region: I64, union: I64
) -> bool:
    """Fill ``pose``, ``region`` and their ``union`` (4,) of all bodies by `expect_body`; False where none is in."""
    union[0], union[1], union[2], union[3] = 1 << 30, 0, 1 << 30, 0
    for body in range(motion.parent.size):
        expect_body(motion, body, ordinal, boxes, size, pose, region)
        if region[body, 0] >= 0:
            union[0], union[1] = min(union[0], region[body, 0]), max(union[1], region[body, 1])
            union[2], union[3] = min(union[2], region[body, 2]), max(union[3], region[body, 3])
    return union[1] > 0


@cached_njit(nogil=True, _nrt=False)
def place_body(motion: Motion, body: int, ordinal: int, pose: F64) -> None:
    """Record the pose (turn, x, y; shift from the reference) of a body in the ``ordinal``-th tracked frame, in the
    picture and in its parent's axes; parents are placed before their children."""
    x, y = motion.centre[body, 0] + pose[1], motion.centre[body, 1] + pose[2]
    add_place(motion.absolute, body, ordinal, pose[0], x, y)
    parent = placed_parent(motion, body, ordinal)
    if parent >= 0:
        there = motion.absolute.place[parent, motion.absolute.known[parent] - 1]
        cosine, sine = math.cos(there[0]), math.sin(there[0])
        x, y = x - there[1], y - there[2]
        add_place(motion.relative, body, ordinal, pose[0] - there[0], cosine * x + sine * y, cosine * y - sine * x)
