"""Two reading heads on the key's scale, opposite each other: its rotation and its lift.

Head one reads the rotation plus lift over radius, head two minus; the error of a scale off its centre changes its sign
as well. The shift of the pivot in its bushing moves the centre, too, and goes with the lift.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from rig.session import TrialData
from rig.session.channel_info import KEY_OPPOSITE
from validation.conventions import Array
from validation.measurement.force_correction import Quiet


@dataclass(frozen=True)
class KeyHeads:
    """What both heads say of the key.

    Attributes
    ----------
    rotation_rad : (n,) rotation since the first sample
    lift_m : (n,) height of the pivot above that of the first sample
    u_lift_m : standard uncertainty of one value of the lift, without that of the radius
    u_radius_relative : of the lift, from the scale's radius
    resolution_rad, u_change_rad, u_turn_relative : of the rotation, as of a single encoder
    """

    rotation_rad: Array
    lift_m: Array
    u_lift_m: float
    u_radius_relative: float
    resolution_rad: float
    u_change_rad: float
    u_turn_relative: float

    def note(self, quiet: Quiet) -> str:
        """What to say of the lift, in one line."""
        rest = float(np.mean(self.lift_m[: max(quiet.stop, 1)]))
        largest = float(np.max(self.lift_m) - rest)
        u = float(np.hypot(self.u_lift_m, largest * self.u_radius_relative))
        said = f"lifts by up to {1e3 * largest:.3f} mm (u {1e3 * u:.3f} mm)" if largest > 3 * u else "does not lift"
        return f"key read by two heads: rotation without lift and eccentricity; its pivot {said}"


def two_heads(data: TrialData, key_rad: Array) -> KeyHeads | None:
    """Join both heads of a trial; None where it has one.

    Parameters
    ----------
    key_rad : (n,) angle of the first head since the first sample
    """
    names = [channel.name for channel in data.channels]
    if KEY_OPPOSITE not in names or data.channel_values is None:
        return None
    channel = data.channels[names.index(KEY_OPPOSITE)]
    other = np.asarray(data.channel_values[:, names.index(KEY_OPPOSITE)], dtype=float)
    key = next(encoder for encoder in data.encoders if encoder.name == "key")
    radius, u_radius = (float(found) for found in re.findall(r"([\d.eE+-]+) m\b", channel.sensor)[:2])
    first, second = key_rad - key_rad[0], other - other[0]
    step = abs(key.rad_per_count) / np.sqrt(12.0)
    head = np.hypot(step, np.sqrt(2.0) * key.u_interpolation_rad)
    return KeyHeads(
        rotation_rad=0.5 * (first + second),
        lift_m=0.5 * (first - second) * radius,
        # the shift of the pivot is no lift of the key, but cannot be told from one; nor can the scale's centre
        u_lift_m=float(radius * np.sqrt(0.5 * head**2 + key.u_pivot_shift_rad**2)),
        u_radius_relative=u_radius / radius,
        resolution_rad=abs(key.rad_per_count) / np.sqrt(2.0),
        u_change_rad=float(key.u_interpolation_rad),
        u_turn_relative=key.u_scale_relative,
    )
