"""Errors and warnings of the vision package."""

from __future__ import annotations

from typing import TypeVar

T = TypeVar("T")


class VisionError(Exception):
    """Base of every error raised on purpose by `vision`; by itself it reports a defect."""

    exit_code = 1


class VisionInputError(VisionError, ValueError):
    """What the user gave cannot be used."""

    exit_code = 2


InputError = VisionInputError
"""Older name of `VisionInputError`."""


class FilmError(VisionInputError):
    """A film that is missing, unreadable, cut short, or whose header contradicts its data."""


class BodyError(VisionInputError):
    """Body outlines that cannot be tracked: bad file, too small, outside the picture, unknown parent."""


class TrackingError(VisionInputError):
    """A film on which the bodies cannot be tracked at all, for example because nothing is at rest."""


class VisionWarning(UserWarning):
    """A film or a setting that can be used but costs accuracy."""
