"""Render a small film of the moving bodies, track it, and compare the result with the true angles.

Run:  python examples/track_film.py
"""

import tempfile
from pathlib import Path

import numpy as np

import vision
from rig.simulated import ActionGeometry, CameraSettings, film_bodies, film_trial

geometry, camera = ActionGeometry(), CameraSettings()
times_s = np.arange(120) / camera.frame_rate_hz


def angles(t: np.ndarray) -> np.ndarray:
    """Angles of whippen, jack and repetition lever: at rest for 20 ms, then a smooth rotation."""
    x = np.clip((t - 0.02) / 0.03, 0.0, 1.0)
    s = x * x * (3.0 - 2.0 * x)
    return np.array(geometry.rest_angle_rad) + np.outer(s, [0.05, -0.20, 0.10])


film = Path(tempfile.mkdtemp()) / "film.mraw"
truth = film_trial(film, times_s, angles, geometry, camera, seed=1)
result = vision.track(film, film_bodies(geometry, camera), times_s)

for body in ("jack", "repetition"):
    angle, u, _ = result.relative(body)
    true = truth.mean_angle_rad[:, truth.bodies.index(body)]
    error = angle - (true - true[: result.n_still].mean())
    rms, stated = np.degrees([np.sqrt(np.nanmean(error**2)), np.nanmedian(u)]) * 1e3
    print(f"{body}: turned {np.degrees(np.ptp(true)):.1f} deg, RMS error {rms:.1f} mdeg, stated u {stated:.1f} mdeg")
print("film:", film)
