"""Where bodies were, are expected and are seen from their parents, compiled: as `tracking.pose_prediction` has it.

The arithmetic is the same in the same order, so that the bits are the same.
"""

from __future__ import annotations

import math

from numba import njit

from vision.fitting.kernel_records import F64
from vision.frame_fit.compiling import uncounted
from vision.frame_fit.records import Bodies, Found, History, States

SMALLEST_PX = 16
"""Least side of the region of a body, as in `fitting.base.region_of`."""


@uncounted
def predict_place(history: History, body: int, step: int, place: F64) -> None:
    """As `PlacementHistory.predict`."""
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
    """As `PlacementHistory.add`."""
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
def expect_body(bodies: Bodies, states: States, found: Found, margin: int, body: int, step: int) -> None:
    """As `BodyTracker.predict` and `fitting.base.region_of`."""
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
    region = found.region[body]
    region[0] = -1
    x, y = bodies.centre[body, 0] + pose[1], bodies.centre[body, 1] + pose[2]
    if not math.isfinite(pose[0] + x + y) or abs(x) + abs(y) > 1e9:
        return
    cosine, sine = math.cos(pose[0]), math.sin(pose[0])
    left, right, top, bottom = box[0], box[1], box[2], box[3]
    low_x, high_x = (left, right) if cosine >= 0.0 else (right, left)
    low_y, high_y = (top, bottom) if cosine >= 0.0 else (bottom, top)
    down_x, up_x = (left, right) if sine >= 0.0 else (right, left)
    down_y, up_y = (top, bottom) if sine >= 0.0 else (bottom, top)
    height, width = bodies.distance.shape[1], bodies.distance.shape[2]
    x0 = max(0, int(math.floor(x + (cosine * low_x - sine * up_y))) - margin)
    x1 = min(width, int(math.ceil(x + (cosine * high_x - sine * down_y))) + margin + 1)
    y0 = max(0, int(math.floor(y + (sine * down_x + cosine * low_y))) - margin)
    y1 = min(height, int(math.ceil(y + (sine * up_x + cosine * high_y))) + margin + 1)
    if x1 - x0 >= SMALLEST_PX and y1 - y0 >= SMALLEST_PX:
        region[0], region[1], region[2], region[3] = y0, y1, x0, x1


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


@njit(cache=True, nogil=True)
def expect_bodies(bodies: Bodies, states: States, found: Found, margin: int, step: int) -> bool:
    """Fill in where all bodies are expected; False where one has never been placed."""
    for body in range(bodies.order.size):
        if states.absolute.known[body] == 0:
            return False
        expect_body(bodies, states, found, margin, body, step)
    return True
