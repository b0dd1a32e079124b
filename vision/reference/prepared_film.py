"""A film prepared for tracking: reference, templates, occlusion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from vision.bodies.occlusion import Occlusion
from vision.bodies.outlines import Body
from vision.film.source import Corrected, FrameSource
from vision.fitting.template import Template
from vision.reference.rectified_film import RectifiedFilm
from vision.reference.still_average import Reference


@dataclass(frozen=True)
class PreparedFilm:
    """A film ready to be tracked."""

    film: FrameSource
    bodies: Sequence[Body]
    reference: Reference
    templates: list[Template]
    """In the order of the bodies."""
    occlusion: Occlusion
    skips_blocks: bool = False
    """Whether its frames repeat squares of the frame before, as a codec leaves them of which the file says nothing."""
    grey_step: float = 1.0
    """Smallest difference of two grey values around the bodies."""
    delay_frames: float = 0.0
    """Delay of steady motion by the camera's filtering in time, frames."""
    u_field_frames: float = 0.0
    """Standard uncertainty of when the tracked rows of interlaced frames were exposed, frames."""

    @property
    def rectified_film(self) -> RectifiedFilm | None:
        """The resampled film whose frames are tracked; None where they are tracked as they are."""
        film = self.film
        while isinstance(film, Corrected) and not isinstance(film, RectifiedFilm):
            film = film.film
        return film if isinstance(film, RectifiedFilm) else None

    @property
    def parents(self) -> list[int | None]:
        names = [body.name for body in self.bodies]
        return [None if body.parent is None else names.index(body.parent) for body in self.bodies]
