"""Cases of ``benchmarks/tracking.py``: one body of 10,000 pixels with and without occlusion, many films.

`blow` moves the bodies of all film benchmarks. Times are processor seconds with OpenCV on one thread, so
that other load hardly affects them.
"""

from __future__ import annotations

import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.runner import least
from rig.simulated import CameraSettings, film_bodies, film_trial
from vision.angles import ccw_to_picture
from vision.bodies.masks import build_masks
from vision.bodies.outlines import Body
from vision.film.avi_writer import write_avi
from vision.film.mraw import write_mraw
from vision.film.open import open_film
from vision.film.source import ArrayFilm
from vision.fitting.template import design_columns
from vision.results.flags import FrameFlag
from vision.synthetic import Scene, Sensor, SyntheticBody, background, box, speckle, total_noise, wood_grain
from vision.tracking.track_film import track_film

HEIGHT, WIDTH, N_STILL, NOISE = 220, 260, 40, 2.0
PIVOT = (105.0, 110.0)
MDEG = np.radians(1e-3)


REST = np.array([0.0251, 0.3198, 0.3523])  # whippen, jack, repetition lever


def smooth_step(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Step from 0 to 1 as x goes from 0 to 1, with zero speed and acceleration at both ends."""
    x = np.clip(x, 0.0, 1.0)
    return x**3 * (10 - 15 * x + 6 * x * x)


def blow(time_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Angles of a fast blow, rad, with peak speeds of 4, 25 and 14 rad/s."""
    down = 1.0 - smooth_step((time_s - 0.20) / 0.06)
    return REST + np.column_stack(
        [
            0.09 * smooth_step((time_s - 0.06) / 0.04) * down,
            -0.35 * smooth_step((time_s - 0.08) / 0.026) * down,
            0.22 * smooth_step((time_s - 0.07) / 0.03) * down,
        ]
    )


def bar_scene(texture: str, seed: int) -> Scene:
    """A bar with 10,584 usable pixels in front of a background."""
    extent = (-56.0, -52.0, 90.0, 52.0)
    make = speckle(extent, seed) if texture == "speckle" else wood_grain(extent, seed, direction_rad=0.15)
    return Scene([SyntheticBody("bar", box(-50.0, -46.0, 84.0, 46.0), make)], background(HEIGHT, WIDTH, seed + 1))


def bar_pose(n: int, turn_rad: float = 0.3) -> NDArray[np.float64]:
    """Poses (n, 3): at rest, then a rotation with drift."""
    s = smooth_step((np.arange(n) - N_STILL - 2) / (n - N_STILL - 10))
    return np.column_stack([turn_rad * s, PIVOT[0] + 8 * s, PIVOT[1] - 5 * s])


def cover_of(frame: int, width: int) -> slice:
    """Image columns occluded by a dark bar of ``width`` px."""
    left = 40 + int(0.45 * max(0, frame - N_STILL))
    return slice(left, left + width) if frame > N_STILL and width else slice(0, 0)


def one_body(texture: str, cover_px: int, n: int = 400, seed: int = 3) -> dict[str, float]:
    """Track the bar alone from an MRAW film: RMS over the bound for the visible pixels, coverage, frames per second."""
    scene, pose = bar_scene(texture, seed), bar_pose(n)
    sensor, frames = Sensor(NOISE, 8, seed), []
    for i in range(n):
        light = scene.light(pose[i][None, None]).copy()
        light[:, cover_of(i, cover_px)] = 25.0
        frames.append(sensor.expose(light, 1.0 + 0.05 * np.cos(0.37 * i)))
    body = Body("bar", scene.bodies[0].outline(*pose[0]))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "bar.mraw"
        write_mraw(path, frames, 2000.0)
        track_film(path, [body], every=n // 4, n_still=N_STILL)  # compiles, and fills the page cache
        seconds = least(lambda: track_film(path, [body], n_still=N_STILL), 3)
        result = track_film(path, [body], n_still=N_STILL)
    error = result.angle_rad[:, 0] - (pose[:, 0] - pose[:N_STILL, 0].mean())
    moving = slice(N_STILL + 1, None)
    bound, hidden = visible_bounds(scene, body, pose, cover_px)
    z = error[moving] / result.u_angle_rad[moving, 0]
    return {
        "pixels": float(result.info["pixels"]["bar"]),
        "hidden": float(hidden[moving].max()),
        "rms_mdeg": float(np.sqrt(np.nanmean(error[moving] ** 2)) / MDEG),
        "ratio": float(np.sqrt(np.nanmean((error[moving] / bound[moving]) ** 2))),
        "cover95": float(np.mean(np.abs(z[np.isfinite(z)]) < 1.96)),
        "z_std": float(np.nanstd(z)),
        "lost": float(result.failed.sum()),
        "frames_per_s": n / seconds,
    }


def against_pyidi(texture: str, n: int = 110, seed: int = 3) -> dict[str, float]:
    """The unoccluded bar, ours and pyIDI's rigid DIC on the same rectangle: RMS (mdeg), frames per CPU second."""
    import pyidi

    scene, pose = bar_scene(texture, seed), bar_pose(n)
    sensor = Sensor(NOISE, 8, seed)
    frames = np.stack([sensor.expose(scene.light(p[None, None])) for p in pose])
    body = Body("bar", scene.bodies[0].outline(*pose[0]))
    rows, columns = np.nonzero(build_masks([body], HEIGHT, WIDTH)[0])
    size = [int(np.ptp(v)) // 2 * 2 + 1 for v in (rows, columns)]
    with tempfile.TemporaryDirectory() as folder:
        start = time.process_time()
        dic = pyidi.DIC(pyidi.VideoReader(input_file=frames, root=folder))
        dic.set_points(points=np.array([[round(rows.mean()), round(columns.mean())]]))
        dic.configure(roi_size=size, warp="rigid", verbose=0, show_pbar=False)
        dic.get_displacements(autosave=False)
        theirs_s = time.process_time() - start
    film = ArrayFilm(frames, 2000.0)
    track_film(film, [body], every=n // 4, n_still=N_STILL)
    start = time.process_time()
    result = track_film(film, [body], n_still=N_STILL)
    ours_s = time.process_time() - start
    true = pose[:, 0] - pose[:N_STILL, 0].mean()
    phi = -dic.warp_params[0, :, 2]
    theirs = phi - phi[:N_STILL].mean() - true
    ours = result.angle_rad[:, 0] - true

    def rms(error: NDArray[np.float64]) -> float:
        return float(np.sqrt(np.nanmean(error[N_STILL + 1 :] ** 2)) / MDEG)

    return {"ours": rms(ours), "pyidi": rms(theirs), "ours_per_s": n / ours_s, "pyidi_per_s": n / theirs_s}


def visible_bounds(
    scene: Scene, body: Body, pose: NDArray[np.float64], cover_px: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Cramer-Rao bound of the angle from the visible pixels, rad, and occluded share, frame by frame."""
    picture = scene.light(pose[0][None, None])
    mask = build_masks([body], HEIGHT, WIDTH)[0]
    rows, columns = np.nonzero(mask)
    design, _, _ = design_columns(picture, mask, (float(columns.mean()), float(rows.mean())))
    bound, hidden = np.empty(len(pose)), np.empty(len(pose))
    arm = np.stack([columns - PIVOT[0], rows - PIVOT[1]])
    for i, (angle, x, _) in enumerate(pose):
        phi = float(ccw_to_picture(angle))
        at = x + np.cos(phi) * arm[0] - np.sin(phi) * arm[1]
        bar = cover_of(i, cover_px)
        seen = (at < bar.start - 0.5) | (at > bar.stop - 0.5)
        normal = design[seen].T @ design[seen]
        bound[i] = total_noise(NOISE, 8) * np.sqrt(np.linalg.inv(normal)[0, 0])
        hidden[i] = 1.0 - seen.mean()
    return bound, hidden


def many_films(count: int, n: int, quality: int | None) -> tuple[float, float, float, int]:
    """Whippen and both relative angles of ``count`` films: coverage of the 95 % interval, spread of error over u,
    largest error (mdeg) of a frame without a flag, total frames."""
    z, largest, total = [], 0.0, 0
    for seed in range(count):
        texture = ("wood", "speckle")[seed % 2]
        settings = replace(CameraSettings(), texture=texture)
        rng = np.random.default_rng(seed)
        shift, size = rng.uniform(-0.01, 0.02), rng.uniform(0.6, 1.0)
        with tempfile.TemporaryDirectory() as folder:
            path: Path = Path(folder) / "film.mraw"
            times = 62.5e-6 + np.arange(n) / settings.frame_rate_hz
            truth = film_trial(
                path, times, lambda t, a=shift, b=size: REST + b * (blow(t - a) - REST), settings=settings, seed=seed
            )
            if quality is not None:
                avi = Path(folder) / "film.avi"
                with open_film(path) as film:
                    write_avi(avi, (film.read(i) for i in range(n)), settings.frame_rate_hz, quality=quality)
                path = avi
            result = track_film(path, film_bodies(settings=settings), times)
        still = slice(0, result.n_still)
        true = truth.mean_angle_rad - truth.mean_angle_rad[still].mean(axis=0)
        for name, angle, u, flag in [
            ("whippen", result.angle_rad[:, 0], result.u_angle_rad[:, 0], result.flag[:, 0]),
            *((body, *result.relative(body)) for body in ("jack", "repetition")),
        ]:
            error = angle - true[:, truth.bodies.index(name)]
            good = np.isfinite(error)
            z.append(error[good] / u[good])
            doubtful = int(FrameFlag.IMPRECISE | FrameFlag.WIDENED | FrameFlag.COVERED)
            largest = max(largest, float(np.abs(error[good & ((flag & doubtful) == 0)]).max(initial=0.0)))
        total += n
    everything = np.concatenate(z)
    return float(np.mean(np.abs(everything) < 1.96)), float(everything.std()), largest / MDEG, total
