"""Where the action touches: hammer height, key dip and the levels at which events happen, for model and trial alike.

Conventions: SI, absolute angles counter-clockwise; the hammer height is the distance from the highest point
of the hammer head to the string line, 0 at contact and positive below it; the key dip is the downward travel
of the key front.
Source: Hirschkorn (2004), Appendix A for the geometry and Section 2.3 for height and dip as technicians
measure them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.optimize import brentq

import model
from validation.conventions import HAMMER, KEY, WHIPPEN, Array
from validation.errors import ValidationInputError

STEP_RAD = 5e-4  # of the search for a touch, from rest on
TURNS_RAD = (0.2, 0.8)  # of key and hammer that are searched: four times a dip, twice the way to the string


@dataclass(frozen=True)
class ActionGeometry:
    """Geometry of an action for the event finders.

    Parameters
    ----------
    rest_angle_rad : (5,) array
        Absolute angles at rest: key, whippen, jack, repetition, hammer.
    hammer_height_m, key_dip_m : callable
        Map absolute angles (n, 5) to metres (n,).
    key_touch_dip_m : float
        Key dip at which the key front first touches its felt.
    """

    rest_angle_rad: Array
    hammer_height_m: Callable[[Array], Array]
    key_dip_m: Callable[[Array], Array]
    key_touch_dip_m: float

    @cached_property
    def string_angle_rad(self) -> float:
        """Absolute hammer angle, rad, at which the head first touches the string on the way up from rest, the other
        bodies staying at rest; raises an input error where it touches at rest or not within 0.8 rad."""
        turn = np.linspace(0.0, -TURNS_RAD[1], round(TURNS_RAD[1] / STEP_RAD) + 1)
        height = self.hammer_height_m(self.absolute({HAMMER: turn}))
        above = np.flatnonzero(height <= 0)
        if above.size == 0 or above[0] == 0:
            raise ValidationInputError(
                f"action: hammer height is {1e3 * height[0]:.2f} mm at rest and stays above 0 for 0.8 rad; "
                "check the string contact and the rest state"
            )
        touch = brentq(
            lambda x: float(self.hammer_height_m(self.absolute({HAMMER: np.array([x])}))[0]),
            turn[above[0] - 1],
            turn[above[0]],
            xtol=1e-15,
        )
        return float(self.rest_angle_rad[HAMMER] + touch)

    @cached_property
    def string_lever_m(self) -> float:
        """Change of hammer height per angle at the string, m/rad, positive."""
        angle = self.rest_angle_rad.copy()
        angle[HAMMER] = self.string_angle_rad
        return self.sensitivity(self.hammer_height_m, HAMMER, angle)

    @property
    def rest_height_m(self) -> float:
        """Hammer height at rest, m."""
        return float(self.hammer_height_m(self.rest_angle_rad[None, :])[0])

    def absolute(self, change_rad: dict[int, Array]) -> Array:
        """Absolute angles (n, 5), rad, from changes since rest (n,), rad, by index of the body; the other bodies stay
        at rest."""
        n = len(next(iter(change_rad.values())))
        angle = np.tile(self.rest_angle_rad, (n, 1))
        for body, change in change_rad.items():
            angle[:, body] += change
        return angle

    def sensitivity(self, function: Callable[[Array], Array], body: int, angle_rad: Array | None = None) -> float:
        """Magnitude of the derivative of a ``function`` (from absolute angles (n, 5) to metres (n,)) by the angle of
        the body with index ``body``, m/rad, at the angles ``angle_rad`` (5,), rest if None."""
        centre = self.rest_angle_rad if angle_rad is None else np.asarray(angle_rad, dtype=float)
        step = 1e-5  # rad, of a central difference: exact to 1e-10, far above rounding
        pair = np.tile(centre, (2, 1))
        pair[0, body] -= step
        pair[1, body] += step
        low, high = function(pair)
        return float(abs(high - low) / (2 * step))


def geometry_of(action: model.Action, rest_angle_rad: Array) -> ActionGeometry:
    """Geometry of an action for the event finders: hammer height and key dip, m, as functions of the angles (n, 5), and
    the dip at touch; ``rest_angle_rad``: (5,), under the load that the trials start from."""
    rest = np.asarray(rest_angle_rad, dtype=float)

    def height(angle: Array) -> Array:
        return np.asarray(model.observables.hammer_height_m(action, angle), dtype=float)

    def dip(angle: Array) -> Array:
        return np.asarray(model.observables.key_dip_m(action, angle, rest), dtype=float)

    def key_gap(angle: Array) -> Array:
        return np.asarray(model.observables.key_front_gap_m(action, angle), dtype=float)

    return ActionGeometry(rest, height, dip, touch_dip(rest, dip, key_gap))


def touch_dip(rest_rad: Array, dip: Callable[[Array], Array], key_gap: Callable[[Array], Array]) -> float:
    """Key dip, m, at which the gap under the key front closes when the key alone turns from rest (5,), rad; ``dip`` and
    ``key_gap`` return metres (n,) for absolute angles (n, 5). Raises an input error where it does not close within 0.2
    rad."""
    turn = np.linspace(0.0, -TURNS_RAD[0], round(TURNS_RAD[0] / STEP_RAD) + 1)
    angle = np.tile(rest_rad, (turn.size, 1))
    angle[:, KEY] += turn
    gap = key_gap(angle)
    closed = np.flatnonzero(gap <= 0)
    if closed.size == 0 or closed[0] == 0:
        raise ValidationInputError(
            f"action: gap under the key front is {1e3 * gap[0]:.2f} mm at rest and {1e3 * gap[-1]:.2f} mm "
            "after 0.2 rad; it must start above 0 and close; check the key front contact"
        )
    i = int(closed[0])
    share = gap[i - 1] / (gap[i - 1] - gap[i])
    travel = dip(angle[i - 1 : i + 1])
    return float(travel[0] + share * (travel[1] - travel[0]))


@dataclass(frozen=True)
class Motion:
    """Key dip and hammer height over time, with their standard uncertainties.

    Conventions: absolute angles in rad, counter-clockwise; lengths in m; the random part of an uncertainty (sample to
    sample) is stated apart from the part common to the whole trial (where zero was).

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
    """Key dip, hammer height and way over ``time_s`` (n,) from changes since rest (n, 3), rad, of key, whippen, hammer,
    with uncertainties from those (3,) of a sample, zero and scale, and of the levels at rest (``u_height_zero_m``,
    ``u_dip_zero_m``).

    Parameters
    ----------
    time_s : (n,)
    change_rad : (n, 3), key, whippen, hammer; 0 at rest
    u_sample_rad : (3,), standard uncertainty of one angle sample against its neighbours
    u_zero_rad : (3,) array, optional, standard uncertainty of the zero of each angle
    u_height_zero_m, u_dip_zero_m : standard uncertainty of the hammer height and the key dip at rest
    u_scale_relative : (3,) array, optional, relative standard uncertainty of the scales of key, whippen and hammer
        encoder
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
