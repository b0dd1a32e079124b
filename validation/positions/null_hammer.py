"""The null model under a measured key: a hammer that rides on one static path, flies, is caught and comes back.

The rules are those of `model.null_model` with the key's motion given instead of the force: the hammer rides with the
joined path up to let-off or until it would have to be pulled, flies under gravity alone, rebounds from the string by
the restitution of its felt, is caught where the back check or the repetition lever meets it, and rides again once the
jack is back under it. Nothing in it is fitted to the action; sensors are tied to it as to the full model.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

import model
from validation.conventions import HAMMER, Array
from validation.positions.driven import hammer_reading, key_motion, key_turn
from validation.positions.measured import Stroke
from validation.positions.parameters import Sensing

STEP_S = 2.5e-4


@dataclass(frozen=True)
class NullAction:
    """What the null model knows of an action."""

    reduced: model.null_model.Reduced
    weight_nm_at: tuple[float, float]
    damping: float
    reach_m: float

    @classmethod
    def of(cls, action: model.Action) -> NullAction:
        """Reduce an action."""
        weight = action["hammer.mass"] * action["gravity.g"]
        centre = (weight * action["hammer.center_of_mass.x"], weight * action["hammer.center_of_mass.y"])
        reach = math.hypot(action["contact12.first.x"], action["contact12.first.y"])
        return cls(model.null_model.reduce_action(action), centre, action["contact12.normal.D"], reach)

    def fall(self, phi: float) -> float:
        """Angular acceleration of a free hammer towards the string, rad/s^2, at ``phi`` above its rest."""
        r = self.reduced
        angle = float(r.rest_rad[HAMMER]) + r.up * phi
        x, y = self.weight_nm_at
        return -r.up * (math.cos(angle) * x - math.sin(angle) * y) / r.hammer_inertia


def predict_null(null: NullAction, stroke: Stroke, sensing: Sensing, displacement_m: Array | None = None) -> Array:
    """Predict the displacement of the hammer's calibrated point by the null model.

    Parameters
    ----------
    null : NullAction
    stroke : Stroke
        Its key's displacement goes in.
    sensing : Sensing
    displacement_m : ndarray, shape (n,), optional
        Another displacement of the key.

    Returns
    -------
    ndarray
        Displacement (n,), m.
    """
    motion = key_motion(stroke, key_turn(stroke, sensing, displacement_m), 0.0)
    time_s = np.arange(stroke.time_s[0], stroke.time_s[-1], STEP_S)
    state = motion.at(np.minimum(time_s, motion.break_s[-1]))
    phi = _march(null, -state[:, 0], -state[:, 1])
    return hammer_reading(np.interp(stroke.time_s, time_s, phi), sensing, stroke.hammer.travel_m)


def _march(null: NullAction, s: Array, w: Array) -> Array:
    """Turn of the hammer above its rest (m,) for places and speeds of the key (m,), even in time."""
    r = null.reduced
    joined = r.up * (np.interp(s, r.sigma, r.joined.angle_rad[:, HAMMER]) - float(r.rest_rad[HAMMER]))
    speed = r.up * np.interp(s, r.sigma, r.joined.ratio[:, HAMMER]) * w
    open_at = np.where(np.isfinite(r.check_rad), r.check_rad, -1e9)
    caught_at = open_at[np.clip(np.searchsorted(r.sigma, s), 0, r.sigma.size - 1)]
    out = np.empty(s.size)
    phi, omega, riding, held, jack_out = float(joined[0]), 0.0, True, False, False
    for k in range(s.size):
        path, along = float(joined[k]), float(speed[k])
        if s[k] >= r.let_off:
            jack_out, riding = True, False
        elif jack_out:
            jack_out, held = False, False
        if riding and (along - omega) / STEP_S >= null.fall(phi):
            phi, omega = path, along
        elif not held:
            riding = False
            turn, above = null.fall(phi), phi
            phi += STEP_S * (omega + 0.5 * STEP_S * turn)
            omega += STEP_S * turn
            if jack_out and omega < 0.0 and phi <= caught_at[k] <= above:
                phi, omega, held = float(caught_at[k]), 0.0, True
        if not riding and phi <= path:
            phi = path
            if jack_out:
                omega, held = max(omega, 0.0), omega <= 0.0
            elif omega <= along:
                omega, riding, held = along, True, False
        if phi >= r.string_rad and omega > 0.0:
            omega *= -model.null_model.restitution(omega * null.reach_m, null.damping)
            phi, riding = r.string_rad, False
        out[k] = phi
    return out
