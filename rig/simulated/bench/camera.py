"""The virtual bench's high-speed camera: films whippen, jack and repetition lever into a Photron MRAW file.

It takes the true angles of the action as a function of time, and the frame times; the film goes to disk frame by frame,
in the format of a real one. The tracker gets the outlines of `film_bodies`. Geometry is in metres, x right, y up,
angles counter-clockwise in rad (whippen from ground, jack and repetition lever from the whippen). The picture is fixed
to the ground; the place of its corner is in the ground frame. The jack lies in front of the repetition lever, both in
front of the whippen. Pivots and rest angles are those of Hirschkorn 2004, as the thesis uses them; the outlines are
drawn for this bench.

`frame_time_s` is the middle of each exposure. Flicker is a sinusoidal ripple of the light, averaged over the exposure.
No half-written file is left behind by an error.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cache
from statistics import NormalDist
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rig.arrays import as_numbers
from rig.errors import refuse
from vision.angles import ccw_to_picture, ground_to_picture
from vision.bodies.masks import build_masks
from vision.bodies.outlines import Body
from vision.errors import InputError
from vision.film.mraw import write_mraw
from vision.fitting.pose_covariance import cramer_rao_bound
from vision.synthetic import (
    Projection,
    Scene,
    Sensor,
    SyntheticBody,
    background,
    speckle,
    thick_line,
    total_noise,
    turned,
    wood_grain,
)

NAMES = ("whippen", "jack", "repetition")


@dataclass(frozen=True)
class ActionGeometry:
    """Pivots and rest angles of the filmed bodies.

    Attributes
    ----------
    whippen_pivot_m : (float, float)
        In the ground frame.
    jack_pivot_m, repetition_pivot_m : (float, float)
        In the whippen's frame, whose origin is its own pivot.
    rest_angle_rad : (float, float, float)
        Whippen from ground, jack and repetition lever from the whippen, when the outlines are drawn.
    """

    whippen_pivot_m: tuple[float, float] = (-0.1810, 0.0528)  # choice: these four, near the thesis's action
    jack_pivot_m: tuple[float, float] = (0.0989, -0.0035)  # as above
    repetition_pivot_m: tuple[float, float] = (0.0483, 0.0275)  # as above
    rest_angle_rad: tuple[float, float, float] = (0.0251, 0.3198, 0.3523)  # as above


@dataclass(frozen=True)
class CameraSettings:
    """Settings of the camera, and how the bodies look.

    Attributes
    ----------
    frame_rate_hz, exposure_s : float
    width, height : int
        Pixels.
    scale_px_per_m : float
    left_m, top_m : float
        Place of the picture's left and top edge in the ground frame.
    texture : {"wood", "speckle"}
    noise_grey : float
        Standard deviation per pixel, grey of 8 bit, before rounding.
    flicker : float
        Amplitude of the light's ripple as a fraction of its mean.
    flicker_hz : float
        Twice the mains frequency.
    bit_depth : {8, 12}
    lens : Projection or None
        A tilted camera or a distorting lens; None for a perfect one, square to the plane of motion.
    """

    frame_rate_hz: float = 2000.0  # choice: of a high-speed camera
    exposure_s: float = 125e-6  # a quarter of a frame: choice
    width: int = 400  # the moving parts at this scale
    height: int = 304  # as above
    scale_px_per_m: float = 3200.0  # choice: 0.31 mm a pixel
    left_m: float = -0.173  # so that the parts are in view
    top_m: float = 0.125  # as above
    texture: str = "wood"
    noise_grey: float = 2.0  # choice: of an 8-bit camera
    flicker: float = 0.05  # choice: of a discharge lamp
    flicker_hz: float = 120.0  # mains of 60 Hz, as in the thesis's laboratory
    bit_depth: int = 8
    lens: Projection | None = None

    def __post_init__(self) -> None:
        refuse(
            InputError,
            (
                self.texture not in ("wood", "speckle"),
                f"camera texture {self.texture!r} is not known; choose wood or speckle",
            ),
            (self.bit_depth not in (8, 12), f"camera bit_depth {self.bit_depth} is not known; choose 8 or 12"),
        )
        for name in ("frame_rate_hz", "exposure_s", "scale_px_per_m"):
            if not 0.0 < getattr(self, name) < 1e9:
                raise InputError(f"camera {name} = {getattr(self, name)}; needs a positive number")
        refuse(
            InputError,
            (
                self.exposure_s * self.frame_rate_hz > 1.0,
                f"camera exposure_s = {self.exposure_s:g} is longer than a frame, "
                f"{1.0 / self.frame_rate_hz:g} s; shorten it",
            ),
            (
                not (64 <= self.width <= 4096 and 64 <= self.height <= 4096),
                f"camera width x height = {self.width} x {self.height}; each side must be 64..4096 px",
            ),
            (
                not (0.0 <= self.noise_grey < 64.0 and 0.0 <= self.flicker < 1.0 and self.flicker_hz >= 0.0),
                f"camera noise_grey {self.noise_grey}, flicker {self.flicker}, flicker_hz {self.flicker_hz}; "
                "allowed are 0..64, 0..1 and 0 or more",
            ),
        )


GREY = (120.0, 135.0, 150.0)  # mean of each part, so that they can be told apart


def film_scene(settings: CameraSettings, seed: int) -> Scene:
    """Scene to be drawn: whippen, repetition lever and jack, from back to front, textured as ``settings`` say, before a
    background; ``seed`` draws the textures. Poses are given when it is drawn."""
    grain = {"whippen": 0.0, "jack": np.pi / 2.0, "repetition": -0.05}  # along the longest side of each part
    bodies = []
    for number, name in enumerate(_DRAW_ORDER):
        polygon = ground_to_picture(_OUTLINES_M[name], settings.scale_px_per_m, (0.0, 0.0))
        fibre = 6.0  # px: room for the widest
        low, high = (polygon.min(axis=0) - fibre).tolist(), (polygon.max(axis=0) + fibre).tolist()
        extent = (low[0], low[1], high[0], high[1])
        body_seed = 1000 * seed + number
        if settings.texture == "speckle":
            texture = speckle(extent, body_seed)
        else:
            texture = wood_grain(extent, body_seed, direction_rad=grain[name], mean_grey=GREY[number])  # distinct parts
        bodies.append(SyntheticBody(name, polygon, texture))
    return Scene(bodies, background(settings.height, settings.width, 1000 * seed + 99), settings.lens)


def film_bodies(geometry: ActionGeometry | None = None, settings: CameraSettings | None = None) -> list[Body]:
    """Outlines, px, of whippen, jack and repetition lever at the rest angles of ``geometry``, as a user would draw them
    on the first frame; the whippen is the parent of the other two.

    Parameters
    ----------
    geometry : ActionGeometry, optional
        Its ``rest_angle_rad`` places the bodies.
    settings : CameraSettings, optional

    Returns
    -------
    list of Body
        Whippen, jack and repetition, the last two with the whippen as parent.

    Examples
    --------
    >>> from rig.simulated import film_bodies
    >>> [body.parent for body in film_bodies()]
    [None, 'whippen', 'whippen']
    """
    geometry, settings = geometry or ActionGeometry(), settings or CameraSettings()
    rest = np.asarray(geometry.rest_angle_rad, dtype=float)[None, :]
    place = dict(zip(_DRAW_ORDER, poses(geometry, settings, rest)[0], strict=True))
    bodies = []
    for name in NAMES:
        polygon = ground_to_picture(_OUTLINES_M[name], settings.scale_px_per_m, (0.0, 0.0))
        angle, x, y = place[name]
        outline = turned(polygon, float(ccw_to_picture(angle)), (x, y))
        if settings.lens is not None:
            outline = settings.lens.to_picture(outline)
        bodies.append(Body(name, outline, None if name == "whippen" else "whippen", _DRAW_ORDER.index(name)))
    return bodies


def film_bounds(
    scene: Scene, geometry: ActionGeometry, settings: CameraSettings, noise_grey: float
) -> NDArray[np.float64]:
    """Cramer-Rao bound (3,), rad, on the standard deviation of the absolute angles of whippen, jack and repetition
    lever in one still frame at rest; ``noise_grey``: standard deviation of a pixel, grey of 8 bit."""
    rest = np.asarray(geometry.rest_angle_rad, dtype=float)[None, :]
    picture = scene.light(poses(geometry, settings, rest))
    masks = build_masks(film_bodies(geometry, settings), settings.height, settings.width)
    return np.array([cramer_rao_bound(picture, mask, noise_grey)[0] for mask in masks])


_DRAW_ORDER = ("whippen", "repetition", "jack")
"""Back to front."""
_OUTLINES_M: dict[str, NDArray[np.float64]] = {
    # beam with the post that carries the repetition lever
    "whippen": np.array(
        [
            [-0.006, -0.006], [0.104, -0.0085], [0.106, 0.0035], [0.0525, 0.0055], [0.0525, 0.026],
            [0.0440, 0.026], [0.0440, 0.0055], [-0.006, 0.006],
        ]
    ),
    # upright arm and toe, 10 mm and 9 mm wide
    "jack": np.array(
        [
            [-0.0060, -0.0065], [0.0060, -0.0070], [0.0245, -0.0095], [0.0255, -0.0005], [0.0065, 0.0035],
            [0.0055, 0.0300], [0.0040, 0.0495], [-0.0050, 0.0500], [-0.0060, 0.0250],
        ]
    ),
    "repetition": thick_line(
        [[-0.036, -0.009], [-0.010, -0.001], [0.030, 0.002], [0.056, 0.002]], [0.007, 0.009, 0.008, 0.007]
    ),
}  # fmt: skip


def poses(geometry: ActionGeometry, settings: CameraSettings, angle_rad: NDArray[np.float64]) -> NDArray[np.float64]:
    """Poses (k, 3, 3) of whippen, repetition lever, jack, in the order drawn: absolute angle, rad, x and y of the
    pivot, px, from angles (k, 3), rad: whippen from ground, jack from whippen, repetition lever from whippen."""
    whippen = angle_rad[:, 0]
    cosine, sine = np.cos(whippen), np.sin(whippen)
    pivot = np.asarray(geometry.whippen_pivot_m)
    origin = (-settings.left_m * settings.scale_px_per_m, settings.top_m * settings.scale_px_per_m)
    out = np.empty((len(angle_rad), 3, 3))
    places = {
        "whippen": ((0.0, 0.0), whippen),
        "jack": (geometry.jack_pivot_m, whippen + angle_rad[:, 1]),
        "repetition": (geometry.repetition_pivot_m, whippen + angle_rad[:, 2]),
    }
    for i, name in enumerate(_DRAW_ORDER):
        (x, y), angle = places[name]
        ground = pivot + np.column_stack([cosine * x - sine * y, sine * x + cosine * y])
        out[:, i, 0] = angle
        out[:, i, 1:] = ground_to_picture(ground, settings.scale_px_per_m, origin)
    return out


MAX_BLUR_STEP_PX = 0.15  # between two instants of an exposure: choice
MAX_INSTANTS = 24  # of an exposure: 3.6 px of blur; more is drawn coarser
MAX_STALE_PX = 1e-3  # that a body may have moved since it was drawn: 0.1 grey at its edge, 0.02 within
AHEAD = 4  # pictures drawn before the one that becomes a frame: choice, of memory


@dataclass(frozen=True)
class FilmTruth:
    """The true contents of a film.

    Attributes
    ----------
    frame_time_s : ndarray, shape (n,)
        Middle of each exposure.
    angle_rad : ndarray, shape (n, 3)
        Angles at that instant: whippen from ground, jack and repetition lever from the whippen.
    mean_angle_rad : ndarray, shape (n, 3)
        The same averaged over the exposure, which is what a blurred picture shows.
    bodies : tuple of str
    crlb_rad : ndarray, shape (3,)
        Cramer-Rao bound of each body's own (absolute) angle in one still frame.
    relative_crlb_rad : ndarray, shape (3,)
        The same for the angle from the whippen (the whippen's own for itself).
    noise_grey : float
        Standard deviation of the stored grey values with rounding, grey of 8 bit.
    n_instants : int
        Instants of all exposures, those of moving bodies taking several.
    """

    frame_time_s: NDArray[np.float64]
    angle_rad: NDArray[np.float64]
    mean_angle_rad: NDArray[np.float64]
    bodies: tuple[str, ...]
    crlb_rad: NDArray[np.float64]
    relative_crlb_rad: NDArray[np.float64]
    noise_grey: float
    n_instants: int


def film_trial(
    path: str | os.PathLike[str],
    frame_time_s: ArrayLike,
    angle_rad_of_time: Callable[[NDArray[np.float64]], ArrayLike],
    geometry: ActionGeometry | None = None,
    settings: CameraSettings | None = None,
    seed: int = 0,
    progress: Callable[[int, int], None] | None = None,
    start_frame: int = 0,
) -> FilmTruth:
    """Write a synthetic film to ``path`` (``.mraw``) and its header beside it, exposed about ``frame_time_s`` (n,), s;
    ``angle_rad_of_time`` gives (k, 3): whippen from ground, jack, repetition lever from whippen. Return the true
    angles, bounds and noise.

    Parameters
    ----------
    path : path
        ``.mraw``; the header ``.cihx`` is written next to it.
    frame_time_s : ndarray, shape (n,)
        Middle of each exposure, s.
    angle_rad_of_time : callable
        Maps times, shape (k,), to angles, shape (k, 3): whippen from ground, jack and repetition from the
        whippen, rad.
    geometry : ActionGeometry, optional
    settings : CameraSettings, optional
    seed : int
        Of texture, background and noise.
    progress : callable, optional
        Called with (frames done, frames in all).
    start_frame : int
        Number of the first frame from the camera's trigger, for the header.

    Returns
    -------
    FilmTruth

    Raises
    ------
    InputError
        Frame times that do not increase, or a path that cannot be written.

    Examples
    --------
    >>> import numpy as np
    >>> from rig.simulated import ActionGeometry, film_trial
    >>> rest = np.array(ActionGeometry().rest_angle_rad)
    >>> truth = film_trial("still.mraw", np.arange(3) / 2000.0, lambda t: np.tile(rest, (len(t), 1)))
    >>> truth.mean_angle_rad.shape
    (3, 3)
    """
    geometry, settings = geometry or ActionGeometry(), settings or CameraSettings()
    times = as_numbers(frame_time_s, f"{path}: frame times")
    if times.ndim != 1 or times.size == 0 or not np.all(np.isfinite(times)) or np.any(np.diff(times) <= 0.0):
        raise InputError(f"{path}: frame times must be finite and increasing, one per frame; found shape {times.shape}")
    scene = film_scene(settings, seed)
    exposures = _Exposures(scene, geometry, settings, times, angle_rad_of_time, seed, progress)
    write_mraw(
        path, exposures.frames(), settings.frame_rate_hz, bit_depth=settings.bit_depth, exposure_s=settings.exposure_s,
        start_frame=start_frame, comment="synthetic film of the virtual bench",
    )  # fmt: skip
    noise = total_noise(settings.noise_grey, settings.bit_depth)
    bound = film_bounds(scene, geometry, settings, noise)
    relative = np.hypot(bound, bound[0])
    relative[0] = bound[0]
    return FilmTruth(times, exposures.centre, exposures.mean, NAMES, bound, relative, noise, exposures.n_instants)


@cache
def _normal_quantiles() -> NDArray[np.float32]:
    """Standard normal deviates of 2**16 equal probabilities, of mean 0 and variance 1; the largest is 4.2."""
    half = np.array([NormalDist().inv_cdf((k + 0.5) / 2**16) for k in range(2**15)])
    both = np.concatenate([half, -half[::-1]])
    return (both / both.std()).astype(np.float32)


class _FastSensor(Sensor):
    """A sensor that draws its noise from quantiles by integers of 16 bit, in a fifth of the time: a film of a trial has
    2e8 pixels."""

    def _draw_noise(self, shape: tuple[int, ...]) -> NDArray[np.float32]:
        drawn = self._rng.integers(0, _normal_quantiles().size, shape, dtype=np.uint16)
        return np.asarray(_normal_quantiles().take(drawn))


@dataclass
class _Exposures:
    """The exposures of one film; collects the truth while the frames stream to disk."""

    scene: Scene
    geometry: ActionGeometry
    settings: CameraSettings
    times: NDArray[np.float64]
    angle_of_time: Callable[[NDArray[np.float64]], ArrayLike]
    seed: int
    progress: Callable[[int, int], None] | None
    n_instants: int = 0
    centre: NDArray[np.float64] = field(init=False)
    mean: NDArray[np.float64] = field(init=False)

    def __post_init__(self) -> None:
        half = 0.5 * self.settings.exposure_s
        self.centre = self._angles(self.times)
        start, end = self._angles(self.times - half), self._angles(self.times + half)
        self.mean = self.centre.copy()
        # the tip of the longest arm, about 60 mm from its pivot, on top of the whippen's 0.13 m
        self._reach_px = self.settings.scale_px_per_m * np.array([0.13, 0.06, 0.06])  # m: as said above
        turned_rad = np.abs(np.stack([end - start, 2 * (end - self.centre), 2 * (self.centre - start)])).max(axis=0)
        blur = turned_rad @ self._reach_px
        self._instants = np.clip(np.ceil(blur / MAX_BLUR_STEP_PX), 1, MAX_INSTANTS).astype(int)

    def frames(self) -> Iterator[NDArray[Any]]:
        """Yield the frames (height, width) in order, as exposed with noise and flicker, and report (frames done, frames
        in all) to ``progress`` after each."""
        settings = self.settings
        sensor = _FastSensor(settings.noise_grey, settings.bit_depth, 1000 * self.seed + 98)
        # mean of the ripple over the exposure
        ripple = settings.flicker * np.sinc(settings.flicker_hz * settings.exposure_s)
        for i, (time, light) in enumerate(zip(self.times, self._lights(), strict=True)):
            yield sensor.expose(light, 1.0 + ripple * np.cos(2.0 * np.pi * settings.flicker_hz * time))
            if self.progress is not None:
                self.progress(i + 1, self.times.size)

    def _lights(self) -> Iterator[NDArray[np.float32]]:
        """Yield the noise-free picture (height, width), grey, of each frame in order, drawn ahead on two threads; one
        serves again while no body has moved."""
        with ThreadPoolExecutor(2) as pool:
            drawn: deque[Future[NDArray[np.float32]]] = deque()
            shown = np.full((1, 3), np.inf)
            for i in range(self.times.size):
                angles = self._angles_during(i)
                if len(angles) != len(shown) or np.max(np.abs(angles - shown) @ self._reach_px) > MAX_STALE_PX:
                    last = pool.submit(self.scene.light, poses(self.geometry, self.settings, angles))
                    shown = angles
                drawn.append(last)
                if len(drawn) > AHEAD:
                    yield drawn.popleft().result()
            while drawn:
                yield drawn.popleft().result()

    def _angles_during(self, i: int) -> NDArray[np.float64]:
        """Angles (k, 3), rad, at the k instants by which exposure ``i`` is drawn: whippen from ground, jack and
        repetition lever from the whippen; adds k to `n_instants` and sets row ``i`` of `mean` where k is above 1."""
        count = int(self._instants[i])
        self.n_instants += count
        if count == 1:
            return self.centre[i : i + 1]
        step = (np.arange(count) + 0.5) / count - 0.5
        angles = self._angles(self.times[i] + self.settings.exposure_s * step)
        self.mean[i] = angles.mean(axis=0)
        return angles

    def _angles(self, time_s: NDArray[np.float64]) -> NDArray[np.float64]:
        angles = as_numbers(self.angle_of_time(time_s), "angle_rad_of_time")
        if angles.shape != (time_s.size, 3) or not np.all(np.isfinite(angles)):
            raise InputError(
                f"angle_rad_of_time gave shape {angles.shape} for {time_s.size} times; needs finite ({time_s.size}, 3)"
            )
        return angles
