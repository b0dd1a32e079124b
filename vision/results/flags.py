"""Why a frame failed, or what is worth knowing about it.

Set per body and frame. Any bit of `FAILURE` means that the frame's values are NaN; the others only inform.
"""

from __future__ import annotations

from enum import IntFlag

import numpy as np
from numpy.typing import NDArray


class FrameFlag(IntFlag):
    """Bits of a frame's flag (16 bit); 0 is a good frame."""

    GOOD = 0
    NOT_CONVERGED = 1
    """The fit broke down or did not converge."""
    LOW_CORRELATION = 2
    """Fitted and observed grey values agree too little."""
    FEW_INLIERS = 4
    """Too few pixels agree with the fit: covered, outside the picture, or another texture."""
    JUMP = 8
    """Further from the prediction than a fit can be trusted to find."""
    NO_COVARIANCE = 16
    """The uncertainty could not be computed."""
    ODD_GAIN = 64
    """The contrast has changed more than light can change it."""
    REACQUIRED = 32
    """Found again by a wide search after it was lost, or only by the backward pass; not a failure."""
    UNCONFIRMED = 128
    """The backward pass did not find the body where the forward pass had it."""
    IMPRECISE = 256
    """The stated standard uncertainty is above 25 mdeg, where the 95 % interval reaches 0.05 degrees, and above twice
    that of the body's best quarter of rows, or above half a pixel at its rim; or it is above 12.5 mdeg and the film
    cannot be trusted to show its errors (coarse steps of grey, a codec); not a failure."""
    COVERED = 512
    """Something no outline describes hides part of the body, and a fit without that part did not confirm the pose; not
    a failure."""
    REPEATED = 1024
    """The frame repeats the one before, byte for byte or as a codec stores that: it tells nothing of its time."""
    RENEWED = 2048
    """Fitted against a later frame of the film, which the still frames no longer resemble; its drift is in u; not a
    failure."""
    WIDENED = 4096
    """The stated standard uncertainty is more than twice what texture and noise allow, and than that of the body's best
    quarter of rows, and above 12.5 mdeg, up to 25: usable with that uncertainty, which covers what disturbs the row;
    not a failure."""
    TIME_FILTERED = 8192
    """The camera averages frames in time, or whole interlaced frames are tracked, and motion may be shown late by more
    than the angle's other uncertainty; that is in the total standard uncertainty; not a failure."""
    MISSING = 16384
    """The film has no frame at this time, as its own times say; only in tables, whose row then has frame -1."""


FAILURE = (
    FrameFlag.NOT_CONVERGED
    | FrameFlag.LOW_CORRELATION
    | FrameFlag.FEW_INLIERS
    | FrameFlag.JUMP
    | FrameFlag.NO_COVARIANCE
    | FrameFlag.ODD_GAIN
    | FrameFlag.UNCONFIRMED
    | FrameFlag.REPEATED
    | FrameFlag.MISSING
)


def is_failed(flag: NDArray[np.uint16]) -> NDArray[np.bool_]:
    """Where a body is lost, of the shape of the flags."""
    return (flag & np.uint16(FAILURE)) != 0
