"""What comes before tracking: still frames, averaged reference, templates, and the uncertainty to expect.

Place in the data flow: `track_film` starts with `prepare`; `predict_uncertainty` tells the user, before any
tracking, what the drawn outlines will give.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Sequence

import numpy as np

from vision.bodies import Body, build_masks
from vision.errors import VisionWarning
from vision.frames import FrameSource, open_film
from vision.reference import Reference, average_still_frames
from vision.run import Run, first_poses
from vision.stillness import still_count
from vision.template import Template, build_template
from vision.uncertainty import predicted_u_angle

WANTED_STILL = 10
FIRST_LOOK = 4
"""Frames averaged for the first template, with which the still frames are counted."""
MAX_PIXELS = 12_000
"""Pixels fitted per body; beyond this the ones that tell least about the angle are left out."""


def prepare(
    film: FrameSource,
    bodies: Sequence[Body],
    n_still: int | None = None,
    max_pixels: int | None = MAX_PIXELS,
    method: str = "icgn",
) -> tuple[Reference, list[Template]]:
    """Average the still frames and build the bodies' templates; shared by tracking and prediction.

    Warns
    -----
    VisionWarning
        When fewer than ten still frames are found.
    """
    masks = build_masks(bodies, film.height, film.width)
    region = np.logical_or.reduce(masks)

    def templates_of(reference: Reference) -> list[Template]:
        return [
            build_template(body.name, reference.picture, mask, reference.n_averaged, max_pixels, reference.noise_grey)
            for body, mask in zip(bodies, masks, strict=True)
        ]

    if n_still is None:
        candidates = average_still_frames(film, region).n_averaged
        first = average_still_frames(film, region, min(FIRST_LOOK, candidates))
        phi, u = first_poses(Run(film, bodies, templates_of(first), method), candidates)
        n_still = still_count(phi.reshape(candidates, -1), u.reshape(candidates, -1))
        if n_still < WANTED_STILL:
            warnings.warn(
                f"{film.path}: only {n_still} still frames at the start, {WANTED_STILL} wanted; the zero is less sure",
                VisionWarning,
                stacklevel=3,
            )
    reference = average_still_frames(film, region, n_still)
    return reference, templates_of(reference)


def predict_uncertainty(
    path_or_source: str | os.PathLike[str] | FrameSource,
    bodies: Sequence[Body],
    *,
    n_still: int | None = None,
) -> dict[str, float]:
    """Standard uncertainty of each body's angle, rad, to expect before the film is tracked."""
    if isinstance(path_or_source, str | os.PathLike):
        with open_film(path_or_source) as film:
            return predict_uncertainty(film, bodies, n_still=n_still)
    reference, templates = prepare(path_or_source, bodies, n_still)
    return {template.name: predicted_u_angle(template, reference.noise_grey) for template in templates}
