"""Result of tracking a film: angles with uncertainty, quality and flags, frame by frame.

Conventions: angles counter-clockwise (x right, y up), zero at the mean of the still frames, rad, not wrapped;
positions in picture axes (y down), px. A frame that failed is NaN in every quantity, with the reason in
``flag``.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vision.angles import relative_angle
from vision.arrays import ArrayRecord
from vision.errors import VisionInputError
from vision.results.flags import FrameFlag, is_failed
from vision.tabular import Tabular
from vision.uncertainty.budget import ErrorBudget

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, repr=False)
class TrackResult(Tabular, ArrayRecord):
    """Poses of m bodies in n frames; ``result["jack"]`` is an angle, ``result["jack_relative"]`` that from its parent.

    Attributes
    ----------
    bodies : tuple of str
    parents : tuple of (str or None)
    frame : ndarray of int, shape (n,)
        Frame numbers in the film.
    time_s : ndarray, shape (n,)
    angle_rad, u_angle_rad : ndarray, shape (n, m)
        Angle and its standard uncertainty from noise and reference, common part included.
    u_common_rad : ndarray, shape (m,)
        Part of the uncertainty that all frames share (error of the zero).
    x_px, y_px : ndarray, shape (n, m)
        Centre of the body's region.
    zncc, inlier : ndarray, shape (n, m)
        Correlation with the template, fraction of its pixels that agree.
    noise_grey : ndarray, shape (n, m)
        Residual of the fit.
    flag : ndarray of uint16, shape (n, m)
        `vision.results.flags.FrameFlag`.
    predicted_u_rad : ndarray, shape (m,)
        Standard uncertainty predicted before tracking, from noise and reference.
    covariance : ndarray, shape (n, m, 3, 3)
        Of (turn, x, y), picture axes, rad and px, from each frame's own noise.
    budget : ErrorBudget
        All terms of the angles' uncertainty, frame by frame.
    n_still : int
    film : str
    info : dict
        Counts and settings of the run.
    """

    bodies: tuple[str, ...]
    parents: tuple[str | None, ...]
    frame: NDArray[np.int64]
    time_s: NDArray[np.float64]
    angle_rad: NDArray[np.float64]
    u_angle_rad: NDArray[np.float64]
    u_common_rad: NDArray[np.float64]
    x_px: NDArray[np.float64]
    y_px: NDArray[np.float64]
    zncc: NDArray[np.float64]
    inlier: NDArray[np.float64]
    noise_grey: NDArray[np.float64]
    flag: NDArray[np.uint16]
    predicted_u_rad: NDArray[np.float64]
    covariance: NDArray[np.float64]
    budget: ErrorBudget
    n_still: int
    film: str
    info: dict[str, Any] = field(default_factory=dict)

    @property
    def is_lost(self) -> NDArray[np.bool_]:
        """True where a body was lost, shape (n, m)."""
        return is_failed(self.flag)

    failed = is_lost  # its former name, for one release

    def column(self, body: str) -> int:
        """Index of a body; raises `VisionInputError` for an unknown name."""
        try:
            return self.bodies.index(body)
        except ValueError:
            raise VisionInputError(f"body {body!r} was not tracked; tracked are {', '.join(self.bodies)}") from None

    def relative(self, body: str) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.uint16]]:
        """Angle of a body less that of its parent, (n,), rad, its standard uncertainty, rad, NaN where either is lost,
        and the flags of both, joined; `VisionInputError` for a body without a parent.

        Parameters
        ----------
        body : a body with a parent

        Returns
        -------
        angle_rad, u_rad : ndarray, shape (n,)
            NaN where either is lost.
        flag : ndarray of uint16, shape (n,)
            The flags of both, joined.

        Raises
        ------
        VisionInputError
            For an unknown body or one without a parent.
        """
        child = self.column(body)
        name = self.parents[child]
        if name is None:
            raise VisionInputError(
                f"body {body!r} has no parent, so it has no relative angle; give it one in its outline file"
            )
        parent = self.column(name)
        angle, u = relative_angle(
            self.angle_rad[:, child], self.angle_rad[:, parent], self.u_angle_rad[:, child], self.u_angle_rad[:, parent]
        )
        return angle, u, self.flag[:, child] | self.flag[:, parent]

    @property
    def u_total_rad(self) -> NDArray[np.float64]:
        """Standard uncertainty of each angle at the stated time, shape (n, m): all terms of the budget but
        synchronisation, which belongs to the time."""
        return self.budget.total(without=("synchronisation",))

    @property
    def u_position_px(self) -> NDArray[np.float64]:
        """Standard uncertainty of ``x_px`` and ``y_px`` as motion from the reference, noise and reference, shape
        (n, m, 2)."""
        variance = np.diagonal(self.covariance, axis1=2, axis2=3)[..., 1:]
        moving = self.frame >= self.n_still
        single = variance[moving] if moving.any() else variance
        known = np.where(np.isfinite(single), single, 0.0).sum(axis=0)
        common = known / np.maximum(np.isfinite(single).sum(axis=0), 1) / self.n_still
        return np.asarray(np.sqrt(variance + common))

    def __repr__(self) -> str:
        times = f", {self.time_s[0]:g} to {self.time_s[-1]:g} s" if len(self.time_s) else ""
        lost = ", ".join(f"{body} {int(n)}" for body, n in zip(self.bodies, self.is_lost.sum(axis=0), strict=True) if n)
        return (
            f"<TrackResult of {', '.join(self.bodies)} in {self.film}: {len(self.frame)} frames{times}"
            f"{f'; lost: {lost}' if lost else ''}>"
        )

    def _repr_html_(self) -> str:
        """Table, as HTML for a notebook, of each body's frames, lost frames, range of the angle, degrees, and median
        total standard uncertainty, mdeg."""
        import pandas as pd  # start-up: 0.5 s, only a notebook's display needs it

        rows = []
        for i, body in enumerate(self.bodies):
            angle, u = np.degrees(self.angle_rad[:, i]), np.degrees(self.u_total_rad[:, i])
            known = np.isfinite(angle)
            rows.append(
                {
                    "body": body,
                    "from": self.parents[i] or "the picture",
                    "frames": len(self.frame),
                    "lost": int(self.is_lost[:, i].sum()),
                    "least, °": angle[known].min() if known.any() else np.nan,
                    "largest, °": angle[known].max() if known.any() else np.nan,
                    "median u, mdeg": 1e3 * np.median(u[known]) if known.any() else np.nan,
                }
            )
        return str(pd.DataFrame(rows).to_html(index=False, float_format="{:.2f}".format))

    def columns(self) -> dict[str, NDArray[Any]]:
        """Columns (n,) by name: time_s, frame, then per body ``<body>_rad``, ``_u_rad`` (noise and reference),
        ``_u_total_rad``, the same with ``_relative``, ``_x_px``, ``_y_px``, ``_u_x_px``, ``_u_y_px``, ``_quality``,
        ``_inlier``, ``_flag``."""
        total, u_position = self.u_total_rad, self.u_position_px
        relative_total = self.budget.total(relative=True, without=("synchronisation",))
        columns: dict[str, NDArray[Any]] = {"time_s": self.time_s, "frame": self.frame}
        for i, body in enumerate(self.bodies):
            columns[f"{body}_rad"] = self.angle_rad[:, i]
            columns[f"{body}_u_rad"] = self.u_angle_rad[:, i]
            columns[f"{body}_u_total_rad"] = total[:, i]
            if self.parents[i] is not None:
                angle, u, _ = self.relative(body)
                columns[f"{body}_relative_rad"] = angle
                columns[f"{body}_relative_u_rad"] = u
                columns[f"{body}_relative_u_total_rad"] = relative_total[:, i]
            columns[f"{body}_x_px"] = self.x_px[:, i]
            columns[f"{body}_y_px"] = self.y_px[:, i]
            columns[f"{body}_u_x_px"], columns[f"{body}_u_y_px"] = u_position[:, i].T
            columns[f"{body}_quality"] = self.zncc[:, i]
            columns[f"{body}_inlier"] = self.inlier[:, i]
            columns[f"{body}_flag"] = self.flag[:, i]
        return columns

    def to_frame(self) -> pd.DataFrame:
        """Return the columns as a pandas table, one more row per frame that is missing in the film (`info`
        ``missing_after``: frame -1, flag `FrameFlag.MISSING`, else NaN); ``attrs["units"]`` has their units."""
        table, missing = super().to_frame(), self._missing_times()
        if not missing.size:
            return table
        import pandas as pd  # start-up: 0.5 s, a result without a table does without

        rows: dict[str, Any] = {"time_s": missing, "frame": -1}
        rows |= {f"{body}_flag": np.uint16(int(FrameFlag.MISSING)) for body in self.bodies}
        lacking = pd.DataFrame(rows, columns=table.columns).astype(table.dtypes)
        whole = pd.concat([table, lacking]).sort_values("time_s", ignore_index=True)
        whole.attrs["units"] = table.attrs["units"]
        return whole

    def _missing_times(self) -> NDArray[np.float64]:
        """Times of the frames that the film lacks, s, evenly between those around them; empty where it lacks none."""
        return np.concatenate(
            [np.empty(0)]
            + [
                np.linspace(self.time_s[row], self.time_s[row + 1], count + 2)[1:-1]
                for row, count in self.info.get("missing_after", {}).items()
            ]
        )
