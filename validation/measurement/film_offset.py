"""How far the film's clock is off an encoder on the same body: two measurements of one motion, compared."""

from __future__ import annotations

import vision
from rig.session import Trial


def clock_offsets(trial: Trial, tracked: vision.TrackResult) -> dict[str, tuple[float, float]]:
    """Offset, s, to add to the film's times so that they fit the encoder's, and its standard uncertainty, by name of
    each body that film and encoder both see; bodies that hardly move are left out. Nothing is changed."""
    data = trial.read()
    angles = data.angle_rad
    offsets = {}
    for i, encoder in enumerate(data.encoders):
        if encoder.name not in tracked.bodies:
            continue
        body = tracked.column(encoder.name)
        try:
            found = vision.estimate_offset(
                tracked.time_s, tracked.angle_rad[:, body], tracked.u_angle_rad[:, body], data.time_s, angles[:, i]
            )
        except vision.InputError:
            continue
        offsets[encoder.name] = (found.offset_s, found.u_offset_s)
    return offsets
