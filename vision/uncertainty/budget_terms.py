"""How the terms of the error budget are found, before tracking (`expected_budget`) and after (`budget_of`).

Tilt and distortion bend both bodies of a relative angle alike, so there their differences count; all other
terms of the two bodies are independent.

Shutter: a speed step D within the exposure T_e, anywhere within a frame T, shifts the mean by a root mean
square of ``D T_e sqrt(T_e / (320 T))``; steady acceleration shifts it by less. D is taken from the second
difference of the angles, less what noise alone gives.

Rows: of a rolling shutter, what the fit makes of rows that are later the further down they lie, to first order
(`PoseResponse.read_late`). Two bodies of a relative angle share the delay of the rows they both lie in.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vision.camera.model import CameraModel
from vision.camera.projection import Projection
from vision.each import Each, in_turn
from vision.film.source import FrameSource
from vision.fitting.pose_covariance import predicted_u_angle
from vision.reference.prepared_film import PreparedFilm
from vision.uncertainty.budget import ErrorBudget, rms, shutter_text
from vision.uncertainty.compression_noise import compression_u_turn
from vision.uncertainty.pose_response import PoseResponse


@dataclass(frozen=True)
class ExpectedMotion:
    """Motion for which the terms are stated before a film is tracked."""

    turn_rad: float = math.radians(15.0)
    speed_rad_per_s: float = 10.0
    acceleration_rad_per_s2: float = 2000.0


@dataclass(frozen=True)
class TrackedAngles:
    """What the budget needs of a tracked film.

    Attributes
    ----------
    time_s : ndarray, shape (n,)
    pose : ndarray, shape (n, m, 3)
        Tracked poses, turn counted from the zero and corrected for the camera.
    angle_rad, u_noise_rad : ndarray, shape (n, m)
        Angle, and its standard uncertainty from the frame's noise.
    u_common_rad : ndarray, shape (m,)
        Standard uncertainty of the zero.
    """

    time_s: NDArray[np.float64]
    pose: NDArray[np.float64]
    angle_rad: NDArray[np.float64]
    u_noise_rad: NDArray[np.float64]
    u_common_rad: NDArray[np.float64]


def expected_budget(
    ready: PreparedFilm,
    camera: CameraModel,
    u_time_s: float = 0.0,
    motion: ExpectedMotion | None = None,
    rows_per_s: float | None = None,
) -> ErrorBudget:
    """Budget of one frame in which every body has turned about its centre, before the film is tracked.

    All bodies turn by ``motion.turn_rad`` from the ground; the shutter and synchronisation terms are those at its
    speed and acceleration.
    """
    motion = motion or ExpectedMotion()
    m = len(ready.bodies)
    u = np.array([predicted_u_angle(t, ready.reference.noise_grey) for t in ready.templates])
    n_still = ready.reference.n_averaged
    common = u / math.sqrt(n_still + 1.0)
    pose = np.zeros((2, m, 3))
    pose[:, :, 0] = np.array([-motion.turn_rad, motion.turn_rad])[:, None]
    absolute, relative = _camera_terms(ready, camera, pose)
    single = {
        "noise": np.sqrt(np.maximum(u**2 - common**2, 0.0)),
        "reference": common,
        "codec": _codec(ready, u),
        "synchronisation": np.full(m, u_time_s * motion.speed_rad_per_s),
        "shutter": np.full(m, motion.acceleration_rad_per_s2 * _shutter_factor(ready.film)),
    }
    for name, values in single.items():
        absolute[name] = np.tile(values, (2, 1))
        relative[name] = _joined(absolute[name], ready.parents)
    speed = np.zeros_like(pose)
    speed[..., 0] = motion.speed_rad_per_s
    absolute["rows"], relative["rows"] = _row_terms(ready, pose, speed, rows_per_s)
    names = tuple(b.name for b in ready.bodies)
    return ErrorBudget(names, absolute, relative, camera.description(), shutter_text(rows_per_s))


def budget_of(
    ready: PreparedFilm,
    camera: CameraModel,
    tracked: TrackedAngles,
    u_time_s: float,
    rows_per_s: float | None = None,
    each: Each = in_turn,
) -> ErrorBudget:
    """Budget of every tracked frame; ``u_time_s`` is the standard uncertainty of the frame times."""
    parents = ready.parents
    angle_rad, u_noise_rad = tracked.angle_rad, tracked.u_noise_rad
    absolute, relative = _camera_terms(ready, camera, tracked.pose, each)
    absolute["noise"] = u_noise_rad
    absolute["reference"] = np.where(np.isfinite(u_noise_rad), tracked.u_common_rad, np.nan)
    typical = np.array([rms(u_noise_rad[:, i]) for i in range(u_noise_rad.shape[1])])
    absolute["codec"] = np.where(np.isfinite(u_noise_rad), _codec(ready, typical), np.nan)
    for name in ("noise", "reference", "codec"):
        relative[name] = _joined(absolute[name], parents)
    against = np.full_like(angle_rad, np.nan)
    u_against = np.full_like(angle_rad, np.nan)
    for i, parent in enumerate(parents):
        if parent is not None:
            against[:, i] = angle_rad[:, i] - angle_rad[:, parent]
            u_against[:, i] = np.hypot(u_noise_rad[:, i], u_noise_rad[:, parent])
    for terms, angle, u in ((absolute, angle_rad, u_noise_rad), (relative, against, u_against)):
        speed, acceleration = _speed_and_acceleration(tracked.time_s, angle, u)
        terms["synchronisation"] = u_time_s * speed
        terms["shutter"] = acceleration * _shutter_factor(ready.film)
    speed = np.zeros_like(tracked.pose)
    if len(tracked.time_s) > 1:
        # zero where a neighbour is lost, as in the terms above
        speed = np.nan_to_num(np.gradient(tracked.pose, tracked.time_s, axis=0))
    absolute["rows"], relative["rows"] = _row_terms(ready, tracked.pose, speed, rows_per_s)
    names = tuple(b.name for b in ready.bodies)
    return ErrorBudget(names, absolute, relative, camera.description(), shutter_text(rows_per_s))


def _row_terms(
    ready: PreparedFilm, pose: NDArray[np.float64], speed: NDArray[np.float64], rows_per_s: float | None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Term of a rolling shutter, absolute and relative, (n, m); noise of the speed adds less than the noise term."""
    off = np.where(np.isfinite(pose[..., 0]), 0.0, np.nan)
    if rows_per_s is not None and math.isfinite(rows_per_s):
        for i, template in enumerate(ready.templates):
            off[:, i] = PoseResponse(template).read_late(pose[:, i], speed[:, i], rows_per_s)[:, 0]
    against = np.full_like(off, np.nan)
    for i, parent in enumerate(ready.parents):
        if parent is not None:
            against[:, i] = off[:, i] - off[:, parent]
    return np.abs(off), np.abs(against)


def _shutter_factor(film: FrameSource) -> float:
    """Standard uncertainty per acceleration, s^2: ``T T_e sqrt(T_e / (320 T))``."""
    if not film.exposure_s or not film.frame_rate_hz:
        return 0.0
    frame_s, exposure_s = 1.0 / film.frame_rate_hz, min(film.exposure_s, 1.0 / film.frame_rate_hz)
    return frame_s * exposure_s * math.sqrt(exposure_s / (320.0 * frame_s))


def _speed_and_acceleration(
    time_s: NDArray[np.float64], angle: NDArray[np.float64], u: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Absolute values, shape (n, m), from neighbouring rows, less what noise alone gives; 0 where a neighbour is
    lost, NaN where the row itself is."""
    n = time_s.size
    speed, acceleration = np.zeros_like(angle), np.zeros_like(angle)
    if n >= 3:
        before, after = np.diff(time_s)[:-1, None], np.diff(time_s)[1:, None]
        first, second = np.diff(angle, axis=0)[:-1] / before, np.diff(angle, axis=0)[1:] / after
        mean2 = (0.5 * (first + second)) ** 2 - 0.5 * (u[1:-1] / before) ** 2
        bend2 = ((second - first) / (0.5 * (before + after))) ** 2 - 6.0 * (u[1:-1] / (before * after)) ** 2
        speed[1:-1] = np.sqrt(np.maximum(np.nan_to_num(mean2), 0.0))
        acceleration[1:-1] = np.sqrt(np.maximum(np.nan_to_num(bend2), 0.0))
        speed[[0, -1]], acceleration[[0, -1]] = speed[[1, -2]], acceleration[[1, -2]]
    lost = ~np.isfinite(angle)
    speed[lost], acceleration[lost] = np.nan, np.nan
    return speed, acceleration


def _camera_terms(
    ready: PreparedFilm, camera: CameraModel, pose: NDArray[np.float64], each: Each = in_turn
) -> tuple[dict[str, NDArray[np.float64]], dict[str, NDArray[np.float64]]]:
    """Tilt and distortion of absolute and relative angles."""
    width, height = ready.film.width, ready.film.height
    n, m = pose.shape[:2]
    parents = ready.parents
    responses = each(PoseResponse, ready.templates)

    def turned(projection: Projection) -> NDArray[np.float64]:
        return np.column_stack([r.error(projection, pose[:, i])[:, 0] for i, r in enumerate(responses)])

    nominal, variants = camera.nominal(width, height), list(camera.variants(width, height))
    base = np.zeros((n, m)) if nominal is None else turned(nominal)
    absolute = {name: np.zeros((n, m)) for name in ("tilt", "distortion")}
    relative = {name: np.full((n, m), np.nan) for name in ("tilt", "distortion")}
    for i, parent in enumerate(parents):
        if parent is not None:
            for name in relative:
                relative[name][:, i] = 0.0
    for variant, found in zip(variants, each(turned, [variant.projection for variant in variants]), strict=True):
        off = found - base
        absolute[variant.term] += variant.weight * off**2
        for i, parent in enumerate(parents):
            if parent is not None:
                relative[variant.term][:, i] += variant.weight * (off[:, i] - off[:, parent]) ** 2
    return (
        {name: np.sqrt(values) for name, values in absolute.items()},
        {name: np.sqrt(values) for name, values in relative.items()},
    )


def _codec(ready: PreparedFilm, u_noise: NDArray[np.float64]) -> NDArray[np.float64]:
    compression = ready.film.compression
    return np.array(
        [
            compression_u_turn(template, ready.reference.picture, compression, float(u))
            for template, u in zip(ready.templates, u_noise, strict=True)
        ]
    )


def _joined(values: NDArray[np.float64], parents: Sequence[int | None]) -> NDArray[np.float64]:
    """Independent parts of child and parent, added in squares; NaN without a parent."""
    joined = np.full_like(values, np.nan)
    for i, parent in enumerate(parents):
        if parent is not None:
            joined[:, i] = np.hypot(values[:, i], values[:, parent])
    return joined
