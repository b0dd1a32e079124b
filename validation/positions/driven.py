"""The hammer's position under the measured key: the model, from rest, and what its sensor would read.

In: a stroke, an action and how sensors and angles are tied. Out: the displacement of the hammer's calibrated point, m,
from rest, held at the ends of its ruler as a reading is.
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d

import model
from model.motion_driven.prescribed_key import run_prescribed
from validation.conventions import HAMMER, Array
from validation.positions.measured import Stroke
from validation.positions.parameters import Sensing

TOLERANCE_RAD = 2e-4
"""Requested largest error of an angle. After a release errors grow: at 1e-3 a bounce came out 0.13 rad off."""
SPEED_OVER_S = 5e-3
"""Interval over which the key's speed is judged: noise between two samples is not its speed."""
STEP_M = 3e-4
"""Displacement of the key between the knots of its motion at its fastest; at least two samples apart."""
ORDER = 6


def bowed(u: Array, shape: float) -> Array:
    """``u`` with a bow that leaves 0 and 1 where they are."""
    return np.asarray(u + shape * u * (1.0 - u))


def key_turn(stroke: Stroke, sensing: Sensing, displacement_m: Array | None = None) -> Array:
    """Turn of the key from rest, rad, positive as it is pressed, by the measured displacement or another one."""
    value = stroke.key.value_m if displacement_m is None else displacement_m
    travel = stroke.key.travel_m
    return sensing.key_rad_per_m * (travel * bowed(value / travel, sensing.key_shape) - sensing.key_zero_m)


def key_motion(stroke: Stroke, turn_rad: Array, rest_rad: float) -> model.KeyMotion:
    """The key's motion as a cubic spline through averages as far apart as the stroke is slow."""
    reach = max(round(SPEED_OVER_S / stroke.interval_s), 1)
    fastest = float(np.abs(stroke.key.value_m[reach:] - stroke.key.value_m[:-reach]).max()) / (
        reach * stroke.interval_s
    )
    step = int(np.clip(STEP_M / max(fastest, 1e-9) / stroke.interval_s, 2, 0.005 / stroke.interval_s))
    at = np.arange(0, turn_rad.size, step)
    at[-1] = turn_rad.size - 1
    mean = gaussian_filter1d(turn_rad, 0.4 * step, mode="nearest")
    spline = CubicSpline(stroke.time_s[at], rest_rad - mean[at], bc_type="clamped")
    rows = np.zeros((at.size - 1, ORDER))
    rows[:, 2:] = spline.c.T
    return model.KeyMotion(spline.x, rows)


def hammer_reading(turn_rad: Array, sensing: Sensing, travel_m: float) -> Array:
    """What the hammer's sensor shows of its turn from rest, m, held at the ruler's ends."""
    u = turn_rad * sensing.hammer_m_per_rad / travel_m
    # beyond the ruler the bow goes on as a straight line: a parabola would turn back
    inside = bowed(np.clip(u, 0.0, 1.0), sensing.hammer_shape) + np.where(
        (u < 0.0) | (u > 1.0), u - np.clip(u, 0, 1), 0.0
    )
    return np.asarray(np.clip(travel_m * inside + sensing.hammer_zero_m, 0.0, travel_m))


def predict_hammer(
    action: model.Action, stroke: Stroke, sensing: Sensing, key_rest_rad: float, displacement_m: Array | None = None
) -> Array:
    """Predict the displacement of the hammer's calibrated point.

    Parameters
    ----------
    action : model.Action
        The action that moves.
    stroke : Stroke
        Its key's displacement goes in.
    sensing : Sensing
    key_rest_rad : float
        Angle of the key where its sensor reads zero.
    displacement_m : ndarray, shape (n,), optional
        Another displacement of the key.

    Returns
    -------
    ndarray
        Displacement (n,), m.

    Raises
    ------
    model.ModelError
        The action cannot follow.
    """
    motion = key_motion(stroke, key_turn(stroke, sensing, displacement_m), key_rest_rad)
    run = run_prescribed(action, motion, stroke.time_s, tolerance=TOLERANCE_RAD)
    turn = run.angle_rad[0, HAMMER] - run.angle_rad[:, HAMMER]
    return hammer_reading(turn, sensing, stroke.hammer.travel_m)
