"""Which profiles are curved: whose interval the linear model would not give."""

from __future__ import annotations

from collections.abc import Sequence

from validation.conventions import Array
from validation.identification.profiles import Profile

LOPSIDED = 0.1  # of the interval's width: how far its middle may be from the most probable value
OFF = 0.2  # of the linear model's interval: how much narrower or wider the profile's may be


def curved(profiles: Sequence[Profile], z: Array, half: Array) -> list[str]:
    """Names of parameters whose profile is curved.

    Parameters
    ----------
    profiles : those that were made
    z : (n,) most probable values, of the same parameters
    half : (n,) half widths of the linear model's 95 % intervals
    """
    found = []
    for p, at, width in zip(profiles, z, half, strict=True):
        below, above = float(at) - p.low, p.high - float(at)
        whole = below + above
        if abs(above - below) > LOPSIDED * whole or abs(0.5 * whole - width) > OFF * width:
            found.append(p.name)
    return found
