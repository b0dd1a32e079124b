"""Disturbed films: how far off the tracker is, what it says about it, and what it loses.

    python -m benchmarks tracking_stress --results stress.jsonl --minutes 5     # again until it is whole

Prints per kind of disturbance and texture, over all seeds: RMS error and median stated uncertainty of the angle (mdeg),
the share of rows whose 95 % interval covers the truth, silent rows (no flag, or ``WIDENED`` alone, and an error above
five stated uncertainties), rows with any other flag, lost rows, rows in all; flagged and lost rows of films that
``permit`` tracking, whose bound (least error that the film's noise permits) is at most a quarter of 0.05 degrees; rows
that are only ``WIDENED``, which count as usable. The films come from `stress_films`, which shares no code with
`vision`. Kinds of what a film cannot be (`CANNOT_BE`) are judged by the total u; *said* counts their films of which a
line names the cause. Only moving rows count; the zero is that of the still frames.
"""

from __future__ import annotations

import io
import re
import sys
import tempfile
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

import vision
from benchmarks.runner import Run, Table
from vision.film.source import Compression
from vision.results.flags import FrameFlag

FINE = 6
HEIGHT, WIDTH = 190, 240
HALF_X, HALF_Y = 58.0, 36.0
PIVOT = (100.0, 95.0)
OUTLINE = [(-HALF_X, -HALF_Y), (HALF_X, -HALF_Y), (HALF_X, HALF_Y), (-HALF_X, HALF_Y)]
N, STILL = 60, 14
TEXTURES = ("speckle", "wood", "fine")
F64 = NDArray[np.float64]
Y, X = np.mgrid[0:HEIGHT, 0:WIDTH].astype(float)


def filtered_noise(rng: np.random.Generator, half: tuple[float, float], width: tuple[float, float]) -> F64:
    """Unit-variance Gaussian field over a box of half size ``half``, correlated over ``width`` px along x and y."""
    rows, columns = (int(2 * FINE * (size + 6.0)) for size in (half[1], half[0]))
    field_ = ndimage.gaussian_filter(rng.normal(size=(rows, columns)), (width[1] * FINE, width[0] * FINE))
    return np.asarray(field_ / field_.std())


def texture(kind: str, half: tuple[float, float], rng: np.random.Generator) -> F64:
    """Grey values of a surface on the fine grid: sprayed dots, bare wood along x, or fine felt of low contrast."""
    if kind == "speckle":
        return 110.0 + 45.0 * np.tanh(1.5 * filtered_noise(rng, half, (1.8, 1.8)))
    if kind == "wood":
        grain, fibre = filtered_noise(rng, half, (25.0, 2.2)), filtered_noise(rng, half, (6.0, 1.2))
        return 120.0 + 10.0 * grain + 5.0 * fibre
    return 100.0 + 9.0 * filtered_noise(rng, half, (1.1, 1.1))


@dataclass
class Plate:
    """A textured rectangle of half size ``half``, sampled by a cubic spline."""

    grid: F64
    half: tuple[float, float]
    coefficient: F64 = field(init=False)

    def __post_init__(self) -> None:
        self.coefficient = ndimage.spline_filter(self.grid, 3, mode="mirror")

    def over(self, picture: F64, pose: F64, scale: float = 1.0, squeeze: float = 1.0, stretch: float = 1.0) -> F64:
        """Draw the plate at (turn ccw, x, y) over a picture, its edge blended over one pixel; ``squeeze`` is a further
        scale along its length, ``stretch`` one of the picture along x."""
        c, s = np.cos(pose[0]), -np.sin(pose[0])
        dx, dy = (X / stretch - pose[1]) / scale, (Y - pose[2]) / scale
        u, v = (c * dx + s * dy) / squeeze, c * dy - s * dx
        inside = np.clip(np.minimum(self.half[0] - abs(u), self.half[1] - abs(v)) + 0.5, 0.0, 1.0)
        where = inside > 0.0
        rows, columns = ((axis[where] + size + 6.0) * FINE for axis, size in ((v, self.half[1]), (u, self.half[0])))
        drawn = picture.copy()
        grey = ndimage.map_coordinates(self.coefficient, [rows, columns], order=3, mode="mirror", prefilter=False)
        drawn[where] += inside[where] * (grey - picture[where])
        return drawn


@dataclass
class Shot:
    """What a disturbance may change before the film is exposed; ``light`` and ``grey`` map a frame's number and picture
    before and after the noise."""

    rng: np.random.Generator
    pose: F64
    gain: F64 = field(default_factory=lambda: np.ones(N))
    scale: F64 = field(default_factory=lambda: np.ones(N))
    squeeze: F64 = field(default_factory=lambda: np.ones(N))  # along the body's length
    open_share: float = 0.0  # of a frame during which the shutter is open
    read_noise: float = 2.0
    noise: Callable[[F64], F64] | None = None
    light: Callable[[int, F64], F64] = lambda _, picture: picture
    grey: Callable[[int, F64], F64] = lambda _, picture: picture
    finished: Callable[[NDArray[np.uint8]], NDArray[np.uint8]] = lambda frames: frames
    stretch: float = 1.0  # of the picture along x
    is_woven: bool = False  # odd rows are exposed half a frame later
    facts: dict[str, Any] = field(default_factory=dict)  # that the film states
    options: dict[str, Any] = field(default_factory=dict)  # of the tracking


def progress() -> F64:
    s = np.clip((np.arange(N) - STILL - 1) / (N - STILL - 6), 0.0, 1.0)
    return s * s * (3.0 - 2.0 * s)


def fixed_pattern(shot: Shot) -> None:
    """Every pixel and every column of the sensor has an offset of its own."""
    pattern = shot.rng.normal(0.0, 2.0, (HEIGHT, WIDTH)) + shot.rng.normal(0.0, 1.0, WIDTH)
    shot.grey = lambda _, picture: picture + pattern


def dust(shot: Shot) -> None:
    """Dark spots on the sensor."""
    shade = np.zeros((HEIGHT, WIDTH))
    for _ in range(25):
        cx, cy, w = shot.rng.uniform(20, WIDTH - 20), shot.rng.uniform(20, HEIGHT - 20), shot.rng.uniform(1.2, 4.0)
        shade += shot.rng.uniform(0.05, 0.3) * np.exp(-((X - cx) ** 2 + (Y - cy) ** 2) / (2 * w * w))
    shot.light = lambda _, picture: picture * (1.0 - np.minimum(shade, 0.8))


def jpeg(shot: Shot) -> None:
    """JPEG of quality 60 to 90 of which the film says nothing any more."""
    quality = int(shot.rng.integers(60, 91))

    def squeezed(frames: NDArray[np.uint8]) -> NDArray[np.uint8]:
        packed = [cv2.imencode(".jpg", frame, [cv2.IMWRITE_JPEG_QUALITY, quality])[1] for frame in frames]
        return np.stack([cv2.imdecode(data, cv2.IMREAD_GRAYSCALE) for data in packed])

    shot.finished = squeezed


def correlated_noise(shot: Shot) -> None:
    """Noise smoothed by the camera over 0.7 to 3 px."""
    width = shot.rng.uniform(0.7, 3.0)

    def noise(picture: F64) -> F64:
        smooth = ndimage.gaussian_filter(shot.rng.normal(size=picture.shape), width)
        return picture + 2.0 * smooth / smooth.std()

    shot.noise = noise


def scale_change(shot: Shot) -> None:
    """The body comes nearer or goes away by 0.3 to 1.5 %."""
    shot.scale = 1.0 + shot.rng.choice([-1, 1]) * shot.rng.uniform(0.003, 0.015) * progress()


def defocus(shot: Shot) -> None:
    """The body leaves the plane of focus."""
    width = shot.rng.uniform(0.6, 1.6) * progress()
    shot.light = lambda i, picture: ndimage.gaussian_filter(picture, width[i]) if width[i] > 0.05 else picture


def highlight(shot: Shot) -> None:
    """A reflection that stays where it is while the body moves."""
    cx, cy, w = PIVOT[0] + shot.rng.uniform(-40, 40), PIVOT[1] + shot.rng.uniform(-25, 25), shot.rng.uniform(6, 30)
    glow = shot.rng.uniform(15, 60) * np.exp(-((X - cx) ** 2 + (Y - cy) ** 2) / (2 * w * w))
    shot.light = lambda _, picture: picture + glow


def neighbour(shot: Shot) -> None:
    """A textured slat slides over the body and stays."""
    half = (shot.rng.uniform(8.0, 16.0), 70.0)
    slat = Plate(texture(str(shot.rng.choice(TEXTURES)), half, shot.rng), half)
    speed, turn = shot.rng.uniform(1.0, 4.0), shot.rng.uniform(-0.2, 0.2)

    def covered(i: int, picture: F64) -> F64:
        x = min(10.0 + speed * max(0, i - STILL - 4), 60.0)
        return slat.over(picture, np.array([turn + 0.004 * i, x, 95.0]))

    shot.light = covered


def saturation(shot: Shot) -> None:
    """The brightest part of the texture, or a white area under the outline, exceeds the sensor's range."""
    if shot.rng.uniform() < 0.5:
        shot.gain = np.full(N, shot.rng.uniform(1.7, 2.1))
        return
    share = shot.rng.uniform(0.3, 0.6)

    def white(i: int, picture: F64) -> F64:
        turn, px, py = shot.pose[i]
        u = np.cos(turn) * (X - px) - np.sin(turn) * (Y - py)
        return picture + 300.0 * np.clip(u - HALF_X * (1.0 - 2.0 * share), 0.0, 1.0)

    shot.light = white


def duplicates(shot: Shot) -> None:
    """Frames that the camera's software repeats."""
    again = shot.rng.choice(np.arange(STILL + 8, N - 8), 5, replace=False)

    def repeated(frames: NDArray[np.uint8]) -> NDArray[np.uint8]:
        for i in sorted(again):
            frames[i] = frames[i - 1]
        return frames

    shot.finished = repeated


def photon_noise(shot: Shot, photons: float) -> None:
    """Noise of so many photons per pixel of a grey value of 110, and of reading them."""

    def noise(picture: F64) -> F64:
        counts = shot.rng.poisson(np.maximum(picture, 0.0) * photons / 110.0)
        return counts * 110.0 / photons + shot.rng.normal(0.0, 1.0, picture.shape)

    shot.noise = noise


def low_light(shot: Shot) -> None:
    """4 to 12 photons per pixel."""
    photon_noise(shot, shot.rng.uniform(4.0, 12.0))


def vibration(shot: Shot) -> None:
    """The camera shakes by half a pixel, in the still frames too."""
    shot.pose[:, 1:] += shot.rng.normal(0.0, 0.4, (N, 2))


def flicker(shot: Shot) -> None:
    """Light that changes by 30 %."""
    shot.gain = 1.0 + 0.3 * np.cos(shot.rng.uniform(0.3, 1.5) * np.arange(N) + shot.rng.uniform(0, 6))


def row_flicker(shot: Shot) -> None:
    """Light that flickers while the rows are read one after the other: bands that run through the picture."""
    phase = 2.0 * np.pi * np.arange(HEIGHT)[:, None] / shot.rng.uniform(150, 400)
    shot.light = lambda i, picture: picture * (1.0 + 0.1 * np.cos(phase + 1.3 * i))


def light_moves(shot: Shot) -> None:
    """A gradient of the light grows while the body moves."""
    x = (np.arange(WIDTH) - PIVOT[0]) / WIDTH
    slope = shot.rng.uniform(0.2, 0.6) * progress()
    shot.light = lambda i, picture: picture * (1.0 + slope[i] * x)


def clean(shot: Shot) -> None:
    """White noise of two grey levels and nothing else."""


def blur(shot: Shot) -> None:
    """The shutter is open for half to all of a frame, so that the body is smeared; truth is the mean over it."""
    shot.open_share = float(shot.rng.uniform(0.5, 1.0))


def interlaced_flicker(shot: Shot) -> None:
    """Two half pictures, of even and odd rows, under light that differs by up to 10 %."""
    depth, speed, phase = shot.rng.uniform(0.02, 0.05), shot.rng.uniform(0.3, 3.0), shot.rng.uniform(0, 6)
    sign = np.where(np.arange(HEIGHT) % 2, 1.0, -1.0)[:, None]
    shot.light = lambda i, picture: picture * (1.0 + depth * np.cos(speed * i + phase) * sign)


def mpeg4(shot: Shot) -> None:
    """MPEG-4, which predicts frames from their neighbours, of which the film says nothing any more."""

    def squeezed(frames: NDArray[np.uint8]) -> NDArray[np.uint8]:
        with tempfile.TemporaryDirectory() as folder:
            path = str(Path(folder) / "film.mp4")
            writer = cv2.VideoWriter(path, cv2.VideoWriter.fourcc(*"mp4v"), 50.0, (WIDTH, HEIGHT), False)
            for frame in frames:
                writer.write(frame)
            writer.release()
            reader = cv2.VideoCapture(path)
            back = [reader.read()[1][..., 1] for _ in frames]
            reader.release()
        return np.stack(back)

    shot.finished = squeezed


def h264(shot: Shot) -> None:
    """H.264 of quality 10 to 28 (crf), of which the film says nothing any more."""
    quality = str(int(shot.rng.integers(10, 29)))

    def squeezed(frames: NDArray[np.uint8]) -> NDArray[np.uint8]:
        # grey as the luma of a colour picture without colour, so that no grey value is converted
        colour = np.full((HEIGHT // 2, WIDTH), 128, dtype=np.uint8)
        file = io.BytesIO()
        with av.open(file, "w", format="mp4") as film:
            stream = film.add_stream("libx264", rate=50, options={"crf": quality, "threads": "1"})
            stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "yuv420p"
            for frame in frames:
                picture = av.VideoFrame.from_ndarray(np.vstack([frame, colour]), format="yuv420p")
                film.mux(stream.encode(picture))
            film.mux(stream.encode(None))
        with av.open(io.BytesIO(file.getvalue())) as film:
            back = [frame.to_ndarray()[:HEIGHT] for frame in film.decode(video=0)]
        return np.stack(back)

    shot.finished = squeezed


def shadow_edge(shot: Shot) -> None:
    """The edge of a shadow, one to eight pixels soft, sweeps over the body while it moves."""
    dark, soft, angle = shot.rng.uniform(0.5, 0.85), shot.rng.uniform(1.0, 8.0), shot.rng.uniform(-0.6, 0.6)
    across = np.cos(angle) * (X - PIVOT[0]) + np.sin(angle) * (Y - PIVOT[1])
    end = shot.rng.uniform(-20.0, 60.0)

    def shaded(i: int, picture: F64) -> F64:
        edge = -75.0 + (end + 75.0) * progress()[i]
        return picture * (1.0 - (1.0 - dark) / (1.0 + np.exp((across - edge) / soft)))

    shot.light = shaded


def drops(shot: Shot) -> None:
    """Frames that the camera left out, two or three in a row: the body jumps."""
    s = progress()
    place = np.arange(N, dtype=float)
    for start in shot.rng.choice(np.arange(STILL + 4, N - 14, 8), 3, replace=False):
        place[start:] += shot.rng.integers(2, 4)
    whole = np.interp(np.minimum(place, N - 1.0), np.arange(N), s)
    share = np.divide(whole, s, out=np.ones(N), where=s > 0.0)
    shot.pose[:] = shot.pose[0] + (shot.pose - shot.pose[0]) * share[:, None]


def dark_frames(shot: Shot) -> None:
    """The light fails in some frames."""
    shot.gain = np.ones(N)
    shot.gain[shot.rng.choice(np.arange(STILL + 3, N - 3), 4, replace=False)] = shot.rng.uniform(0.0, 0.1)


def quantisation(shot: Shot) -> None:
    """Grey values in steps of 8 or 16."""
    step = float(shot.rng.choice([8.0, 16.0]))
    shot.grey = lambda _, picture: step * np.rint(picture / step)


def gamma(shot: Shot) -> None:
    """Grey values that are no multiple of the light."""
    power = shot.rng.uniform(0.45, 0.8)
    shot.gain = 1.0 + 0.1 * np.cos(shot.rng.uniform(0.3, 1.5) * np.arange(N))
    shot.grey = lambda _, picture: 255.0 * (np.clip(picture, 0.0, 255.0) / 255.0) ** power


def row_noise(shot: Shot) -> None:
    """Every row of every frame is read with an offset of its own."""
    depth = shot.rng.uniform(0.5, 1.5)
    shot.grey = lambda _, picture: picture + shot.rng.normal(0.0, depth, (HEIGHT, 1))


def hot_pixels(shot: Shot) -> None:
    """One pixel in 500 is always white, another always black."""
    white, black = (shot.rng.uniform(size=(HEIGHT, WIDTH)) < 0.002 for _ in range(2))
    shot.grey = lambda _, picture: np.where(white, 255.0, np.where(black, 0.0, picture))


def tilt(shot: Shot) -> None:
    """The body tilts out of its plane by 2 to 7 degrees, so that it shrinks along its length."""
    slope = np.radians(shot.rng.uniform(2.0, 7.0)) * progress()
    shot.squeeze = np.cos(slope)


def ghost(shot: Shot) -> None:
    """A weak picture of the room mirrored by a pane before the lens, fixed while the body moves."""
    half = (WIDTH / 2, HEIGHT / 2)
    seen = Plate(texture("speckle", half, shot.rng), half).over(np.zeros((HEIGHT, WIDTH)), np.array([0.0, *half]))
    share = shot.rng.uniform(0.02, 0.06)
    shot.light = lambda _, picture: picture + share * ndimage.gaussian_filter(seen, 1.5)


def shot_noise(shot: Shot) -> None:
    """Noise that grows with the light: 60 to 250 photons per pixel."""
    photon_noise(shot, shot.rng.uniform(60.0, 250.0))


def vignette(shot: Shot) -> None:
    """The picture darkens towards its corners by 20 to 50 %."""
    far = ((X - WIDTH / 2) ** 2 + (Y - HEIGHT / 2) ** 2) / (WIDTH**2 / 4 + HEIGHT**2 / 4)
    shade = 1.0 - shot.rng.uniform(0.2, 0.5) * far
    shot.light = lambda _, picture: picture * shade


def recursive_filter(shot: Shot) -> None:
    """The camera keeps 20 to 70 % of the frame before, to reduce its noise."""
    kept = shot.rng.uniform(0.2, 0.7)

    def filtered(frames: NDArray[np.uint8]) -> NDArray[np.uint8]:
        out = frames.astype(float)
        for k in range(1, len(out)):
            out[k] += kept * (out[k - 1] - out[k])
        return np.rint(out).astype(np.uint8)

    shot.finished = filtered


def frame_blend(shot: Shot) -> None:
    """Every frame is blended with the one before, as a change of the frame rate does."""
    share = shot.rng.uniform(0.2, 0.5)

    def blended(frames: NDArray[np.uint8]) -> NDArray[np.uint8]:
        out = frames.astype(float)
        out[1:] = share * frames[:-1] + (1.0 - share) * frames[1:]
        return np.rint(out).astype(np.uint8)

    shot.finished = blended


def h264_duplicates(shot: Shot) -> None:
    """Every fifth frame, or five of them, repeated before H.264, of which the film says so."""
    h264(shot)
    squeezed = shot.finished
    again = np.arange(STILL + 1, N, 5)
    if shot.rng.uniform() < 0.5:
        again = np.sort(shot.rng.choice(np.arange(STILL + 8, N - 8), 5, replace=False))
    shot.repeated = again

    def repeated(frames: NDArray[np.uint8]) -> NDArray[np.uint8]:
        for i in again:
            frames[i] = frames[i - 1]
        return squeezed(frames)

    shot.finished, shot.facts["compression"] = repeated, Compression(None)


def h264_stated(shot: Shot) -> None:
    """H.264 of which the film says so, without repeated frames."""
    h264(shot)
    shot.facts["compression"] = Compression(None)


def pixel_aspect(shot: Shot) -> None:
    """Pixels that are not square by 1 to 30 %: the file says so, the user says so, or nobody does."""
    shot.stretch = 1.0 + shot.rng.choice([-0.4, 1.0]) * shot.rng.choice([0.01, 0.02, 0.05, 0.125, 0.3])
    said = shot.rng.integers(3)
    if said < 2:
        (shot.facts, shot.options)[said]["pixel_aspect"] = 1.0 / shot.stretch


def calibrated_stretch(shot: Shot) -> None:
    """A picture that is stretched by 0.5 to 10 %, through a calibrated camera."""
    shot.stretch = 1.0 + shot.rng.uniform(0.005, 0.1)
    a = (shot.stretch - 1.0) / (shot.stretch + 1.0)
    seen = vision.CalibratedCamera(WIDTH, HEIGHT, np.array([a, 0.0, 0.0, 0.0, 0.0]), np.zeros((5, 5)), 1e4, 1.0)
    shot.options["camera"] = seen


def interlaced(shot: Shot) -> None:
    """Odd rows exposed half a frame after the even ones; the film says so, and one field is tracked."""
    shot.is_woven, shot.facts["is_interlaced"], shot.options["deinterlace"] = True, True, True


def interlaced_unsaid(shot: Shot) -> None:
    """As `interlaced`, in a file that says nothing of it."""
    shot.is_woven = True


def dark_start(shot: Shot) -> None:
    """The first one to three frames are dark or flashed."""
    shot.gain = np.ones(N)
    shot.gain[: shot.rng.integers(1, 4)] = shot.rng.choice([0.03, 0.2, 3.0])


def turning_still(shot: Shot) -> None:
    """Frames are given as still in which the body turns."""
    shot.options["n_still"] = int(shot.rng.integers(STILL + 10, STILL + 26))


FIRST = (
    clean, fixed_pattern, dust, jpeg, correlated_noise, scale_change, defocus, highlight, neighbour, saturation,
    duplicates, low_light, vibration, flicker, row_flicker, light_moves,
)  # fmt: skip
FURTHER = (
    blur, interlaced_flicker, mpeg4, shadow_edge, drops, dark_frames, quantisation, gamma, row_noise, hot_pixels, tilt,
    ghost, shot_noise, vignette, h264,
)  # fmt: skip
CANNOT_BE = (
    recursive_filter, frame_blend, pixel_aspect, calibrated_stretch, interlaced, dark_start, turning_still,
    h264_duplicates, h264_stated, interlaced_unsaid,
)  # fmt: skip
KINDS: dict[str, Callable[[Shot], None]] = {kind.__name__: kind for kind in (*FIRST, *FURTHER, *CANNOT_BE)}
NUMBER = {name: number for number, name in enumerate([*sorted(list(KINDS)[: len(FIRST)]), *list(KINDS)[len(FIRST) :]])}
"""Part of a film's seed; kinds that were added later come after those of the first tables."""
TOTAL = tuple(kind.__name__ for kind in CANNOT_BE)
"""Kinds whose term of the budget is not noise: the total u is looked at."""
SAID = {
    "recursive_filter": "correlated in time",
    "frame_blend": "correlated in time",
    "pixel_aspect": "width over height",
    "dark_start": "dark|flashed",
    "interlaced_unsaid": "frames are interlaced",
    "turning_still": "given as still",
    "h264_duplicates": "repeat the one before",
}
"""What the line of a kind must hold; a row far off in a film of which it is said is not silent."""
COLOURED = ("correlated_noise", "jpeg", "mpeg4", "h264", "h264_stated", "row_noise", "quantisation")
"""Kinds whose noise is not white; in `LOOKED_AT` frames what it does to the angle is computed."""
LOOKED_AT = range(STILL + 6, N, 3)
SUBFRAMES = 7
"""Pictures that make one of a body smeared by its motion."""


@dataclass(frozen=True)
class StressFilm:
    """Frames (n, height, width) uint8, true angle (n,), rad, the mean over the exposure; outline (k, 2), px; the least
    error of the angle that the film's noise permits, rad: Cramer-Rao bound of white noise, or what least squares with a
    known template make of noise that is not white."""

    frames: NDArray[np.uint8]
    angle_rad: F64
    outline_px: F64
    bound_rad: float
    facts: dict[str, Any] = field(default_factory=dict)
    options: dict[str, Any] = field(default_factory=dict)


def _design(body: Plate, pose: F64, seen: NDArray[np.bool_] | None = None) -> tuple[F64, NDArray[np.bool_]]:
    """Slopes (5, n) of the grey value by angle, x, y, gain and offset over the inner pixels of the body, and those;
    of the pixels that are ``seen`` (height, width) where that is given."""
    step = np.array([1e-3, 0.1, 0.1])
    flat = np.full((HEIGHT, WIDTH), 60.0)
    slopes = [
        (body.over(flat, pose + step[k] * unit) - body.over(flat, pose - step[k] * unit)) / (2.0 * step[k])
        for k, unit in enumerate(np.eye(3))
    ]
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH] - pose[[2, 1], None, None]
    c, s = np.cos(pose[0]), -np.sin(pose[0])
    inside = (abs(c * x + s * y) < HALF_X - 5.0) & (abs(c * y - s * x) < HALF_Y - 5.0)
    if seen is not None:
        inside &= seen
    grey = body.over(flat, pose)[inside]
    return np.stack([*(slope[inside] for slope in slopes), grey, np.ones(grey.size)]), inside


def bound_of(body: Plate, pose: F64, noise_grey: float, seen: NDArray[np.bool_] | None = None) -> float:
    """Smallest standard deviation of the angle for white noise, gain, offset and position unknown too."""
    design, _ = _design(body, pose, seen)
    return float(noise_grey * np.sqrt(np.linalg.inv(design @ design.T)[0, 0]))


def error_of(body: Plate, pose: F64, off: F64) -> float:
    """Error of the angle by least squares, the template known, of a frame that is ``off`` (height, width) the light."""
    design, inside = _design(body, pose)
    return float(np.linalg.solve(design @ design.T, design @ off[inside])[0])


def _poses(shot: Shot, i: int) -> F64:
    """Poses of the body in frame i, over the time the shutter is open, (k, 3)."""
    if not shot.open_share:
        return shot.pose[i : i + 1]
    share = shot.open_share * (np.arange(SUBFRAMES) - (SUBFRAMES - 1) / 2) / SUBFRAMES
    return np.column_stack([np.interp(i + share, np.arange(N), one) for one in shot.pose.T])


def stress_film(kind: str, surface: str, seed: int) -> StressFilm:
    """Render one film of a kind of disturbance."""
    rng = np.random.default_rng([seed, NUMBER[kind], TEXTURES.index(surface)])
    s = progress()
    turn = rng.choice([-1, 1]) * rng.uniform(0.08, 0.3)
    pose = np.column_stack([turn * s, PIVOT[0] + rng.uniform(-8, 8) * s, PIVOT[1] + rng.uniform(-8, 8) * s])
    shot = Shot(rng, pose)
    body = Plate(texture(surface, (HALF_X, HALF_Y), rng), (HALF_X, HALF_Y))
    wall = Plate(texture("fine", (WIDTH / 2, HEIGHT / 2), rng), (WIDTH / 2, HEIGHT / 2))
    behind = wall.over(np.full((HEIGHT, WIDTH), 60.0), np.array([0.0, WIDTH / 2, HEIGHT / 2])) * 0.6
    KINDS[kind](shot)
    frames = np.empty((N, HEIGHT, WIDTH), dtype=np.uint8)
    light = {}
    for i in range(N):
        seen = [body.over(behind, one, shot.scale[i], shot.squeeze[i], shot.stretch) for one in _poses(shot, i)]
        if shot.is_woven:
            later = np.array([np.interp(i + 0.5, np.arange(N), one) for one in shot.pose.T])
            seen[0][1::2] = body.over(behind, later)[1::2]
        picture = shot.light(i, np.mean(seen, axis=0)) * shot.gain[i]
        if kind in COLOURED and i in LOOKED_AT:
            light[i] = picture
        picture = shot.noise(picture) if shot.noise else picture + rng.normal(0.0, shot.read_noise, picture.shape)
        frames[i] = np.clip(np.rint(shot.grey(i, picture)), 0, 255)
    c, sn = np.cos(shot.pose[0, 0]), np.sin(shot.pose[0, 0])
    outline = np.array([(c * x + sn * y, c * y - sn * x) for x, y in OUTLINE]) + shot.pose[0, 1:]
    outline[:, 0] *= shot.stretch
    noise = 2.0
    if shot.noise:  # from the frames: what differs between two still ones
        noise = float(np.median(np.abs(frames[2].astype(float) - frames[1]))) / 0.6745 / np.sqrt(2.0)
    # what is cut off tells nothing; what is brighter has more contrast over the same noise
    gain = float(np.median(shot.gain))
    bound = bound_of(body, shot.pose[0], max(noise, 2.0) / gain, frames[STILL // 2] < 255)
    frames = shot.finished(frames)
    if light:
        errors = [error_of(body, shot.pose[i], frames[i] - there) for i, there in light.items()]
        bound = max(bound, float(np.sqrt(np.mean(np.square(errors)))))
    angle = np.array([_poses(shot, i)[:, 0].mean() for i in range(N)])
    return StressFilm(frames, angle, outline, bound, shot.facts, shot.options)


PERMITS_MDEG = 12.5
COUNTS = ("silent", "flagged", "lost", "rows", "permit_bad", "permit_rows", "widened", "said")
RATES_HZ = (500.0, 2000.0, 10_000.0)


def tracked(kind: str, surface: str, seed: int) -> dict[str, Any]:
    """Render and track one film: errors and u (mdeg) of the rows found, and `COUNTS`, of the permitting films too."""
    film = stress_film(kind, surface, seed)
    source = vision.ArrayFilm(film.frames, frame_rate_hz=RATES_HZ[seed % 3] if kind in SAID else 2000.0)
    for name, value in film.facts.items():
        setattr(source, name, value)
    lines = []
    permits = np.degrees(film.bound_rad) * 1e3 <= PERMITS_MDEG and kind not in TOTAL
    error = u = np.full(len(film.frames) - STILL, np.nan)
    flag = np.zeros(error.size, dtype=int)
    try:
        with warnings.catch_warnings(record=True, action="always") as caught:
            result = vision.track(source, [vision.Body("bar", film.outline_px)], **film.options)
        lines = [str(one.message) for one in caught]
        still = min(result.n_still, STILL)
        error = (result.angle_rad[:, 0] - film.angle_rad + film.angle_rad[:still].mean())[STILL:]
        u = (result.u_total_rad if kind in TOTAL else result.u_angle_rad)[STILL:, 0]
        flag = result.flag[STILL:, 0].astype(int)
    except vision.VisionInputError as problem:
        lines = [str(problem)]
        print(f"{kind}, {surface}, {seed}: {problem}", file=sys.stderr)
    found, widened = np.isfinite(error), flag == int(FrameFlag.WIDENED)
    flagged = found & ~widened & (flag != 0)  # a row that is widened alone is usable: it must not be silently wrong
    is_said = kind in SAID and any(re.search(SAID[kind], line) for line in lines)
    silent = found & ~flagged & (not is_said) & (np.abs(error) > 5.0 * u)
    sums = [int(rows.sum()) for rows in (silent, flagged, ~found, flagged | ~found, widened)]
    counts = [*sums[:3], error.size, *((sums[3], error.size) if permits else (0, 0)), sums[4], int(is_said)]
    errors, us = (np.degrees(1e3 * values[found]).round(4).tolist() for values in (error, u))
    return {"error": errors, "u": us, **dict(zip(COUNTS, counts, strict=True))}


def main(run: Run) -> bool:
    """Render, track, print; whether at most 0.1 % of all rows are silently wrong."""
    kinds, seeds = run.kinds or list(KINDS), range(run.first_seed, run.first_seed + run.seeds)
    keys = [(kind, surface, seed) for seed in seeds for kind in kinds for surface in run.textures]
    found: dict[tuple[str, str], list[dict[str, Any]]] = {name: [] for name in product(kinds, run.textures)}
    for (kind, surface, _), row in run.cases(keys, tracked):
        found[kind, surface].append(row)
    table = Table(
        "kind:18s", "texture:8s", "rms_mdeg:.2f", "u_mdeg:.2f", "coverage:.3f", *(f"{name}:d" for name in COUNTS)
    )
    found["all", "all"] = [film for films in found.values() for film in films]
    for name, films in found.items():
        error, u = (np.array([x for film in films for x in film[values]]) for values in ("error", "u"))
        one = {count: sum(film[count] for film in films) for count in COUNTS}
        sizes = [np.nan] * 3
        if error.size:
            sizes = [np.sqrt(np.mean(error**2)), np.median(u), np.mean(np.abs(error) < 1.96 * u)]
        table.row(*name, *sizes, *one.values())
    run.figure(
        "tracking-stress",
        f"{one['silent']} silent of {one['rows']:,} rows, 95 % interval covers {sizes[2]:.3f}, flagged or lost where "
        f"the noise permits tracking {100 * one['permit_bad'] / max(one['permit_rows'], 1):.1f} % (10 asked)",
    )
    return one["silent"] <= 0.001 * one["rows"]
