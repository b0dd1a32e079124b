"""Further disturbances of ``benchmarks/stress_films.py``: each changes a `Shot` before it is exposed."""

from __future__ import annotations

import io
import tempfile
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from stress_shot import F64, HEIGHT, PIVOT, STILL, WIDTH, N, Plate, Shot, progress, texture

try:
    import av
except ImportError:
    av = None  # the only one that writes H.264; OpenCV's wheel has no encoder

Y, X = np.mgrid[0:HEIGHT, 0:WIDTH].astype(float)


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
    photons = shot.rng.uniform(60.0, 250.0)

    def noise(picture: F64) -> F64:
        counts = shot.rng.poisson(np.maximum(picture, 0.0) * photons / 110.0)
        return counts * 110.0 / photons + shot.rng.normal(0.0, 1.0, picture.shape)

    shot.noise = noise


def vignette(shot: Shot) -> None:
    """The picture darkens towards its corners by 20 to 50 %."""
    far = ((X - WIDTH / 2) ** 2 + (Y - HEIGHT / 2) ** 2) / (WIDTH**2 / 4 + HEIGHT**2 / 4)
    shade = 1.0 - shot.rng.uniform(0.2, 0.5) * far
    shot.light = lambda _, picture: picture * shade


FURTHER = (
    blur,
    interlaced_flicker,
    mpeg4,
    shadow_edge,
    drops,
    dark_frames,
    quantisation,
    gamma,
    row_noise,
    hot_pixels,
    tilt,
    ghost,
    shot_noise,
    vignette,
    *((h264,) if av is not None else ()),
)
