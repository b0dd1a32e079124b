"""The action drawn from the model's own geometry, moving: shapes of the bodies, their poses, forces at the contacts.

Lengths in m, x right, y up.
"""

from __future__ import annotations

import base64
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

import model
from model.inside.body_poses import SeenMotion
from model.inside.side_view import GROUND, side_view
from vision.output.colours import body_colour


def pack(values: ArrayLike) -> dict[str, Any]:
    """``{"f32": base64, "shape": [...]}``; NaN stays NaN. A 32-bit number keeps seven digits, for drawing."""
    array = np.ascontiguousarray(values, dtype="<f4")
    return {"f32": base64.b64encode(array.tobytes()).decode("ascii"), "shape": list(array.shape)}


def unpack(packed: dict[str, Any]) -> NDArray[np.float32]:
    return np.frombuffer(base64.b64decode(packed["f32"]), dtype="<f4").reshape(packed["shape"])


Array = NDArray[np.float64]
RATE_HZ = 1000.0  # poses a second: choice, for slow motion
MOST_ROWS = 4000  # poses of a drawing: 4 s, 0.5 MB


def drawing_times(start_s: float, end_s: float) -> Array:
    """Times of the poses, 1 kHz, further apart in records of more than four seconds."""
    return model.output_times(start_s, end_s, min(RATE_HZ, MOST_ROWS / max(end_s - start_s, 1e-3)))


def moving_action(
    motion: SeenMotion, measured: Array | None = None, labels: Sequence[str] | None = None
) -> dict[str, Any]:
    """Drawing of a motion for the page: shapes, poses, contact points and forces, as packed float32 (`pack`);
    ``measured`` (m, n, 3): pivot x, y, m, and angle, rad, of each body beside it, NaN where not measured; ``labels``:
    of the contacts."""
    view = side_view(motion)
    bodies = [
        {
            "name": body,
            "color": body_colour(body, i),
            "surfaces": [shape.points.tolist() for shape in view.surfaces[body]],
            "sticks": view.sticks[body].tolist(),
        }
        for i, body in enumerate(motion.bodies)
    ]
    return {
        "time_s": pack(motion.time_s),
        "bodies": bodies,
        "ground": [shape.points.tolist() for shape in view.surfaces[GROUND]],
        "pose": pack(motion.pose),
        "measured": None if measured is None else pack(measured),
        "contacts": list(motion.contacts),
        "labels": list(labels or motion.contacts),
        "point_m": pack(motion.point_m),
        "normal_n": pack(motion.normal_n),
    }


def measured_poses(scene: model.Scene, angle_rad: Array, instead_rad: Array) -> Array:
    """Pivot x, y (m) and orientation (rad) of every body at measured angles: (m, n, 3), NaN where not measured; those
    bodies carry others at ``instead_rad``."""
    known = np.isfinite(angle_rad)
    still = np.zeros_like(angle_rad)
    found = model.inside.Observer(scene).evaluate(np.where(known, angle_rad, instead_rad), still, still[:, 0])
    return np.where(known[:, :, None], found.poses(), np.nan)
