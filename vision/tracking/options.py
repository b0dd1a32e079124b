"""Options of tracking: as keywords for the user, as one frozen record inside."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypedDict

import numpy as np

from vision.camera.model import AssumedCamera, CameraModel
from vision.errors import VisionInputError
from vision.reference.rectified_film import ASPECTS
from vision.uncertainty.budget import ErrorBudget

CONFIRM = ("doubtful", "all", "none")
MOST_THREADS = 64  # that may be asked for: a typing error is larger
FIRST_FIELDS = ("even", "odd", "none")
"""Rows that interlaced frames begin with; none where all rows of a frame are of one time."""
MAX_PIXELS = 12_000  # pixels fitted per body; beyond this the ones that tell least about the angle are left out


class FitOptions(TypedDict, total=False):
    """Keywords of `retrack_frames`, described in `track`."""

    frame_rate_hz: float | None
    first_frame: int
    last_frame: int | None
    n_still: int | None
    max_pixels: int | None
    camera: CameraModel | None
    u_time_s: float
    rows_per_s: float | None
    pixel_aspect: float | None
    deinterlace: bool
    first_field: str | None


class TrackOptions(FitOptions, total=False):
    """Keywords of `track`, described there."""

    every: int
    confirm: str
    threads: int | None
    checkpoint: str | os.PathLike[str] | None
    expected: Callable[[ErrorBudget], None] | None
    progress: Callable[[int, int], None] | None


def check_count(name: str, value: object) -> None:
    """Refuse what is no whole number of at least 1."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < 1:
        raise VisionInputError(f"{name} = {value!r}; needs a whole number of at least 1")


@dataclass(frozen=True)
class FitSettings:
    frame_rate_hz: float | None = None
    first_frame: int = 0
    last_frame: int | None = None
    n_still: int | None = None
    max_pixels: int | None = MAX_PIXELS
    camera: CameraModel | None = None
    u_time_s: float = 0.0
    rows_per_s: float | None = None
    pixel_aspect: float | None = None
    deinterlace: bool = False
    first_field: str | None = None

    def __post_init__(self) -> None:
        if not 0.0 <= self.u_time_s < np.inf:
            raise VisionInputError(f"u_time_s = {self.u_time_s!r}; needs a standard uncertainty of at least 0 s")
        if self.max_pixels is not None:
            check_count("max_pixels", self.max_pixels)
        if self.rows_per_s is not None and not self.rows_per_s > 0.0:
            raise VisionInputError(
                f"rows_per_s = {self.rows_per_s!r}; needs the rows that a rolling shutter reads per second, above 0, "
                "or infinity for a global shutter"
            )
        if self.first_field not in (None, *FIRST_FIELDS):
            raise VisionInputError(f"first_field {self.first_field!r} is not known; choose {' or '.join(FIRST_FIELDS)}")
        if self.pixel_aspect is not None:
            if self.is_calibrated:
                raise VisionInputError(
                    f"pixel_aspect = {self.pixel_aspect:g} beside a calibrated camera, which has measured it; "
                    "leave one out"
                )
            if not ASPECTS[0] <= self.pixel_aspect <= ASPECTS[1]:
                raise VisionInputError(
                    f"pixel_aspect = {self.pixel_aspect!r}; needs the width of a pixel over its height, {ASPECTS[0]:g} "
                    f"to {ASPECTS[1]:g}"
                )

    @property
    def camera_model(self) -> CameraModel:
        return self.camera or AssumedCamera()

    @property
    def is_calibrated(self) -> bool:
        return self.camera is not None and not isinstance(self.camera, AssumedCamera)


@dataclass(frozen=True)
class TrackSettings(FitSettings):
    every: int = 1
    confirm: str = "doubtful"
    threads: int | None = None
    checkpoint: str | os.PathLike[str] | None = None
    expected: Callable[[ErrorBudget], None] | None = None
    progress: Callable[[int, int], None] | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        check_count("every", self.every)
        if self.threads is not None and (
            isinstance(self.threads, bool) or not isinstance(self.threads, int) or not 1 <= self.threads <= MOST_THREADS
        ):
            raise VisionInputError(f"threads = {self.threads!r}; needs a whole number from 1 to {MOST_THREADS}")
        if self.confirm not in CONFIRM:
            raise VisionInputError(f"confirm = {self.confirm!r}; choose {', '.join(CONFIRM)}")
