"""Assemble the result of tracking: zero, camera correction, angles, uncertainties, error budget."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vision.angles import picture_to_ccw
from vision.camera.model import Projection
from vision.errors import TrackingError
from vision.fitting.pose_covariance import predicted_u_angle
from vision.item_map import ItemMap, serial_map
from vision.reference.camera_faults import is_coarsely_quantised
from vision.reference.prepared_film import PreparedFilm
from vision.results.flags import FrameFlag
from vision.results.pose_table import PoseTable, rotate_covariance
from vision.results.track_result import TrackResult
from vision.tracking.film_tracker import FilmTracker, track_first_frames
from vision.tracking.options import FitSettings
from vision.tracking.passes import SAME_PX
from vision.uncertainty.budget_terms import UNDECLARED_FACTOR, PoseResponse, TrackedAngles, compute_budget
from vision.uncertainty.coherence import expected_ratio, inflate_covariance, variance_factor

WANTED_RAD = np.radians(0.05)  # accuracy of an angle that a model of an action is tested with
PRECISE_U_RAD = WANTED_RAD / 4.0
"""Up to this an error of 0.05 degrees is at least four standard uncertainties away."""
MOST_PRECISE_U_RAD = WANTED_RAD / 2.0
"""Beyond this the 95 % interval is wider than 0.05 degrees to each side, whatever the texture."""
USUAL_SHARE = 2.0
"""A u up to this many times what texture and noise allow, or what the body's best quarter of rows has, is the film's,
not the row's."""


def widened_threshold(predicted_u_rad: NDArray[np.float64]) -> NDArray[np.float64]:
    """Standard uncertainty above which a row is flagged `WIDENED`, by what is expected of the body, rad."""
    usual = np.nan_to_num(USUAL_SHARE * predicted_u_rad, nan=PRECISE_U_RAD)
    return np.asarray(np.clip(usual, PRECISE_U_RAD, MOST_PRECISE_U_RAD))


def _width_flags(
    ready: PreparedFilm, predicted_u_rad: NDArray[np.float64], u_rad: NDArray[np.float64]
) -> NDArray[np.uint16]:
    """Flags (n, m) of ``u_rad`` (n, m) too wide beside those predicted (m,) and usual: `WIDENED` up to 25 mdeg where
    the film can tell, else `IMPRECISE`; 0 for others and lost rows."""
    film_tells = np.array([not is_coarsely_quantised(template, ready.grey_step) for template in ready.templates])
    film_tells &= not ready.skips_blocks
    # what the best quarter of a body's rows have at most; 0 where it is lost in all of them
    best = [np.quantile(u[np.isfinite(u)], 0.25) if np.isfinite(u).any() else 0.0 for u in u_rad.T]
    usual = USUAL_SHARE * np.array(best)
    linear = SAME_PX / np.array([template.radius_px for template in ready.templates])
    limit = widened_threshold(predicted_u_rad)
    wide = u_rad > np.where(film_tells, np.maximum(limit, np.minimum(usual, linear)), limit)
    usable = film_tells & (u_rad <= MOST_PRECISE_U_RAD)
    widened, imprecise = np.uint16(int(FrameFlag.WIDENED)), np.uint16(int(FrameFlag.IMPRECISE))
    return np.where(wide, np.where(usable, widened, imprecise), np.uint16(0))


@dataclass(frozen=True)
class Zero:
    """Mean over the still frames, per body."""

    turn_rad: NDArray[np.float64]
    """(m,): picture rotation."""
    u_single_rad: NDArray[np.float64]
    """(m,): standard uncertainty of the turn in one frame."""
    n_frames: NDArray[np.intp]
    """(m,): still frames in which the body was found."""


def estimate_zero(ready: PreparedFilm) -> Zero:
    """Zero of the angles; raises `TrackingError` for a body found in fewer than half of the still frames."""
    pose, u = track_first_frames(FilmTracker(ready), ready.reference.n_averaged)
    return _mean_zero(ready, pose[..., 0], u[..., 0])


def estimate_zero_from_rows(ready: PreparedFilm, table: PoseTable) -> Zero:
    still = table.frame < ready.reference.n_averaged
    return _mean_zero(ready, table.pose[still, :, 0], table.u_turn[still])


def _mean_zero(ready: PreparedFilm, turn: NDArray[np.float64], u: NDArray[np.float64]) -> Zero:
    """Zero of the angles by turns and their standard uncertainties in the still frames, (n, m), rad, picture axes, NaN
    where lost: mean turn, uncertainty of one frame, frames found, each (m,); `TrackingError` for a body lost in more
    than half of them."""
    n = ready.reference.n_averaged
    good = np.count_nonzero(np.isfinite(turn), axis=0)
    for i, body in enumerate(ready.bodies):
        if 2 * good[i] < n:
            raise TrackingError(
                f"{ready.film.path}: body {body.name} is found in {good[i]} of the {n} still frames; "
                "check its outline against the first frame"
            )
    return Zero(np.nanmean(turn, axis=0), np.sqrt(np.nanmean(u**2, axis=0)), good)


def _inflate_coherent_rows(ready: PreparedFilm, table: PoseTable, camera: Projection | None) -> PoseTable:
    """The table with covariances widened for residuals coherent beyond what ``camera``, if calibrated, explains, for
    skipped blocks, and for resampling."""
    ratio = table.ratio
    if camera is not None:
        white = np.diagonal(table.covariance, axis1=2, axis2=3)
        added = [expected_ratio(t, camera, table.pose[:, i], white[:, i]) for i, t in enumerate(ready.templates)]
        ratio = np.maximum(ratio - np.stack(added, axis=1), 0.0)
    factor = variance_factor(ratio, table.blocks)
    if ready.skips_blocks:
        factor = factor + UNDECLARED_FACTOR**2
    if ready.rectified_film is not None:
        factor = np.maximum(factor, ready.rectified_film.oversampling)
    return replace(table, covariance=inflate_covariance(table.covariance, factor))


def assemble_result(
    ready: PreparedFilm,
    zero: Zero,
    table: PoseTable,
    time_s: NDArray[np.float64],
    settings: FitSettings,
    info: dict[str, Any],
    map_items: ItemMap = serial_map,
    u_stretch: float = 0.0,
) -> TrackResult:
    """Result of the rows of ``table``: angles less ``zero``, uncertainties, flags and budget; ``time_s`` (n_frames,):
    of all frames of the film; ``info``: kept in the result; ``u_stretch``: standard uncertainty of the picture's
    stretch."""
    film, bodies, reference = ready.film, ready.bodies, ready.reference
    # what the film was resampled by is corrected already
    is_corrected = ready.rectified_film is not None and ready.rectified_film.projection is not None
    nominal = None if is_corrected else settings.camera_model.nominal(film.width, film.height)
    table = _inflate_coherent_rows(ready, table, nominal)
    predicted = np.array([predicted_u_angle(t, reference.noise_grey) for t in ready.templates])
    if ready.rectified_film is not None:
        predicted *= np.sqrt(ready.rectified_film.oversampling)
    u_single = zero.u_single_rad.copy()
    # a still frame agrees too well with the average it is part of, so the noise is taken from the other frames
    others = table.u_turn[table.frame >= reference.n_averaged]
    known = np.isfinite(others).sum(axis=0) > 0
    u_single[known] = np.nanmedian(others[:, known], axis=0)
    # noise that is correlated in time averages out more slowly
    u_common = u_single * np.sqrt((1.0 + 2.0 * ready.delay_frames) / zero.n_frames)
    pose = table.pose.copy()
    pose[..., 0] -= zero.turn_rad
    if nominal is not None:
        for i, template in enumerate(ready.templates):
            pose[:, i, 0] = PoseResponse(template).correct_turn(nominal, pose[:, i])
    tracked = TrackedAngles(
        time_s[table.frame],
        pose,
        picture_to_ccw(pose[..., 0]),
        table.u_turn,
        u_common,
        float(np.median(np.diff(time_s))) if time_s.size > 1 else 0.0,
        u_stretch,
    )
    budget = compute_budget(ready, settings.camera_model, tracked, settings.u_time_s, settings.rows_per_s, map_items)
    u_angle = np.hypot(tracked.u_noise_rad, u_common)
    flag = table.flag.copy()
    is_woven = ready.u_field_frames > 0.0 and (ready.rectified_film is None or ready.rectified_film.field is None)
    if ready.delay_frames or is_woven:
        late = np.maximum(budget.absolute["lag"], is_woven * budget.absolute["interlace"]) > u_angle
        flag |= np.where(late, np.uint16(int(FrameFlag.TIME_FILTERED)), np.uint16(0))
    flag |= _width_flags(ready, predicted, u_angle)
    place = np.array([template.centre_px for template in ready.templates]) + table.pose[..., 1:]
    covariance = rotate_covariance(table.covariance, table.pose[..., 0])
    if ready.rectified_film is not None:
        place = ready.rectified_film.to_film(place)
        per_film_px = np.array([1.0, *ready.rectified_film.stretch])
        covariance = covariance / (per_film_px[:, None] * per_film_px)
    return TrackResult(
        bodies=tuple(body.name for body in bodies),
        parents=tuple(body.parent for body in bodies),
        frame=table.frame,
        time_s=tracked.time_s,
        angle_rad=tracked.angle_rad,
        u_angle_rad=u_angle,
        u_common_rad=u_common,
        x_px=place[..., 0],
        y_px=place[..., 1],
        zncc=table.zncc,
        inlier=table.inlier,
        noise_grey=table.noise_grey,
        flag=flag,
        predicted_u_rad=predicted,
        covariance=covariance,
        budget=budget,
        n_still=reference.n_averaged,
        film=str(film.path),
        info=info,
    )
