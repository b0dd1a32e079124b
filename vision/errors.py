"""Errors and warnings of the vision package."""

from __future__ import annotations

import difflib
import inspect
from collections.abc import Callable, Iterable, Mapping
from typing import Any, TypeVar

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


def make_options(kind: Callable[..., T], function: str, keywords: Mapping[str, Any]) -> T:
    """The options ``kind`` of a public function; ``TypeError`` in the function's name for one that it has not."""
    refuse_unknown(function, keywords, inspect.signature(kind).parameters)
    return kind(**keywords)


def refuse_unknown(function: str, keywords: Iterable[str], known: Iterable[str]) -> None:
    """Raise ``TypeError`` in the name of a public function for a keyword that it has not."""
    names = list(known)
    if unknown := [name for name in keywords if name not in names]:
        near = difflib.get_close_matches(unknown[0], names, n=1)
        hint = f"; did you mean {near[0]!r}?" if near else f"; allowed {', '.join(names)}"
        raise TypeError(f"{function}() got an unexpected keyword argument {unknown[0]!r}{hint}")
