"""Open a film of any readable format: picks the reader by the file's suffix."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from vision.errors import FilmError
from vision.film.cine_reader import CineFilm
from vision.film.mraw import MrawFilm, apply_sidecar_header
from vision.film.picture_stack import PICTURE_SUFFIXES, TIFF_SUFFIXES, OnePicture, PictureFolder
from vision.film.source import CHANNELS, ChosenFrames, Film, FrameSource
from vision.film.tiff_reader import TiffFilm
from vision.film.used_bits import find_white
from vision.film.video_reader import VideoFilm

VIDEO_SUFFIXES = (
    *(".avi", ".mp4", ".mov", ".mkv", ".m4v", ".webm", ".3gp"),
    *(".mts", ".m2ts", ".ts", ".mpg", ".mpeg", ".mxf"),
)
READERS: dict[str, Callable[..., Film]] = {
    **dict.fromkeys((".mraw", ".cih", ".cihx"), MrawFilm),
    ".cine": CineFilm,
    **dict.fromkeys(VIDEO_SUFFIXES, VideoFilm),
    **dict.fromkeys(PICTURE_SUFFIXES, OnePicture),
    **dict.fromkeys(TIFF_SUFFIXES, TiffFilm),
}
"""Reader of each suffix, called with the path, ``allow_truncated`` and ``channel``; the suffixes of films beside a
trial are `rig.session.folder.FILM_SUFFIXES`."""


def open_film(path: str | os.PathLike[str], *, allow_truncated: bool = False, channel: str | None = None) -> Film:
    """Open a film by its ending, or a folder of numbered pictures, to read grey frames. ``channel``: red, green, blue,
    or of a TIFF with channels a number; None weights as the eye does. `FilmError` for one cut short, unless
    ``allow_truncated``.

    Parameters
    ----------
    path : path
        ``.mraw``, ``.cih`` or ``.cihx`` (film and header lie side by side), a Phantom ``.cine``, a container video
        (AVI, MP4, MOV, MKV, WebM, MPEG, MXF), a TIFF with one frame per page or axes (ImageJ, OME), or a folder of PNG,
        TIFF, BMP or JPEG pictures, read in the order of the numbers in their names.
    allow_truncated : bool
        Read a film that was cut short up to its last whole frame instead of refusing it.
    channel : {"red", "green", "blue"} or str, optional
        Of a colour film, take the grey values of this channel; weighted as the eye does when None. JPEG and most video
        codecs store red and blue at half the resolution. Of a TIFF that holds channels, the number of one, from "1".

    Returns
    -------
    Film
        A `FrameSource`, also a context manager.

    Raises
    ------
    FilmError
        The film is missing, unreadable, or shorter than its header says; a channel of a film whose format is grey.

    Examples
    --------
    >>> import vision
    >>> with vision.open_film("film.mraw") as film:
    ...     film.n_frames, film.frame_rate_hz, film.read(0).shape
    (150, 2000.0, (212, 280))
    """
    path = Path(path)
    suffix = path.suffix.lower()
    readable = f"{', '.join(READERS)}, or a folder of pictures"
    if not path.exists():
        raise FilmError(f"{path}: no such film; readable: {readable}")
    if channel is not None and channel not in CHANNELS and not (suffix in TIFF_SUFFIXES and channel.isdecimal()):
        raise FilmError(
            f"channel {channel!r} is not known; choose {', '.join(CHANNELS)}, of a TIFF with channels their number, or "
            "none"
        )
    if not path.is_dir() and suffix not in READERS:
        raise FilmError(f"{path}: film format {suffix or '(no suffix)'} is not known; readable: {readable}")
    reader = PictureFolder if path.is_dir() else READERS[suffix]
    film = reader(path, allow_truncated=allow_truncated, channel=channel)
    if not film.has_camera_times:
        apply_sidecar_header(film)
        find_white(film)
    return film


@contextmanager
def open_or_use(
    path_or_source: str | os.PathLike[str] | FrameSource, first_frame: int = 0, last_frame: int | None = None
) -> Iterator[FrameSource]:
    """Context manager: a film, or its frames ``first_frame`` to ``last_frame`` (inclusive; None: to the end) only; one
    opened from a path is closed again, a given source is left open."""
    own = open_film(path_or_source) if isinstance(path_or_source, str | os.PathLike) else None
    film = own or path_or_source
    assert not isinstance(film, str | os.PathLike)
    try:
        is_part = first_frame != 0 or last_frame is not None
        yield ChosenFrames(film, first_frame, last_frame) if is_part else film
    finally:
        if own is not None:
            own.close()
