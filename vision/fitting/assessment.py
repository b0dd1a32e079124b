"""Assessment of a fit: noise, correlation, covariance, coherence of residuals; compiled in one call.

Coherence is how far the residuals are from white noise, in the directions that matter to the pose. White residuals move
the pose by many small, independent amounts. Residuals that go together over many pixels (dust, a shadow, a change of
scale, the edge of something in front, noise smoothed by the camera) move it by more, and the residual variance alone
does not tell. Method: the influence of the residuals on the pose is summed over blocks of the template; the blocks'
squares, added, give the variance without assuming that pixels are independent (the sandwich estimator with clusters:
K.-Y. Liang and S. Zeger, Biometrika 73, 1986; T. Conley, J. Econometrics 92, 1999, for clusters in space). Its ratio to
the variance of white noise is one on a clean film. Blocks of several sizes, since a block sees what is coherent over
its own size.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vision.fitting.kernels import F32, F64, I32, I64, RigidFit
from vision.fitting.template import MOST_CONDITION, TILE_PX, Template
from vision.kernel_cache import cached_njit, inner_njit

FAST = {"reassoc", "contract", "arcp", "nsz"}
N_PARAMETERS = 5  # turn, two shifts, gain, offset
COHERENT = 2.0  # ratio over the largest blocks, from which residuals are not noise: 1.12 on average is
HIDDEN_SHARE = 0.05  # of the visible pixels that disagree, from which something hides the body; noise alone makes 0.003
SUSPECTED, SINGULAR, TOO_FEW = 1, 2, 3
"""A fixed pattern may be in the noise; the normal matrix cannot be inverted; too few pixels agree."""


class Blocks(NamedTuple):
    """Blocks of a template's pixels (`vision.fitting.assessment`): ``first`` (n_runs + 1), where each run of pixels of
    one block begins; ``groups`` (sizes, n_runs), in which block of each size it lies; ``freedom`` (sizes,)."""

    first: I64
    groups: I32
    freedom: F64


class BodyFacts(NamedTuple):
    """What is known of a body before a fit: ``columns`` (4, n) and ``noise_normal`` (5, 5) of its template; frames in
    the reference; noise of one still frame, and the share of it below which residuals are not believed; its excess
    from which a pattern is suspected; factor of the covariance for the weights."""

    columns: F32
    noise_normal: F64
    n_averaged: float
    noise_grey: float
    quiet: float
    excess: float
    factor: float


class Assessed(NamedTuple):
    """What is filled in: residual variance and correlation; covariance (3, 3); inverse (5, 5) behind it; ratios and
    numbers of blocks (sizes, 3)."""

    figures: F64
    covariance: F64
    inverse: F64
    ratio: F64
    blocks: F64


# short, so that releasing the lock of the interpreter would cost more than it gives other threads
@cached_njit()
def inverse_and_covariance(
    normal: F64, noise_normal: F64, share: float, factor: float, inverse: F64, covariance: F64
) -> bool:
    """Invert ``normal`` less ``share`` of ``noise_normal``, each (5, 5), into ``inverse``; ``covariance`` (3, 3)
    becomes ``factor`` times the first rows and columns of inverse times ``normal`` times inverse. False where that is
    nearly singular."""
    scale, work = np.empty(5), np.zeros((5, 10))
    for i in range(5):
        diagonal = normal[i, i] - share * noise_normal[i, i]
        if not (diagonal > 0.0 and np.isfinite(diagonal)):
            return False
        scale[i] = 1.0 / np.sqrt(diagonal)
    for i in range(5):
        for j in range(5):
            work[i, j] = (normal[i, j] - share * noise_normal[i, j]) * scale[i] * scale[j]
        work[i, 5 + i] = 1.0
    # Gauss-Jordan without exchange of rows: the matrix is positive where this succeeds
    for i in range(5):
        pivot = work[i, i]
        if not pivot > 1.0 / MOST_CONDITION:
            return False
        for k in range(10):  # whole rows at once would compile a message about their shapes, for 1.5 s
            work[i, k] /= pivot
        for row in range(5):
            if row != i:
                share_of_row = work[row, i]
                for k in range(10):
                    work[row, k] -= share_of_row * work[i, k]
    for i in range(5):
        for j in range(5):
            if not abs(work[i, 5 + j]) < MOST_CONDITION:
                return False
            inverse[i, j] = work[i, 5 + j] * scale[i] * scale[j]
    for i in range(3):
        for j in range(3):
            total = 0.0
            for k in range(5):
                for m in range(5):
                    total += inverse[i, k] * normal[k, m] * inverse[m, j]
            covariance[i, j] = factor * total
    return True


@inner_njit(fastmath=FAST)
def block_sums(columns: F32, work: F32, weight: F32, start: int, end: int) -> tuple[Any, Any, Any, Any, Any]:
    """Scores of pixels ``start..end-1``: sums of their weighted residuals times each of the ``columns`` (4, n), and of
    these residuals; ``work`` holds visible pixels and residuals in rows 1 and 2."""
    # slices begin at zero, as the compiler needs to keep the sums in vector registers
    w, seen, left = weight[start:end], work[1][start:end], work[2][start:end]
    a0, a1, a2, a3 = columns[0][start:end], columns[1][start:end], columns[2][start:end], columns[3][start:end]
    s0 = s1 = s2 = s3 = s4 = np.float32(0.0)
    for i in range(w.size):
        r = w[i] * seen[i] * left[i]
        s0, s1, s2, s3, s4 = s0 + r * a0[i], s1 + r * a1[i], s2 + r * a2[i], s3 + r * a3[i], s4 + r
    return s0, s1, s2, s3, s4


@cached_njit()
def block_ratios(
    blocks: Blocks, columns: F32, work: F32, weight: F32, influence: F64, white: F64, ratio: F64, count: F64
) -> None:
    """Fill ``ratio`` (sizes, 3), variance of (turn, x, y) by blocks of residuals over ``white`` (3,), that by white
    noise, and ``count`` (sizes, 3), the blocks that carry it; ``influence`` (3, 5): change of the pose by each score of
    `block_sums`."""
    first, groups = blocks.first, blocks.groups
    n_sizes, n_runs = groups.shape
    moved = np.zeros((n_sizes, n_runs, 3))
    for k in range(n_runs):
        s0, s1, s2, s3, s4 = block_sums(columns, work, weight, first[k], first[k + 1])
        for j in range(3):
            way = influence[j, 0] * s0 + influence[j, 1] * s1 + influence[j, 2] * s2
            way += influence[j, 3] * s3 + influence[j, 4] * s4
            for size in range(n_sizes):
                moved[size, groups[size, k], j] += way
    for size in range(n_sizes):
        for j in range(3):
            squares = fourth = 0.0
            for k in range(n_runs):
                square = moved[size, k, j] ** 2
                squares += square
                fourth += square * square
            ratio[size, j] = squares / white[j] / blocks.freedom[size]
            # of normal numbers the fourth power has a mean of three
            count[size, j] = 3.0 * squares**2 / max(fourth, 1e-300)


@cached_njit()
def assess_fit(facts: BodyFacts, blocks: Blocks, fit: RigidFit, work: F32, weight: F32, out: Assessed) -> int:
    """Fill ``out`` with variance, correlation, covariance and coherence of a fit, by its last iteration's ``work``
    (rows of grey values, visible pixels, residuals; n) and ``weight`` (n,); returns 0, or why it is not whole
    (`SUSPECTED` and beyond)."""
    sums, gain, covariance = fit.sums, fit.gain, out.covariance
    if sums.weight <= N_PARAMETERS + 1.0:
        return TOO_FEW
    # the weighted sum has as many degrees of freedom as pixels with weight, less the five parameters
    variance = sums.squares / (sums.weight * (1.0 - N_PARAMETERS / max(sums.seen, N_PARAMETERS + 1.0)))
    spread = sums.value2 / sums.weight - (sums.value / sums.weight) ** 2
    explained = 1.0 - sums.squares / sums.weight / spread if spread > 0.0 else 0.0
    reference = gain**2 / facts.n_averaged
    # pixels that are saturated, or of one grey value, have no residual, though the others have their noise
    still = facts.quiet * facts.noise_grey * min(abs(gain), 1.0)
    variance = max(variance, still**2 * (fit.noise_gain + reference))
    out.figures[0], out.figures[1] = variance, math.copysign(math.sqrt(max(explained, 0.0)), gain)
    noise = variance / (fit.noise_gain + reference)
    if noise > facts.excess * facts.noise_grey**2:
        return SUSPECTED
    share, inverse = fit.normal[4, 4] / facts.columns.shape[1], out.inverse
    factor = facts.factor * noise / gain**2
    if not inverse_and_covariance(fit.normal, facts.noise_normal, share, factor, inverse, covariance):
        return SINGULAR
    influence, white = np.empty((3, 5)), np.empty(3)
    for j in range(3):
        # the residuals also hold the noise of the reference
        white[j] = covariance[j, j] * (1.0 + reference)
        for i in range(5):
            influence[j, i] = inverse[j, i] / gain
    block_ratios(blocks, facts.columns, work, weight, influence, white, out.ratio, out.blocks)
    return 0


BLOCK_PX = (TILE_PX, 2 * TILE_PX, 4 * TILE_PX)  # sides of the blocks
N_LEVELS = len(BLOCK_PX)
LEAST_BLOCKS = N_PARAMETERS + 3
"""The fit makes the sums of all blocks vanish in as many directions as it has parameters; of fewer blocks too little is
left to tell anything."""


class Ratios(NamedTuple):
    """Variance of (turn, x, y) from blocks over that from white noise, and the number of blocks that carry it, each
    (3, 3): size of block, direction."""

    ratio: NDArray[np.float64]
    blocks: NDArray[np.float64]


UNKNOWN = Ratios(np.full((N_LEVELS, 3), np.nan), np.full((N_LEVELS, 3), np.nan))


def build_blocks(offset_px: NDArray[np.float32]) -> Blocks:
    """Blocks of each size that a template's pixels lie in, at ``offset_px`` (2, n) from its centre."""
    x, y = np.floor((offset_px - offset_px.min(axis=1, keepdims=True)) / TILE_PX).astype(np.int64)
    # runs of pixels in one square; in a template's order there is one run per square
    starts = np.flatnonzero((np.diff(x, prepend=-1) != 0) | (np.diff(y, prepend=-1) != 0))
    first = np.append(starts, x.size)
    row, column = y[starts], x[starts]
    numbers = [
        np.unique(row // step * (1 << 12) + column // step, return_inverse=True)[1]
        for step in (side // TILE_PX for side in BLOCK_PX)
    ]
    groups = np.array(numbers, dtype=np.int32)
    count = groups.max(axis=1) + 1.0
    for level in range(1, N_LEVELS):
        if count[level] < LEAST_BLOCKS:  # a small body has nothing so large: the largest it has stands for them
            groups[level], count[level] = groups[level - 1], count[level - 1]
    # where not even the smallest tell anything their ratio is zero
    return Blocks(first, groups, np.where(count < LEAST_BLOCKS, np.inf, 1.0 - N_PARAMETERS / count))


def template_blocks(template: Template) -> Blocks:
    return build_blocks(template.offset_px)


def coherence_ratios(
    blocks: Blocks,
    columns: NDArray[np.float32],
    work: NDArray[np.float32],
    weight: NDArray[np.float32],
    influence: NDArray[np.float64],
    white_variance: NDArray[np.float64],
) -> Ratios:
    """`block_ratios` in new arrays: variance of (turn, x, y) by blocks of residuals over ``white_variance`` (3,), and
    the blocks that carry it; ``influence`` (3, 5) is the change of the pose per score."""
    found = Ratios(np.empty((N_LEVELS, 3)), np.empty((N_LEVELS, 3)))
    block_ratios(blocks, columns, work, weight, influence, white_variance, *found)
    return found
