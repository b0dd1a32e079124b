"""Errors and warnings of the vision package.

Place in the data flow: raised by the readers (film), by `bodies` (outlines) and by the tracker, caught by the
command line, which prints the one-line message and leaves with ``exit_code``: 2 for bad input, 1 for a
defect. A message says what is wrong, in which file, the value found, the value allowed, and what to do.
"""

from __future__ import annotations


class VisionError(Exception):
    """Base of every error raised on purpose by `vision`; by itself it reports a defect."""

    exit_code = 1


class InputError(VisionError, ValueError):
    """What the user gave cannot be used."""

    exit_code = 2


class FilmError(InputError):
    """A film that is missing, unreadable, cut short, or whose header contradicts its data."""


class BodyError(InputError):
    """Body outlines that cannot be tracked: bad file, too small, outside the picture, unknown parent."""


class TrackingError(InputError):
    """A film on which the bodies cannot be followed at all, for example because nothing stands still."""


class VisionWarning(UserWarning):
    """A film or a setting that can be used but will cost accuracy."""
