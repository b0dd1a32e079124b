"""Track marks, points and lines, through a film."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vision.angles import picture_to_ccw, turn_matrix
from vision.arrays import ArrayRecord
from vision.errors import TrackingError, VisionInputError
from vision.film.open import open_or_use
from vision.film.source import FrameSource
from vision.fitting.frame_spline import FrameSpline
from vision.marks.mark import LineMark, Mark
from vision.marks.mark_fitter import UNTURNED, MarkFitter, mark_template
from vision.reference.still_average import average_still_frames, count_still_frames
from vision.results.flags import FrameFlag, is_failed
from vision.results.pose_table import PoseTable, rotate_covariance
from vision.tracking.body_tracker import BodyTracker
from vision.tracking.film_tracker import build_repeat_detector
from vision.tracking.options import check_count
from vision.tracking.prepare import FIRST_AVERAGED, frame_times
from vision.tracking.square_film import refuse_interlaced
from vision.uncertainty.coherence import inflate_covariance, variance_factor

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
    def is_lost(self) -> NDArray[np.bool_]:
        """True where a mark was lost, shape (n, m)."""
        return is_failed(self.flag)

    failed = is_lost  # its former name, for one release

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


def follow_marks(
    path_or_source: str | os.PathLike[str] | FrameSource,
    marks: Sequence[Mark],
    frame_time_s: ArrayLike | None = None,
    *,
    every: int = 1,
    n_still: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> MarkResult:
    """Follow points and lines through a film.

    Parameters
    ----------
    path_or_source : path or FrameSource
    marks : sequence of PointMark or LineMark
        Drawn on the still frames at the start of the film.
    frame_time_s : array_like, shape (n_frames,), optional
        Middle of each exposure, s; the film's own times when None.
    every : int
        Use one frame out of this many.
    n_still : int or None
        Still frames at the start; found from the film when None.
    progress : callable, optional
        Called with (frames done, frames in all).

    Returns
    -------
    MarkResult
        A frame in which a mark is lost is NaN with a flag.

    Raises
    ------
    VisionInputError
        A film, marks, times or settings that cannot be used; a mark without contrast.

    Examples
    --------
    >>> import vision
    >>> x, y = vision.load_bodies("bodies.toml")[0].polygon_px.mean(axis=0)
    >>> result = vision.follow_marks("film.mraw", [vision.PointMark("spot", (x, y), 12.0)], every=10)
    >>> result.x_px.shape, int(result.is_lost.sum())
    ((15, 1), 0)
    """
    with open_or_use(path_or_source) as film:
        refuse_interlaced(film)
        if not marks:
            raise VisionInputError(f"{film.path}: no marks given; name at least one point or line")
        check_count("every", every)
        time_s = frame_times(film, frame_time_s)
        trackers, n_still = _prepare_trackers(film, marks, n_still)
        table = PoseTable.empty(np.arange(0, film.n_frames, every), len(marks))
        _follow(film, trackers, table, n_still, progress)
        return _result(film, marks, trackers, table, time_s, n_still)


def _trackers(film: FrameSource, marks: Sequence[Mark], n_still: int) -> list[BodyTracker]:
    """Marks at rest in the average of the first ``n_still`` frames."""
    region = np.logical_or.reduce([mark.mask(film.height, film.width) for mark in marks])
    if not region.any():
        raise VisionInputError(f"{film.path}: no mark lies inside the {film.width} x {film.height} picture")
    reference, frames = average_still_frames(film, region, n_still), FrameSpline(film)
    return [BodyTracker.create_single(MarkFitter(*mark_template(mark, reference), frames)) for mark in marks]


def _prepare_trackers(film: FrameSource, marks: Sequence[Mark], n_still: int | None) -> tuple[list[BodyTracker], int]:
    if n_still is None:
        region = np.logical_or.reduce([mark.mask(film.height, film.width) for mark in marks])
        candidates = average_still_frames(film, region).n_averaged
        trackers = _trackers(film, marks, min(FIRST_AVERAGED, candidates))
        table = PoseTable.empty(np.arange(candidates), len(marks))
        _follow(film, trackers, table, candidates, None)
        u = np.sqrt(np.diagonal(table.covariance, axis1=2, axis2=3))
        n_still = count_still_frames(table.pose.reshape(candidates, -1), u.reshape(candidates, -1))
    trackers = _trackers(film, marks, n_still)
    table = PoseTable.empty(np.arange(n_still), len(marks))
    _follow(film, trackers, table, n_still, None)
    for mark, lost in zip(marks, table.is_lost.mean(axis=0), strict=True):
        if lost > 0.5:
            raise TrackingError(
                f"{film.path}: mark {mark.name} is found in {round((1.0 - lost) * n_still)} of the {n_still} still "
                "frames; look at its place on the first frame"
            )
    for tracker in trackers:
        tracker.clear()
        tracker.place(-1, np.zeros(3))
    return trackers, n_still


def _follow(
    film: FrameSource,
    trackers: list[BodyTracker],
    table: PoseTable,
    n_still: int,
    progress: Callable[[int, int], None] | None,
) -> None:
    """Fill the table, row by row."""
    repeats = build_repeat_detector(film, [tracker.template for tracker in trackers], n_still)
    for row, index in enumerate(table.frame.tolist()):
        repeated = index >= n_still and repeats.is_repeat(index)
        for i, tracker in enumerate(trackers):
            if repeated:
                tracker.skip(row, FrameFlag.REPEATED)
            else:
                tracker.step(film, index, row, tracker.predict(row), None, search=index >= n_still)
            table.store(row, i, tracker.fit, tracker.flag)
        if progress is not None:
            progress(row + 1, table.frame.size)


def _result(
    film: FrameSource,
    marks: Sequence[Mark],
    trackers: list[BodyTracker],
    table: PoseTable,
    time_s: NDArray[np.float64],
    n_still: int,
) -> MarkResult:
    """Positions and offsets with their uncertainties, the common part of the reference included."""
    covariance = inflate_covariance(table.covariance, variance_factor(table.ratio, table.blocks))
    moving = table.frame >= n_still
    typical = np.nanmedian(covariance[moving] if moving.any() else covariance, axis=0)
    covariance = covariance + np.nan_to_num(typical) / n_still
    names = ("x_px", "y_px", "u_x_px", "u_y_px", "offset_px", "u_offset_px", "turn_rad", "u_turn_rad")
    columns = {name: np.full(table.flag.shape, np.nan) for name in names}
    for i, (mark, tracker) in enumerate(zip(marks, trackers, strict=True)):
        pose, own = table.pose[:, i], covariance[:, i]
        if own[:, 0, 0][np.isfinite(own[:, 0, 0])].min(initial=np.inf) > 2.0 * UNTURNED * (1.0 + 1.0 / n_still):
            columns["turn_rad"][:, i], columns["u_turn_rad"][:, i] = picture_to_ccw(pose[:, 0]), np.sqrt(own[:, 0, 0])
        if isinstance(mark, LineMark):
            normal = mark.normal
            turned = turn_matrix(pose[:, 0]) @ normal
            # where the line now crosses its normal through the middle
            columns["offset_px"][:, i] = np.sum(pose[:, 1:] * turned, axis=1) / (turned @ normal)
            variance = np.einsum("i,nij,j->n", normal, own[:, 1:, 1:], normal)
            columns["u_offset_px"][:, i] = np.sqrt(variance) / (turned @ normal)
        else:
            x, y = tracker.template.centre_px
            columns["x_px"][:, i], columns["y_px"][:, i] = x + pose[:, 1], y + pose[:, 2]
            seen = rotate_covariance(own, pose[:, 0])
            columns["u_x_px"][:, i], columns["u_y_px"][:, i] = np.sqrt(seen[:, 1, 1]), np.sqrt(seen[:, 2, 2])
    return MarkResult(
        marks=tuple(marks),
        frame=table.frame,
        time_s=time_s[table.frame],
        **columns,
        zncc=table.zncc,
        inlier=table.inlier,
        flag=table.flag,
        n_still=n_still,
        film=str(film.path),
        info={"pixels": {t.template.name: t.template.n_pixels for t in trackers}},
    )
