"""What a fitter carries over from frame to frame, in arrays that may be parts of larger ones.

`vision.frame_fit` lays those of all bodies of a film side by side, so that compiled code and the fitters in Python work
on the same.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vision.fitting.assessment import Assessed
from vision.fitting.kernel_records import RigidFit


class FitMemory(NamedTuple):
    """What a fitter carries over, and works in: arrays of `kernel_records.State`; ``scale`` and ``apart`` (1,), the
    last 1 where the next fit is not a plain one: a cautious start, or light or scale that have changed."""

    weight: NDArray[np.float32]
    work: NDArray[np.float32]
    at: NDArray[np.int32]
    scale: NDArray[np.float64]
    apart: NDArray[np.uint8]

    @classmethod
    def empty(cls, n_pixels: int) -> FitMemory:
        """For a body of so many pixels."""
        weight, work = np.ones(n_pixels, dtype=np.float32), np.zeros((5, n_pixels), dtype=np.float32)
        return cls(weight, work, np.zeros(n_pixels, dtype=np.int32), np.zeros(1), np.zeros(1, dtype=np.uint8))


class Begun(NamedTuple):
    """A first fit from the expected pose that compiled code has done and assessed, with the answer of `assess`."""

    found: RigidFit
    pose: NDArray[np.float64]
    out: Assessed
    lacking: int
