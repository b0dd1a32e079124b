"""The virtual bench's high-speed camera: films whippen, jack and repetition lever into a Photron MRAW file.

It takes the true angles of the action as a function of time, and the frame times; the film goes to disk frame by frame,
in the format of a real one. What the camera sees is defined in `camera_view`.

Angles are counter-clockwise in rad (whippen from ground, jack and repetition lever from the whippen); `frame_time_s` is
the middle of each exposure. Flicker is a sinusoidal ripple of the light, averaged over the exposure. No half-written
file is left behind by an error.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rig.arrays import as_numbers
from rig.simulated.bench.camera_view import (
    NAMES,
    ActionGeometry,
    CameraSettings,
    film_bounds,
    film_scene,
    poses,
)
from vision.errors import InputError
from vision.film.mraw_writer import write_mraw
from vision.synthetic import Scene, Sensor, total_noise

MAX_BLUR_STEP_PX = 0.15
MAX_INSTANTS = 24
AHEAD = 4
"""Pictures drawn before the one that becomes a frame."""


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
        Instants rendered in all, exposures of moving bodies taking several.
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
    """Film a trial.

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
        reach = self.settings.scale_px_per_m * np.array([0.13, 0.06, 0.06])
        blur = np.abs(np.stack([end - start, 2 * (end - self.centre), 2 * (self.centre - start)])).max(axis=0) @ reach
        self._instants = np.clip(np.ceil(blur / MAX_BLUR_STEP_PX), 1, MAX_INSTANTS).astype(int)

    def frames(self) -> Iterator[NDArray[Any]]:
        """Frames in order."""
        settings = self.settings
        sensor = Sensor(settings.noise_grey, settings.bit_depth, 1000 * self.seed + 98)
        # mean of the ripple over the exposure
        ripple = settings.flicker * np.sinc(settings.flicker_hz * settings.exposure_s)
        for i, (time, light) in enumerate(zip(self.times, self._lights(), strict=True)):
            yield sensor.expose(light, 1.0 + ripple * np.cos(2.0 * np.pi * settings.flicker_hz * time))
            if self.progress is not None:
                self.progress(i + 1, self.times.size)

    def _lights(self) -> Iterator[NDArray[np.float32]]:
        """Noise-free pictures in order, drawn on threads while the ones before become frames and go to disk."""
        with ThreadPoolExecutor(2) as pool:
            drawn: deque[Future[NDArray[np.float32]]] = deque()
            for i in range(self.times.size):
                drawn.append(pool.submit(self.scene.light, poses(self.geometry, self.settings, self._angles_during(i))))
                if len(drawn) > AHEAD:
                    yield drawn.popleft().result()
            while drawn:
                yield drawn.popleft().result()

    def _angles_during(self, i: int) -> NDArray[np.float64]:
        """Angles at the instants of one exposure."""
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
