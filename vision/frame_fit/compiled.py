"""The compiled call that takes all bodies through one frame: expect, cover, fit, assess, accept, go on to the children.

It does for a body of which nothing is doubtful what `tracking.body_tracker` and `fitting.icgn` do in Python, with the
same arithmetic in the same order, so that the bits are the same. `vision.frame_fit.compiling` says how it is cached.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from numba import njit

from vision.bodies.occlusion import mark_covered
from vision.fitting.assessment import Assessed, Blocks, BodyFacts, assess
from vision.fitting.kernel_records import I64, Region, Settings, State, Subset
from vision.fitting.kernels import fit_rigid
from vision.frame_fit.compiling import digest_of_sources, inner, uncounted
from vision.frame_fit.places import expect_body, parent_at, place_body
from vision.frame_fit.records import Bodies, Found, Limits, States

ALL_DONE, NOT_BEGUN, DOUBTFUL, OUTSIDE = 0, 1, 2, 3
"""How `go_on` ends: no body is left; Python must fit the next; the next is fitted, and Python must judge it; the next
is not inside the part of the frame."""


@uncounted
def is_good(limits: Limits, bodies: Bodies, states: States, found: Found, body: int) -> bool:
    """Whether a fit passes every test of `BodyTracker` and none of `IcgnFitter` asks for another."""
    figures, pose, expected = found.figures[body], found.pose[body], found.expected[body]
    zncc, inlier, noise, gain = figures[0], figures[1], figures[2], figures[3]
    for k in range(3):
        if found.ratio[body, -1, k] > limits.suspected:
            return False
    noise_only = noise <= limits.noise_only * bodies.noise[body] * max(gain, 1.0)
    if not (zncc >= bodies.least_zncc[body] and (noise_only or zncc >= limits.usual_share * states.usual[body, 0])):
        return False
    share, changed = bodies.contrast[body], gain / states.usual[body, 1]
    if not limits.least_gain * share <= changed <= 1.0 / limits.least_gain / share:
        return False
    x, y = abs(pose[1] - expected[1]), abs(pose[2] - expected[2])
    if figures[4] - inlier > limits.most_hidden:
        return False
    if not (inlier >= limits.least_inlier and abs(pose[0] - expected[0]) <= limits.most_turn):
        return False
    if not (max(x, y) <= limits.most_shift_px and x + y <= limits.most_jump_px):
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
    part: Region, settings: Settings, limits: Limits, bodies: Bodies, states: States, found: Found, body: int, step: int
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
        limits.quiet,
        limits.excess,
        limits.factor,
    )
    out = Assessed(
        found.variance[body], found.covariance[body], found.inverse[body], found.ratio[body], found.blocks[body]
    )
    found.lacking[body] = assess(facts, Blocks(starts, groups, bodies.freedom[body]), fit, work, weight, out)
    if found.lacking[body] != 0:
        return False
    figures[0], figures[1], figures[2] = out.figures[1], sums.inlier / count, math.sqrt(out.figures[0])
    figures[3], figures[4] = fit.gain, sums.seen / count
    return is_good(limits, bodies, states, found, body)


@inner
def go_on(
    part: Region,
    n_saturated: int,
    settings: Settings,
    limits: Limits,
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
    step, margin = at[1], limits.margin_px
    for position in range(at[0], bodies.order.size):
        at[0], body = position, bodies.order[position]
        if parent_at(bodies, states, body, step) >= 0:
            expect_body(bodies, states, found, margin, body, step)
        region = found.region[body]
        inside = region[0] >= y0 and region[1] <= y0 + height and region[2] >= x0 and region[3] <= x0 + width
        saturated = 2 * n_saturated > limits.saturated_share * bodies.n_pixels[body]
        if states.apart[body] != 0 or region[0] < 0:
            return NOT_BEGUN
        if not inside:
            return OUTSIDE
        if saturated:
            return NOT_BEGUN
        if not fit_body(part, settings, limits, bodies, states, found, body, step):
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

    @njit(cache=True, nogil=True)
    def fit_bodies(
        part: Region,
        n_saturated: int,
        settings: Settings,
        limits: Limits,
        bodies: Bodies,
        states: States,
        found: Found,
        at: I64,
    ) -> int:
        """As `go_on`."""
        if len(digest) == 0:
            return NOT_BEGUN
        return go_on(part, n_saturated, settings, limits, bodies, states, found, at)

    return fit_bodies


fit_bodies = _compiled(digest_of_sources())
