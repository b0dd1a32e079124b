"""One colour for each body in every picture; `model.inside` and the docs have the same for the five of an action."""

from __future__ import annotations

from vision.tabular import BODY_COLORS as BODY_COLOURS

OTHERS = ("#56B4E9", "#E69F00", "#CC79A7", "#F0E442", "#8FBF3F")
"""For bodies of other names, in their order."""
LOST = "#FF3C3C"


def body_colour(name: str, index: int) -> str:
    return BODY_COLOURS.get(name) or OTHERS[index % len(OTHERS)]


def to_bgr(colour: str) -> tuple[int, int, int]:
    """``#RRGGBB`` in the order of OpenCV."""
    red, green, blue = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
    return blue, green, red
