"""Animated attributes of an SVG drawing, all with the same frames."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

FRAME_S = 0.04  # of the viewer's time between two rows


def values_text(values: Array, digits: int = 2) -> str:
    """A list of numbers of an animated attribute, one per frame."""
    return ";".join(f"{v:.{digits}f}".rstrip("0").rstrip(".") for v in values)


class Clock:
    """Writes animated attributes that share the same frames."""

    def __init__(self, frames: int) -> None:
        self.end = f'dur="{(frames - 1) * FRAME_S:g}s" repeatCount="indefinite"'

    def attribute(self, name: str, values: str) -> str:
        """An attribute that takes one of ``values``, joined by semicolons, in each frame."""
        return f'<animate attributeName="{name}" values="{values}" {self.end}/>'

    def transform(self, kind: str, values: str) -> str:
        """A transformation of some kind, with values as for `attribute`."""
        return f'<animateTransform attributeName="transform" type="{kind}" values="{values}" {self.end}/>'
