"""What comes before tracking: still frames, averaged reference, templates.

Place in the data flow: `track_film`, `predict_uncertainty` and `retrack_frames` start with `prepare`; one
preparation serves both the uncertainty shown before tracking and the tracking itself.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vision.bodies.outlines import Body, build_masks
from vision.errors import VisionWarning
from vision.film.source import FrameSource, open_film
from vision.fitting.pose_covariance import predicted_u_angle
from vision.fitting.template import Template, build_template
from vision.tracking.frame_step import Run, first_poses
from vision.tracking.still_average import Reference, average_still_frames
from vision.tracking.stillness import still_count

WANTED_STILL = 10
FIRST_LOOK = 4
"""Frames averaged for the first template, with which the still frames are counted."""
MAX_PIXELS = 12_000
"""Pixels fitted per body; beyond this the ones that tell least about the angle are left out."""


@dataclass(frozen=True)
class Preparation:
    """A film ready to be tracked.

    Attributes
    ----------
    film : FrameSource
    bodies : sequence of Body
    reference : Reference
    templates : list of Template
        In the order of the bodies.
    method : {"icgn", "ecc"}
    """

    film: FrameSource
    bodies: Sequence[Body]
    reference: Reference
    templates: list[Template]
    method: str

    def run(self) -> Run:
        """All bodies at their places in the reference, to be followed through the film."""
        return Run(self.film, self.bodies, self.templates, self.method)


def prepare(
    film: FrameSource,
    bodies: Sequence[Body],
    n_still: int | None = None,
    max_pixels: int | None = MAX_PIXELS,
    method: str = "icgn",
) -> Preparation:
    """Average the still frames and build the bodies' templates.

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
        pose, u = first_poses(Run(film, bodies, templates_of(first), method), candidates)
        n_still = still_count(pose.reshape(candidates, -1), u.reshape(candidates, -1))
        if n_still < WANTED_STILL:
            warnings.warn(
                f"{film.path}: only {n_still} still frames at the start, {WANTED_STILL} wanted; the zero is less sure",
                VisionWarning,
                stacklevel=3,
            )
    reference = average_still_frames(film, region, n_still)
    return Preparation(film, bodies, reference, templates_of(reference), method)


def predict_uncertainty(
    path_or_source: str | os.PathLike[str] | FrameSource,
    bodies: Sequence[Body],
    *,
    n_still: int | None = None,
) -> dict[str, float]:
    """Standard uncertainty of each body's angle from noise and reference, rad, before the film is tracked.

    `vision.tracking.budget_terms.expected_budget` gives the other terms as well.
    """
    if isinstance(path_or_source, str | os.PathLike):
        with open_film(path_or_source) as film:
            return predict_uncertainty(film, bodies, n_still=n_still)
    ready = prepare(path_or_source, bodies, n_still)
    return {template.name: predicted_u_angle(template, ready.reference.noise_grey) for template in ready.templates}
