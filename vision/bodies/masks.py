"""Pixel masks of the bodies: inside the outline, without its rim, bodies in front and saturated pixels."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vision.bodies.outlines import Body, check_bodies, signed_distance
from vision.errors import BodyError
from vision.film.source import SATURATED_SHARE
from vision.item_map import ItemMap, serial_map

CLEARANCE_PX = (
    4.0  # from an outline that is not used, inside and of bodies in front: edge pixels mix what lies beside it
)
SATURATED_REACH_PX = 2  # around a saturated area: choice: its light spills over
MIN_PIXELS = 100  # below this a five-parameter fit is not worth starting


def build_masks(bodies: Sequence[Body], height: int, width: int) -> list[NDArray[np.bool_]]:
    """Masks (height, width), in the order of the bodies, of the pixels that may be used: more than 4 px inside the
    outline and outside that of every other body of the same or a higher layer; `BodyError` where fewer than 100 are
    left of a body.

    Parameters
    ----------
    bodies : sequence of Body
    height, width : int
        Of the picture, px.

    Returns
    -------
    list of ndarray of bool, shape (height, width)
        In the order of ``bodies``.

    Raises
    ------
    BodyError
        When fewer than `MIN_PIXELS` are left of a body.

    Examples
    --------
    >>> import vision
    >>> masks = vision.build_masks(vision.load_bodies("bodies.toml"), 212, 280)
    >>> len(masks), masks[0].shape
    (3, (212, 280))
    """
    return masks_from_distances(bodies, outline_distances(bodies, height, width))


def outline_distances(
    bodies: Sequence[Body], height: int, width: int, map_items: ItemMap = serial_map
) -> list[NDArray[np.float32]]:
    """`signed_distance` from each body's outline; raises `BodyError` for bodies that do not fit together."""
    check_bodies(bodies)
    return map_items(lambda body: signed_distance(body.polygon_px, height, width), bodies)


def masks_from_distances(bodies: Sequence[Body], distances: Sequence[NDArray[np.float32]]) -> list[NDArray[np.bool_]]:
    """Masks (height, width) of each body's usable pixels, as `build_masks` has them, from the `signed_distance`
    (height, width) of every outline, px, positive inside; `BodyError` where too few are left."""
    height, width = distances[0].shape
    masks = []
    for i, body in enumerate(bodies):
        mask = distances[i] > CLEARANCE_PX
        for j, other in enumerate(bodies):
            if j != i and other.layer >= body.layer:
                mask &= distances[j] < -CLEARANCE_PX
        found = int(np.count_nonzero(mask))
        if found < MIN_PIXELS:
            raise BodyError(
                f"body {body.name}: {found} usable pixels in the {width} x {height} picture, at least {MIN_PIXELS} "
                f"needed after {CLEARANCE_PX:g} px of rim and the bodies in front; draw it larger or set its layer"
            )
        masks.append(mask)
    return masks


def exclude_saturated(
    bodies: Sequence[Body], masks: Sequence[NDArray[np.bool_]], saturated: NDArray[np.bool_]
) -> list[NDArray[np.bool_]]:
    """Masks less ``saturated`` pixels (height, width) and those within two pixels of them, for bodies of which more
    than `SATURATED_SHARE` are saturated; the other masks as given; `BodyError` where fewer than 100 pixels are left of
    a body."""
    if not saturated.any():
        return list(masks)
    # start-up: OpenCV costs 0.12 s, outlines and masks do without
    import cv2

    near = cv2.dilate(saturated.astype(np.uint8), np.ones((2 * SATURATED_REACH_PX + 1,) * 2, np.uint8)) > 0
    many = [np.count_nonzero(mask & saturated) > SATURATED_SHARE * np.count_nonzero(mask) for mask in masks]
    left = [mask & ~near if much else mask for mask, much in zip(masks, many, strict=True)]
    for body, mask, whole in zip(bodies, left, masks, strict=True):
        if (found := int(np.count_nonzero(mask))) < MIN_PIXELS:
            raise BodyError(
                f"body {body.name}: {found} of {int(np.count_nonzero(whole))} pixels are not saturated, at least "
                f"{MIN_PIXELS} needed; film with less light or a shorter exposure"
            )
    return left
