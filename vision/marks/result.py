"""What following marks gives: places of points, offsets and turns of lines, standard uncertainties and flags."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vision.arrays import ArrayRecord
from vision.errors import VisionInputError
from vision.marks.mark import LineMark, Mark
from vision.results.flags import FAILURE

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class MarkResult(ArrayRecord):
    """Marks (m) in frames (n).

    Attributes
    ----------
    marks : tuple of PointMark or LineMark
    frame : ndarray of int, shape (n,)
    time_s : ndarray, shape (n,)
    x_px, y_px : ndarray, shape (n, m)
        Place of a point, picture axes; NaN of a line, and where lost.
    u_x_px, u_y_px : ndarray, shape (n, m)
        Their standard uncertainties as motion from the still frames.
    offset_px, u_offset_px : ndarray, shape (n, m)
        Of a line: how far it has moved to its left since the still frames, at its middle; NaN of a point.
    turn_rad, u_turn_rad : ndarray, shape (n, m)
        Counter-clockwise since the still frames; NaN of a point that shows none.
    zncc, inlier : ndarray, shape (n, m)
        Correlation with the reference, fraction of the pixels that agree.
    flag : ndarray of uint16, shape (n, m)
        `vision.results.flags.FrameFlag`.
    n_still : int
    film : str
    info : dict
    """

    marks: tuple[Mark, ...]
    frame: NDArray[np.int64]
    time_s: NDArray[np.float64]
    x_px: NDArray[np.float64]
    y_px: NDArray[np.float64]
    u_x_px: NDArray[np.float64]
    u_y_px: NDArray[np.float64]
    offset_px: NDArray[np.float64]
    u_offset_px: NDArray[np.float64]
    turn_rad: NDArray[np.float64]
    u_turn_rad: NDArray[np.float64]
    zncc: NDArray[np.float64]
    inlier: NDArray[np.float64]
    flag: NDArray[np.uint16]
    n_still: int
    film: str
    info: dict[str, Any] = field(default_factory=dict)

    @property
    def failed(self) -> NDArray[np.bool_]:
        """True where a mark was lost, shape (n, m)."""
        return (self.flag & np.uint16(FAILURE)) != 0

    def column(self, mark: str) -> int:
        """Index of a mark; raises `VisionInputError` for an unknown name."""
        names = [each.name for each in self.marks]
        if mark not in names:
            raise VisionInputError(f"mark {mark!r} was not followed; followed are {', '.join(names)}")
        return names.index(mark)

    def to_table(self) -> pd.DataFrame:
        """One row per frame: time_s, frame, then per point ``<name>_x_px``, ``_y_px``, ``_u_x_px``, ``_u_y_px``, per
        line ``<name>_offset_px``, ``_u_offset_px``, of both, where it is known, ``_turn_rad``, ``_u_turn_rad``, and
        ``_quality``, ``_inlier``, ``_flag``.
        """
        # start-up: pandas costs 0.5 s, a result without a table does without
        import pandas as pd

        columns: dict[str, NDArray[Any]] = {"time_s": self.time_s, "frame": self.frame}
        for i, mark in enumerate(self.marks):
            line, turns = isinstance(mark, LineMark), bool(np.isfinite(self.turn_rad[:, i]).any())
            names = ["offset_px", "u_offset_px"] if line else ["x_px", "y_px", "u_x_px", "u_y_px"]
            for name in [*names, *(["turn_rad", "u_turn_rad"] if turns else [])]:
                columns[f"{mark.name}_{name}"] = getattr(self, name)[:, i]
            columns[f"{mark.name}_quality"] = self.zncc[:, i]
            columns[f"{mark.name}_inlier"] = self.inlier[:, i]
            columns[f"{mark.name}_flag"] = self.flag[:, i]
        return pd.DataFrame(columns)
