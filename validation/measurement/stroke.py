"""The motion of one keystroke in the form the event finders read: one object for a trial, one for its prediction.

Conventions: absolute angles in rad, counter-clockwise; lengths in m; the random part of an uncertainty
(sample to sample) is stated apart from the part common to the whole trial (where zero was).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from validation.conventions import HAMMER, KEY, WHIPPEN, Array
from validation.measurement.geometry import ActionGeometry


@dataclass(frozen=True)
class Motion:
    """Key dip and hammer height over time, with their standard uncertainties.

    Parameters
    ----------
    time_s : (n,) array
    key_dip_m, hammer_height_m : (n,) arrays
        Height is 0 at the string and positive below it.
    hammer_way_m : (n,) array
        Hammer angle from the string times the head's lever there; equals the height close to the string.
    u_dip_m, u_height_m : float
        Standard uncertainty of one sample relative to its neighbours.
    u_dip_still_m, u_height_still_m : float
        Standard uncertainty of a mean over samples while nothing moves, as at rest or in check: an encoder that stands
        still repeats the same rounding error.
    u_dip_zero_m, u_height_zero_m : float
        Standard uncertainty common to all samples of the trial: the level of the rest position, and what the encoder's
        scale makes of the way from rest to the string or the key bottom.
    u_speed_relative : float
        Relative standard uncertainty of a hammer speed from the encoder's scale.
    rest_height_m, key_touch_dip_m : float
    """

    time_s: Array
    key_dip_m: Array
    hammer_height_m: Array
    hammer_way_m: Array
    u_dip_m: float
    u_height_m: float
    u_dip_still_m: float
    u_height_still_m: float
    u_dip_zero_m: float
    u_height_zero_m: float
    u_speed_relative: float
    rest_height_m: float
    key_touch_dip_m: float

    def own_u_height_m(self) -> float:
        """Standard uncertainty of the height of one sample against where the hammer itself rested, m."""
        return float(np.hypot(self.u_height_m, self.u_height_still_m))

    def own_u_dip_m(self) -> float:
        """Standard uncertainty of the dip of one sample against where the key itself rested, m."""
        return float(np.hypot(self.u_dip_m, self.u_dip_still_m))

    def level_u_dip_m(self) -> float:
        """Standard uncertainty of the dip of one sample against a fixed level, m."""
        return float(np.hypot(self.u_dip_m, self.u_dip_zero_m))


def motion_of(
    geometry: ActionGeometry,
    time_s: Array,
    change_rad: Array,
    u_sample_rad: Array,
    *,
    u_zero_rad: Array | None = None,
    u_height_zero_m: float = 0.0,
    u_dip_zero_m: float = 0.0,
    u_scale_relative: Array | None = None,
) -> Motion:
    """Build a `Motion` from changes of the key, whippen and hammer angle since rest.

    Parameters
    ----------
    geometry : ActionGeometry
    time_s : (n,) array
    change_rad : (n, 3) array
        Key, whippen, hammer; 0 at rest.
    u_sample_rad : (3,) array
        Standard uncertainty of one angle sample against its neighbours.
    u_zero_rad : (3,) array, optional
        Standard uncertainty of the zero of each angle.
    u_height_zero_m, u_dip_zero_m : float
        Standard uncertainty of the hammer height and the key dip at rest.
    u_scale_relative : (3,) array, optional
        Relative standard uncertainty of the scales of key, whippen and hammer encoder.
    """
    change = np.asarray(change_rad, dtype=float)
    angle = geometry.absolute({KEY: change[:, 0], WHIPPEN: change[:, 1], HAMMER: change[:, 2]})
    scale = np.zeros(3) if u_scale_relative is None else np.asarray(u_scale_relative, dtype=float)
    zero = np.zeros(3) if u_zero_rad is None else np.asarray(u_zero_rad, dtype=float)
    per_hammer = geometry.sensitivity(geometry.hammer_height_m, HAMMER)
    per_key = geometry.sensitivity(geometry.key_dip_m, KEY)
    return Motion(
        time_s=np.asarray(time_s, dtype=float),
        key_dip_m=geometry.key_dip_m(angle),
        hammer_height_m=geometry.hammer_height_m(angle),
        hammer_way_m=(angle[:, HAMMER] - geometry.string_angle_rad) * geometry.string_lever_m,
        u_dip_m=per_key * float(u_sample_rad[0]),
        u_height_m=per_hammer * float(u_sample_rad[2]),
        u_dip_still_m=per_key * float(zero[0]),
        u_height_still_m=per_hammer * float(zero[2]),
        u_dip_zero_m=float(np.hypot(u_dip_zero_m, np.hypot(scale[0] * geometry.key_touch_dip_m, per_key * zero[0]))),
        u_height_zero_m=float(
            np.hypot(u_height_zero_m, np.hypot(scale[2] * geometry.rest_height_m, per_hammer * zero[2]))
        ),
        u_speed_relative=float(scale[2]),
        rest_height_m=geometry.rest_height_m,
        key_touch_dip_m=geometry.key_touch_dip_m,
    )
