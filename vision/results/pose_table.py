"""Poses of all bodies in all tracked frames while a film is being tracked.

Poses are as in `vision.fitting.base` (picture axes); a body lost in a frame is NaN with the reason in ``flag``.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from vision.angles import turn_matrix
from vision.fitting.assessment import N_LEVELS
from vision.fitting.base import Fit
from vision.results.flags import FAILURE, FrameFlag, is_failed


@dataclass(frozen=True)
class PoseTable:
    """Columns of n frames and m bodies, each (n, m) where nothing else is said."""

    frame: NDArray[np.int64]
    """(n,): frame number of each row."""
    pose: NDArray[np.float64]
    """(n, m, 3): turn (rad, clockwise to the eye) and shift (px)."""
    covariance: NDArray[np.float64]
    """(n, m, 3, 3): of the pose, from that frame's noise; its shift is along the body's own axes, which turn with
    it."""
    zncc: NDArray[np.float64]
    inlier: NDArray[np.float64]
    noise_grey: NDArray[np.float64]
    gain: NDArray[np.float64]
    flag: NDArray[np.uint16]
    ratio: NDArray[np.float64]
    blocks: NDArray[np.float64]
    """(n, m, 3, 3): coherence of the residuals, see `vision.fitting.assessment.Ratios`."""

    @classmethod
    def empty(cls, frame: NDArray[np.int64], n_bodies: int) -> PoseTable:
        """Table of the frames numbered ``frame`` (n,), in which every body is lost."""
        n = frame.size
        zncc, inlier, noise, gain = (np.full((n, n_bodies), np.nan) for _ in range(4))
        flag = np.full((n, n_bodies), int(FrameFlag.NOT_CONVERGED), dtype=np.uint16)
        pose, covariance = np.full((n, n_bodies, 3), np.nan), np.full((n, n_bodies, 3, 3), np.nan)
        ratio, blocks = (np.full((n, n_bodies, N_LEVELS, 3), np.nan) for _ in range(2))
        return cls(frame, pose, covariance, zncc, inlier, noise, gain, flag, ratio, blocks)

    @property
    def is_lost(self) -> NDArray[np.bool_]:
        return is_failed(self.flag)

    @property
    def u_turn(self) -> NDArray[np.float64]:
        """Standard uncertainty of the turn from the frame's noise, rad, shape (n, m)."""
        return np.sqrt(self.covariance[..., 0, 0])

    def store(self, row: int, body: int, fit: Fit, flag: FrameFlag) -> None:
        """Store the fit of one body (index) in a row with its flag; of a failed one the flag only, its row
        being lost."""
        if flag is not FrameFlag.GOOD and flag & FAILURE:
            self.flag[row, body] = 0
            self.reject(row, body, flag)
            return
        self.flag[row, body] = int(flag)
        self.pose[row, body], self.covariance[row, body] = fit.pose, fit.covariance
        self.zncc[row, body], self.inlier[row, body] = fit.zncc, fit.inlier
        self.noise_grey[row, body], self.gain[row, body] = fit.noise_grey, fit.gain
        self.ratio[row, body], self.blocks[row, body] = fit.coherence

    def reject(self, row: int, body: int, flag: FrameFlag) -> None:
        """Replace a body's values in a row by NaN, with a flag."""
        self.flag[row, body] |= np.uint16(int(flag))
        for name in (field.name for field in fields(self)[1:] if field.name != "flag"):
            getattr(self, name)[row, body] = np.nan

    def rows(self, rows: NDArray[np.intp]) -> PoseTable:
        return PoseTable(*(getattr(self, field.name)[rows] for field in fields(self)))

    def take(self, at: slice | tuple[int, int], other: PoseTable, there: slice | tuple[int, int]) -> None:
        """Take rows, or a row of one body, of another table."""
        for name in (field.name for field in fields(self)[1:]):
            getattr(self, name)[at] = getattr(other, name)[there]


def rotate_covariance(covariance: NDArray[np.float64], turn_rad: NDArray[np.float64] | float) -> NDArray[np.float64]:
    """Covariances (..., 3, 3) of (turn, x, y) along a body's own axes as along the picture's, where the body has turned
    by ``turn_rad`` (...)."""
    whole = np.zeros(covariance.shape)
    whole[..., 0, 0], whole[..., 1:, 1:] = 1.0, turn_matrix(turn_rad)
    return np.asarray(whole @ covariance @ np.swapaxes(whole, -1, -2))


def pose_difference(pose: NDArray[np.float64], other: NDArray[np.float64]) -> NDArray[np.float64]:
    """A pose (3,) of a body less another, the shift along the body's own axes."""
    off = pose - other
    return np.array([off[0], *(off[1:] @ turn_matrix(other[0]))])
