"""Terms of the error budget, before tracking (`expected_budget`) and after it (`compute_budget`).

Tilt and distortion bend both bodies of a relative angle alike, so there their differences count; all other
terms of the two bodies are independent.

Shutter: a speed step D within the exposure T_e, anywhere between two rows T apart, shifts the mean by a root mean
square of ``D T_e sqrt(T_e / (320 T))``; steady acceleration shifts it by less. D is taken from the second
difference of the angles, less what noise alone gives.

Rows: of a rolling shutter, what the fit makes of rows that are later the further down they lie, to first order
(`PoseResponse.read_late`). Two bodies of a relative angle share the delay of the rows they both lie in.

Compression: a cosine coefficient of a JPEG block that is large against its quantisation step is off by step / sqrt(12);
one that is rounded to zero is off by its own size. Weighted with the body's own sensitivity, block by block, this gives
the standard deviation of the turn (ITU-T T.81, annex A.3 for the transform). Films that predict a frame from its
neighbours follow no such rule: there the noise term is multiplied by what was measured with H.264 and MPEG-4.

The pose in a distorted or tilted picture: the fit gives the pose that is nearest to the true displacement of the pixels
in the sense of its own normal equations, ``delta = N^-1 sum J (grad I . d)``, with the displacement d that no rigid
motion in the picture explains. d is smooth, so the sums over pixels are made once per cell of `CELL_PX` and serve all
frames. First order in d: a camera tilted by 5 degrees is represented to 1 % of its effect (tested with films).

Poses are as in `vision.fitting.base`, shape (n, 3).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.camera.model import EXPECTED_TURN_RAD, CameraModel, Projection, project_posed_points, transform_points
from vision.film.source import Compression, FrameSource
from vision.fitting.pose_covariance import predicted_u_angle
from vision.fitting.template import TILE_PX, Template
from vision.item_map import ItemMap, serial_map
from vision.reference.prepared_film import PreparedFilm
from vision.uncertainty.budget import ErrorBudget, rms, shutter_text

CELL_PX = 12  # error of the sums: at most 1 % of a tilt's effect, as with 8 px
CORRECTION_ROUNDS = 3  # of inverting a view: choice
ROWS_AT_ONCE = 256  # poses worked on together: bounds the memory on a long film and stays in the processor's cache
Both = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Along x and along y."""


class PoseResponse:
    """How the pose of one body follows small displacements of its pixels."""

    def __init__(self, template: Template) -> None:
        self.template = template
        offset = template.offset_px.astype(float)
        cell = np.floor_divide(offset - offset.min(axis=1, keepdims=True), CELL_PX).astype(int)
        number = cell[1] * (cell[0].max() + 1) + cell[0]
        _, place, count = np.unique(number, return_inverse=True, return_counts=True)
        self._at = np.stack([np.bincount(place, offset[k]) / count for k in range(2)], axis=-1)
        columns = np.vstack([template.columns.astype(float), np.ones(template.n_pixels)])
        influence = np.linalg.solve(template.normal, columns)[:3]
        # one (cells, 3) per axis: pose per displacement of a cell along x and along y
        self._gain_x, self._gain_y = (
            np.stack([np.bincount(place, influence[k] * columns[1 + axis]) for k in range(3)], axis=-1)
            for axis in range(2)
        )

    def error(self, camera: Projection, pose: NDArray[np.float64]) -> NDArray[np.float64]:
        """Tracked pose less the pose a perfect camera would give, shape (n, 3), in the body's own axes for the shift.

        ``pose`` is the motion seen by the perfect camera (to first order the tracked one); NaN stays NaN.
        """
        apart = _distortion_displacement(self.template, camera, self._at)
        return self._pose_change(pose, lambda part, c, s: apart(pose[part], c, s))

    def rolling_shutter_error(
        self, pose: NDArray[np.float64], speed: NDArray[np.float64], rows_per_s: float
    ) -> NDArray[np.float64]:
        """Tracked pose less that at the time of the picture's first row, (n, 3), of frames that are read row by row;
        ``speed`` (n, 3) is that of ``pose``, rad/s and px/s.

        A row is as late as its number over ``rows_per_s``, and
        what it shows has moved on by then.
        """

        def displace(part: slice, c: NDArray[np.float64], s: NDArray[np.float64]) -> Both:
            rate, (x, y) = speed[part, :, None], transform_points(self._at, c, s, np.zeros((len(c), 2)))
            late = (y + self.template.centre_px[1] + pose[part, 2:]) / rows_per_s
            return late * (rate[:, 1] - rate[:, 0] * y), late * (rate[:, 2] + rate[:, 0] * x)

        return self._pose_change(pose, displace)

    def _pose_change(
        self,
        pose: NDArray[np.float64],
        displace: Callable[[slice, NDArray[np.float64], NDArray[np.float64]], Both],
    ) -> NDArray[np.float64]:
        """Change of poses (n, 3), in the body's own axes for the shift, by displacements (k, cells) along x and y that
        ``displace`` gives of a slice of k poses, the cosines and sines (k,) of their turns."""
        result = np.empty((len(pose), 3))
        for start in range(0, len(pose), ROWS_AT_ONCE):
            part = slice(start, start + ROWS_AT_ONCE)
            c, s = np.cos(pose[part, 0]), np.sin(pose[part, 0])
            x, y = displace(part, c, s)
            # summed along the picture's axes first, then turned into the template's: c and s leave the sum
            along, across = x @ self._gain_x + y @ self._gain_y, y @ self._gain_x - x @ self._gain_y
            result[part] = c[:, None] * along + s[:, None] * across
        return result

    def correct_turn(self, camera: Projection, pose: NDArray[np.float64]) -> NDArray[np.float64]:
        """Turn, rad, shape (n,), that a perfect camera would give for tracked poses."""
        turn = pose[:, 0].copy()
        for _ in range(CORRECTION_ROUNDS):
            turn = pose[:, 0] - self.error(camera, np.column_stack([turn, pose[:, 1:]]))[:, 0]
        return turn


def displacement(
    template: Template, camera: Projection, pose: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """How far each template pixel is off a rigid motion at a pose (3,), px along the template's x and y, each (n,)."""
    c, s = np.cos(pose[:1]), np.sin(pose[:1])
    x, y = (
        one[0]
        for one in _distortion_displacement(template, camera, template.offset_px.T.astype(float))(pose[None], c, s)
    )
    return c * x + s * y, c * y - s * x


def _distortion_displacement(
    template: Template, camera: Projection, offset: NDArray[np.float64]
) -> Callable[[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]], Both]:
    """Function of poses (k, 3), cosines and sines (k,) of their turns that gives how far places ``offset`` (cells, 2)
    of a body are off a rigid motion in the camera's picture, px, (k, cells) along x and y."""
    centre = np.array(template.centre_px)
    flat, flat_centre = camera.to_plane(centre + offset), camera.to_plane(centre)

    def displace(pose: NDArray[np.float64], c: NDArray[np.float64], s: NDArray[np.float64]) -> Both:
        moved = centre + pose[:, 1:]
        x, y = project_posed_points(camera, flat - flat_centre, c, s, camera.to_plane(moved))
        for seen, rigid in zip((x, y), transform_points(offset, c, s, moved - camera.centre_px), strict=True):
            seen -= rigid
        return x, y

    return displace


INTERFRAME_FACTOR = 6.0
"""Error over the noise term with H.264: 3.8 at crf 10, 4.7 at crf 18, 8 at crf 23, textured jack on grey film."""
MIDDLE_GREY = np.float32(128.0)  # that JPEG takes off
UNDECLARED_FACTOR = 8.0
"""The same where the film does not say how it was compressed: MPEG-4 of unknown quality gave 4 to 10."""


def compression_u_turn(
    template: Template, picture: NDArray[Any], compression: Compression | None, u_noise_rad: float
) -> float:
    """Standard uncertainty of a body's turn from the compression, rad: of the reference ``picture``, which is rounded;
    of interframe codecs, a multiple of that from noise; 0 without compression."""
    if compression is None:
        return 0.0
    if compression.steps is None:
        return INTERFRAME_FACTOR * u_noise_rad
    columns = np.vstack([template.columns.astype(float), np.ones(template.n_pixels)])
    influence = np.linalg.solve(template.normal, columns)[0]
    height, width = picture.shape
    cols, rows = np.rint(template.offset_px + np.array(template.centre_px)[:, None]).astype(int)
    weight = np.zeros((height, width), dtype=np.float32)
    weight[rows, cols] = influence
    variance = 0.0
    for top in range(rows.min() // 8 * 8, min(rows.max() + 1, height - 7), 8):
        for left in range(cols.min() // 8 * 8, min(cols.max() + 1, width - 7), 8):
            block = weight[top : top + 8, left : left + 8]
            if not block.any():
                continue
            content = cv2.dct(picture[top : top + 8, left : left + 8].astype(np.float32) - MIDDLE_GREY)
            error = np.minimum(compression.steps**2 / 12.0, content.astype(float) ** 2)
            variance += float(np.sum(cv2.dct(block).astype(float) ** 2 * error))
    # frame and reference are both rounded; averaging helps the reference only where noise dithers it
    return float(np.sqrt(2.0 * variance))


@dataclass(frozen=True)
class ExpectedMotion:
    """Motion for which the terms are stated before a film is tracked."""

    turn_rad: float = EXPECTED_TURN_RAD
    speed_rad_per_s: float = 10.0  # above the 8 of a forte's whippen
    acceleration_rad_per_s2: float = 2000.0  # choice: that speed in 5 ms


@dataclass(frozen=True)
class TrackedAngles:
    """What the budget needs of a tracked film."""

    time_s: NDArray[np.float64]
    """(n,)."""
    pose: NDArray[np.float64]
    """(n, m, 3): tracked poses, turn counted from the zero and corrected for the camera."""
    angle_rad: NDArray[np.float64]
    u_noise_rad: NDArray[np.float64]
    """(n, m): angle, and its standard uncertainty from the frame's noise."""
    u_common_rad: NDArray[np.float64]
    """(m,): standard uncertainty of the zero."""
    frame_s: float = 0.0
    """Time from frame to frame of the film."""
    u_stretch: float = 0.0
    """Standard uncertainty of the picture's stretch, see `vision.tracking.picture_stretch`."""


def expected_budget(
    ready: PreparedFilm,
    camera: CameraModel,
    u_time_s: float = 0.0,
    motion: ExpectedMotion | None = None,
    rows_per_s: float | None = None,
    u_stretch: float = 0.0,
) -> ErrorBudget:
    """Budget of two frames, before the film is tracked, in which every body has turned about its centre by
    ``motion.turn_rad`` to either side; ``u_time_s``: of the frame times; ``u_stretch``: of the picture's stretch;
    ``rows_per_s``: as for `track`.

    All bodies turn by ``motion.turn_rad`` from the ground; the shutter and synchronisation terms are those at its
    speed and acceleration.
    """
    motion = motion or ExpectedMotion()
    m = len(ready.bodies)
    u = np.array([predicted_u_angle(t, ready.reference.noise_grey) for t in ready.templates])
    n_still, frame_s = ready.reference.n_averaged, 1.0 / (ready.film.frame_rate_hz or math.inf)
    common = u / math.sqrt(n_still + 1.0)
    pose = np.zeros((2, m, 3))
    pose[:, :, 0] = np.array([-motion.turn_rad, motion.turn_rad])[:, None]
    single = {
        "noise": np.sqrt(np.maximum(u**2 - common**2, 0.0)),
        "reference": common,
        "codec": _compression_term(ready, u),
        "synchronisation": np.full(m, u_time_s * motion.speed_rad_per_s),
        "shutter": np.full(m, motion.acceleration_rad_per_s2 * _shutter_factor(ready.film, frame_s)),
        "lag": np.full(m, motion.speed_rad_per_s * ready.delay_frames * frame_s),
        "interlace": np.hypot(_row_interpolation(ready), motion.speed_rad_per_s * ready.u_field_frames * frame_s),
    }
    own = {name: np.tile(values, (2, 1)) for name, values in single.items()}
    speed = np.zeros_like(pose)
    speed[..., 0] = motion.speed_rad_per_s
    return _assemble_budget(ready, camera, (pose, speed), (own, {}), rows_per_s, u_stretch=u_stretch)


def compute_budget(
    ready: PreparedFilm,
    camera: CameraModel,
    tracked: TrackedAngles,
    u_time_s: float,
    rows_per_s: float | None = None,
    map_items: ItemMap = serial_map,
) -> ErrorBudget:
    """Budget of every tracked frame; ``u_time_s``: standard uncertainty of the frame times; ``rows_per_s``: rows that a
    rolling shutter reads per second, infinity for a global one, None where not declared: no term for both."""
    angle_rad, u_noise_rad = tracked.angle_rad, tracked.u_noise_rad
    typical = np.array([rms(u_noise_rad[:, i]) for i in range(u_noise_rad.shape[1])])
    own = {
        "noise": u_noise_rad,
        "reference": np.where(np.isfinite(u_noise_rad), tracked.u_common_rad, np.nan),
        "codec": np.where(np.isfinite(u_noise_rad), _compression_term(ready, typical), np.nan),
    }
    against: dict[str, NDArray[np.float64]] = {}
    # one frame out of many may be tracked; zero where a neighbour is lost, as in the terms below
    apart_s, speed = np.zeros((1, 1)), np.zeros_like(tracked.pose)
    if len(tracked.time_s) > 1:
        apart_s = np.gradient(tracked.time_s)[:, None]
        speed = np.nan_to_num(np.gradient(tracked.pose, tracked.time_s, axis=0))
    relative_rad, u_relative_rad = (
        _combine_with_parent(angle_rad, ready.parents, np.subtract),
        _combine_with_parent(u_noise_rad, ready.parents),
    )
    for terms, angle, u in ((own, angle_rad, u_noise_rad), (against, relative_rad, u_relative_rad)):
        turning, acceleration = _speed_and_acceleration(tracked.time_s, angle, u)
        terms["synchronisation"] = u_time_s * turning
        terms["lag"] = _newest_speed(turning, tracked, ready.delay_frames) * ready.delay_frames * tracked.frame_s
        terms["interlace"] = turning * ready.u_field_frames * tracked.frame_s
        terms["shutter"] = acceleration * _shutter_factor(ready.film, apart_s)
    rows = _row_interpolation(ready)
    if rows.any():
        own["interlace"] = np.hypot(own["interlace"], rows)
        against["interlace"] = np.hypot(against["interlace"], _combine_with_parent(rows[None], ready.parents))
    return _assemble_budget(
        ready, camera, (tracked.pose, speed), (own, against), rows_per_s, map_items, tracked.u_stretch
    )


def _assemble_budget(
    ready: PreparedFilm,
    camera: CameraModel,
    motion: tuple[NDArray[np.float64], NDArray[np.float64]],
    terms: tuple[dict[str, NDArray[np.float64]], dict[str, NDArray[np.float64]]],
    rows_per_s: float | None,
    map_items: ItemMap = serial_map,
    u_stretch: float = 0.0,
) -> ErrorBudget:
    """Budget of poses (n, m, 3) and speeds, ``motion``: terms of camera, stretch and rows, beside each body's own
    ``terms``, by name (n, m): independent ones, and those of a body against its parent."""
    (pose, speed), (own, against) = motion, terms
    absolute, relative = _camera_terms(ready, camera, pose, map_items)
    absolute["aspect"], relative["aspect"] = _stretch_terms(ready, pose, u_stretch)
    absolute |= own
    relative |= {name: _combine_with_parent(values, ready.parents) for name, values in own.items()} | against
    absolute["rows"], relative["rows"] = _row_terms(ready, pose, speed, rows_per_s)
    names = tuple(b.name for b in ready.bodies)
    return ErrorBudget(names, absolute, relative, camera.description(), shutter_text(rows_per_s))


def _stretch_terms(
    ready: PreparedFilm, pose: NDArray[np.float64], u_stretch: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Term of a picture stretched by ``1 + u_stretch`` along x and ``1 - u_stretch`` along y, absolute and relative to
    the parent, (n, m), rad."""
    off = np.where(np.isfinite(pose[..., 0]), 0.0, np.nan)
    if u_stretch > 0.0:
        stretched = Projection(ready.film.width, ready.film.height, np.diag([1.0 + u_stretch, 1.0 - u_stretch, 1.0]))
        off = np.column_stack(
            [PoseResponse(one).error(stretched, pose[:, i])[:, 0] for i, one in enumerate(ready.templates)]
        )
    return np.abs(off), np.abs(_combine_with_parent(off, ready.parents, np.subtract))


def _row_interpolation(ready: PreparedFilm) -> NDArray[np.float64]:
    """Standard uncertainty of each body's turn, rad, (m,), from the rows of the reference that are interpolated between
    those of a field; zeros where whole frames are tracked.

    At rest both fields show the same, so that their difference is that of the interpolation, and noise. Once a body has
    moved, its frames are interpolated otherwise than the reference; their part is seen in the residuals and widens the
    noise term.
    """
    film = ready.rectified_film
    found = np.zeros(len(ready.templates))
    if film is None or film.field is None:
        return found
    n = ready.reference.n_averaged
    off = np.mean([film.field_difference(k) for k in range(n)], axis=0)
    for i, template in enumerate(ready.templates):
        columns = np.vstack([template.columns.astype(float), np.ones(template.n_pixels)])
        influence = np.linalg.solve(template.normal, columns)[0]
        x, y = np.rint(template.offset_px + np.array(template.centre_px)[:, None]).astype(int)
        # an interpolation error keeps together over some grains of a texture
        block = (y // TILE_PX) * (film.width // TILE_PX + 1) + x // TILE_PX
        part = np.bincount(block, influence * off[y, x])
        found[i] = math.sqrt(float(np.sum(part**2)))
    return found


def _newest_speed(speed: NDArray[np.float64], tracked: TrackedAngles, delay_frames: float) -> NDArray[np.float64]:
    """Largest speed (n, m) among each row and those before it that a filter of a delay of ``delay_frames`` still holds;
    NaN where that of the row is."""
    if not delay_frames or len(speed) < 2:
        return speed
    row_s = float(np.median(np.diff(tracked.time_s)))
    held = math.ceil(3.0 * delay_frames * tracked.frame_s / row_s)
    known = np.nan_to_num(speed)
    most = np.max([np.vstack([known[:1]] * k + [known[: len(known) - k]]) for k in range(min(held + 1, len(known)))], 0)
    return np.where(np.isfinite(speed), most, np.nan)


def _row_terms(
    ready: PreparedFilm, pose: NDArray[np.float64], speed: NDArray[np.float64], rows_per_s: float | None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Term of a rolling shutter, absolute and relative to the parent, (n, m), rad; noise of the speed adds less than
    the noise term."""
    off = np.where(np.isfinite(pose[..., 0]), 0.0, np.nan)
    if rows_per_s is not None and math.isfinite(rows_per_s):
        for i, template in enumerate(ready.templates):
            off[:, i] = PoseResponse(template).rolling_shutter_error(pose[:, i], speed[:, i], rows_per_s)[:, 0]
    return np.abs(off), np.abs(_combine_with_parent(off, ready.parents, np.subtract))


def _shutter_factor(film: FrameSource, apart_s: Any) -> Any:
    """Standard uncertainty per acceleration, s^2, of rows so far apart: ``T T_e sqrt(T_e / (320 T))``."""
    exposure_s = np.minimum(film.exposure_s or 0.0, apart_s)
    return exposure_s * np.sqrt(exposure_s * apart_s / 320.0)  # as above


def _speed_and_acceleration(
    time_s: NDArray[np.float64], angle: NDArray[np.float64], u: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Absolute speed, rad/s, and acceleration, rad/s^2, (n, m), from neighbouring rows, less what noise ``u`` alone
    gives; 0 where a neighbour is lost, NaN where the row itself is."""
    n = time_s.size
    speed, acceleration = np.zeros_like(angle), np.zeros_like(angle)
    if n >= 3:
        before, after = np.diff(time_s)[:-1, None], np.diff(time_s)[1:, None]
        first, second = np.diff(angle, axis=0)[:-1] / before, np.diff(angle, axis=0)[1:] / after
        mean2 = (0.5 * (first + second)) ** 2 - 0.5 * (u[1:-1] / before) ** 2
        # 6: sum of squares of a second difference's weights
        bend2 = ((second - first) / (0.5 * (before + after))) ** 2 - 6.0 * (u[1:-1] / (before * after)) ** 2
        speed[1:-1] = np.sqrt(np.maximum(np.nan_to_num(mean2), 0.0))
        acceleration[1:-1] = np.sqrt(np.maximum(np.nan_to_num(bend2), 0.0))
        speed[[0, -1]], acceleration[[0, -1]] = speed[[1, -2]], acceleration[[1, -2]]
    lost = ~np.isfinite(angle)
    speed[lost], acceleration[lost] = np.nan, np.nan
    return speed, acceleration


def _camera_terms(
    ready: PreparedFilm, camera: CameraModel, pose: NDArray[np.float64], map_items: ItemMap = serial_map
) -> tuple[dict[str, NDArray[np.float64]], dict[str, NDArray[np.float64]]]:
    """Terms tilt and distortion, by name (n, m), rad, of the absolute angles and of those relative to the parent."""
    width, height = ready.film.width, ready.film.height
    n, m = pose.shape[:2]
    responses = map_items(PoseResponse, ready.templates)

    def corrected_turn(projection: Projection) -> NDArray[np.float64]:
        return np.column_stack([r.error(projection, pose[:, i])[:, 0] for i, r in enumerate(responses)])

    nominal, variants = camera.nominal(width, height), list(camera.variants(width, height))
    base = np.zeros((n, m)) if nominal is None else corrected_turn(nominal)
    absolute = {name: np.zeros((n, m)) for name in ("tilt", "distortion")}
    relative = {name: _combine_with_parent(values, ready.parents) for name, values in absolute.items()}
    for variant, found in zip(
        variants, map_items(corrected_turn, [variant.projection for variant in variants]), strict=True
    ):
        off = found - base
        absolute[variant.term] += variant.weight * off**2
        relative[variant.term] += variant.weight * _combine_with_parent(off, ready.parents, np.subtract) ** 2
    return (
        {name: np.sqrt(values) for name, values in absolute.items()},
        {name: np.sqrt(values) for name, values in relative.items()},
    )


def _compression_term(ready: PreparedFilm, u_noise: NDArray[np.float64]) -> NDArray[np.float64]:
    """Standard uncertainty (m,) of each body's angle from the film's compression, rad; ``u_noise`` (m,), rad."""
    compression = ready.film.compression
    return np.array(
        [
            compression_u_turn(template, ready.reference.picture, compression, float(u))
            for template, u in zip(ready.templates, u_noise, strict=True)
        ]
    )


def _combine_with_parent(
    values: NDArray[np.float64], parents: Sequence[int | None], join: Callable[..., Any] = np.hypot
) -> NDArray[np.float64]:
    """Values (n, m) of bodies joined with those of their parents, (n, m): independent parts add in squares; NaN without
    a parent."""
    joined = np.full_like(values, np.nan)
    for i, parent in enumerate(parents):
        if parent is not None:
            joined[:, i] = join(values[:, i], values[:, parent])
    return joined
