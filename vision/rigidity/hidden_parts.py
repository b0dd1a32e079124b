"""Bodies of which something hides a part: fitted once more without that part, and confirmed or widened.

Weights suppress what hides a body, but not all of it: where it is like the body, some of its pixels keep their weight.
Method: squares of the template in which many pixels do not agree are left out altogether, and the rest is fitted from
the pose found. Where both poses agree within what leaving pixels out makes of noise, the second, which owes nothing to
those squares, stands with its own uncertainty and without the flag; where they do not, the flag stays and their
difference goes into the uncertainty.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vision.fitting.base import Fit
from vision.fitting.coherence import blocks_of
from vision.fitting.icgn import IcgnFitter
from vision.reference.prepared_film import PreparedFilm
from vision.results.flags import FAILURE, FrameFlag
from vision.results.pose_table import PoseTable

LEVEL = 1
"""Squares of 16 px."""
DOUBTED = 0.3
"""A pixel of less weight does not agree; of normal noise 4 % have less."""
MANY = 0.15
"""Share of such pixels in a square that is left out."""
AGREE_SIGMA = 2.5
LEAST_SEEN = 0.35
"""Share of the template that must be left."""
STILL_COVERED = 0.05
"""Share of the template that may disagree once the squares are left out; noise alone makes 0.003."""


def confirm_hidden(ready: PreparedFilm, table: PoseTable, doubted: NDArray[np.bool_]) -> int:
    """Confirm or widen the rows flagged `COVERED`; those of bodies that are ``doubted`` (m,) keep the flag in any case.

    Returns the number of rows and bodies without the flag.
    """
    covered = (table.flag & np.uint16(int(FrameFlag.COVERED))) != 0
    cleared = 0
    for i, template in enumerate(ready.templates):
        rows = np.flatnonzero(covered[:, i] & ~table.failed[:, i])
        if not rows.size:
            continue
        fitter, squares = IcgnFitter(template), blocks_of(template.offset_px)
        square = np.repeat(squares.groups[LEVEL], np.diff(squares.first))
        for row in rows:
            again = _without_squares(ready, table, int(row), i, (fitter, square))
            if again is None:
                continue
            apart = again.pose - table.pose[row, i]
            variance = again.covariance.diagonal()
            if np.any(apart**2 > AGREE_SIGMA**2 * variance):
                table.covariance[row, i] += np.diag(apart**2)
            elif again.seen - again.inlier < STILL_COVERED and not doubted[i]:
                table.store(int(row), i, again, _without_flag(int(table.flag[row, i])))
                cleared += 1
    return cleared


def _without_squares(
    ready: PreparedFilm, table: PoseTable, row: int, i: int, with_what: tuple[IcgnFitter, NDArray[np.int32]]
) -> Fit | None:
    """Fit of a body in a row without the squares that do not agree; None where that fails or leaves too little."""
    (fitter, square), pose, frame = with_what, table.pose[row, i], int(table.frame[row])
    others = {j: table.pose[row, j] for j in ready.occlusion.in_front[i] if not table.failed[row, j]}
    hidden = ready.occlusion.covered(i, pose, others)
    fitter.reset(cautious=True)
    first = fitter.fit(ready.film, frame, pose, hidden)
    if not first.converged:
        return None
    seen = hidden == 0
    doubtful = (fitter.state()["weight"] < DOUBTED) & seen
    count = int(square.max()) + 1
    share = np.bincount(square[doubtful], minlength=count) / np.maximum(np.bincount(square[seen], minlength=count), 1)
    left_out = np.where(share[square] > MANY, np.uint8(1), hidden)
    if np.count_nonzero(left_out == 0) < LEAST_SEEN * left_out.size:
        return None
    fitter.reset()
    again = fitter.fit(ready.film, frame, first.pose, left_out)
    return again if again.converged and np.isfinite(again.covariance).all() else None


def _without_flag(flag: int) -> FrameFlag:
    kept = FrameFlag(flag) & ~FrameFlag.COVERED
    assert not kept & FAILURE
    return kept
