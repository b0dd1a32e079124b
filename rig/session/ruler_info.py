"""What is known of a position sensor's calibration: which point of which body, where the sensor looks, ruler points.

The place at which the sensor looks and the point that was calibrated are two things: a sensor at the back of a key may
be calibrated by a ruler at its front. The displacement is always that of the calibrated point.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class RulerInfo:
    """Ruler points of a position sensor.

    Attributes
    ----------
    body : str
        The body whose displacement it is.
    sensor_at : str
        Where the sensor looks.
    calibrated_at : str
        The point whose displacement the ruler gave; positive as the key is pressed.
    reading : tuple of float
        Readings at the points, in the unit of the channel.
    displacement_m : tuple of float
        Displacement at the points, m, rising.
    u_displacement_m : float
        Standard uncertainty of a reading of the ruler, m.
    u_reading : float
        Standard uncertainty of ``reading`` (rounding and drift), in the unit of the channel.
    """

    body: str
    sensor_at: str
    calibrated_at: str
    reading: tuple[float, ...]
    displacement_m: tuple[float, ...]
    u_displacement_m: float = 0.0
    u_reading: float = 0.0

    @classmethod
    def from_plain(cls, plain: dict[str, Any]) -> RulerInfo:
        """Restore it from JSON, which has lists for tuples."""
        return cls(**{**plain, **{key: tuple(plain[key]) for key in ("reading", "displacement_m")}})
