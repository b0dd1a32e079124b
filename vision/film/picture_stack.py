"""Films stored as pictures: a folder with one PNG, TIFF, BMP or JPEG per frame; and single pictures.

A folder is read in the order of the numbers in the file names, which count negative before a trigger.
"""

from __future__ import annotations

import re
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vision.errors import FilmError, VisionWarning
from vision.film.source import (
    Compression,
    Film,
    NewestFrame,
    decode_picture,
    jpeg_ends,
    jpeg_quantisation_table,
    to_grey,
)

JPEG_SUFFIXES, TIFF_SUFFIXES = (".jpg", ".jpeg"), (".tif", ".tiff")
PICTURE_SUFFIXES = (".png", *TIFF_SUFFIXES, ".bmp", *JPEG_SUFFIXES)


class _Pictures(Film):
    """Pictures of one size and depth, each decoded whole."""

    def __init__(self, path: Path, n_frames: int, channel: str | None) -> None:
        self.path, self.n_frames, self._channel = path, n_frames, channel
        self._newest = NewestFrame()
        _, first = self._decode_picture(0)
        (self.height, self.width), self._type = first.shape, first.dtype
        self.bit_depth = 8 * first.dtype.itemsize

    def read(self, index: int) -> NDArray[Any]:
        self._check_index(index)
        return self._newest.get(index, self._decode_checked)

    def _decode_checked(self, index: int) -> NDArray[Any]:
        """Decoded grey picture of a frame; `FilmError` where its size or type is not that of the first."""
        where, picture = self._decode_picture(index)
        if picture.shape != (self.height, self.width) or picture.dtype != self._type:
            raise FilmError(
                f"{where}: {picture.shape[1]} x {picture.shape[0]} {picture.dtype}, the first picture is "
                f"{self.width} x {self.height} {self._type}; keep one film per folder or file"
            )
        return picture

    def _decode_picture(self, index: int) -> tuple[str, NDArray[Any]]:
        raise NotImplementedError


class PictureFolder(_Pictures):
    """A folder of pictures, one per frame, all of one size and depth, numbered without gaps in their names.

    With ``allow_truncated`` a folder with a gap is read up to the gap.
    """

    def __init__(self, path: Path, *, allow_truncated: bool = False, channel: str | None = None) -> None:
        try:
            found = [entry for entry in path.iterdir() if entry.suffix.lower() in PICTURE_SUFFIXES]
        except OSError as error:
            raise FilmError(f"{path}: folder cannot be read ({error.strerror})") from None
        if not found:
            raise FilmError(f"{path}: holds no picture ({', '.join(PICTURE_SUFFIXES)}); give a film or such a folder")
        self._files = _select_series(path, sorted(found), allow_truncated)
        super().__init__(path, len(self._files), channel)
        if self._files[0].suffix.lower() in JPEG_SUFFIXES:
            self.compression = Compression(jpeg_quantisation_table(self._files[0].read_bytes()))

    def _decode_picture(self, index: int) -> tuple[str, NDArray[Any]]:
        where = self._files[index]
        return str(where), _read_picture(where, self._channel)


class OnePicture(_Pictures):
    def __init__(self, path: Path, *, allow_truncated: bool = False, channel: str | None = None) -> None:
        super().__init__(path, 1, channel)

    def _decode_picture(self, index: int) -> tuple[str, NDArray[Any]]:
        return str(self.path), _read_picture(self.path, self._channel)


NUMBER = re.compile(r"(?<![A-Za-z0-9])[-+]?\d+|\d+")
"""A minus after a letter may be a hyphen, one after a digit is."""
SIGNED_AFTER_LETTERS = re.compile(r"(?<![0-9])[-+]?\d+|\d+")
CAMERA_COUNTS = re.compile(r"Img-\d{5}$")
"""As Phantom's software names pictures before the trigger."""


def _select_series(folder: Path, files: list[Path], allow_truncated: bool) -> list[Path]:
    """The files of the one series in a folder, sorted by the number in their names, which grows by equal steps. Warns
    of other files; `FilmError` where there are several series or gaps; with ``allow_truncated`` the files before the
    first gap."""
    number = _number_pattern(folder, files)
    kinds: dict[str, list[Path]] = {}
    for file in files:
        kinds.setdefault(number.sub("#", file.stem) + file.suffix.lower(), []).append(file)
    series = max(kinds, key=lambda kind: len(kinds[kind]))
    others = [file for kind, some in kinds.items() if kind != series for file in some]
    if "#" not in series:
        if others:
            raise FilmError(
                f"{folder}: {files[0].name} and {files[-1].name} are named differently; keep one film per folder, its "
                "pictures numbered"
            )
        return files
    several = next((some for kind, some in kinds.items() if kind != series and len(some) > 1), None)
    if several is not None or len(kinds[series]) == 1 < len(files):
        other = several[0] if several is not None else others[0]
        raise FilmError(
            f"{folder}: {kinds[series][0].name} and {other.name} are named differently; keep one film per folder"
        )
    if others:
        warnings.warn(
            f"{folder}: {', '.join(sorted(file.name for file in others)[:5])} {'is' if len(others) == 1 else 'are'} "
            f"left out, as not of the series {kinds[series][0].name} …",
            VisionWarning,
            stacklevel=4,
        )
    return _sort_by_number(folder, kinds[series], number, allow_truncated)


def _number_pattern(folder: Path, files: list[Path]) -> re.Pattern[str]:
    """Pattern that finds the numbers in these files' names; decides whether a minus is a sign or a hyphen, and warns
    where that is in doubt."""
    hyphened = [file for file in files if re.search(r"[A-Za-z]-\d+$", file.stem)]
    if not hyphened:
        return NUMBER
    without = {re.sub(r"[-+]?\d+$", "", file.stem) for file in files if file not in hyphened}
    is_sign = all(CAMERA_COUNTS.search(file.stem) for file in hyphened) or any(
        re.sub(r"-\d+$", "", file.stem) in without for file in hyphened
    )
    if is_sign:
        return SIGNED_AFTER_LETTERS
    if len(hyphened) > 1:
        warnings.warn(
            f"{folder}: the minus of {hyphened[0].name} is read as a hyphen, so that its number grows from picture to "
            "picture; were they counted down to a trigger, name them as in shot_-0060.png",
            VisionWarning,
            stacklevel=5,
        )
    return NUMBER


def _sort_by_number(folder: Path, files: list[Path], number: re.Pattern[str], allow_truncated: bool) -> list[Path]:
    """Files of one series sorted by the number that grows in their names, which ``number`` finds; where some are
    missing `FilmError`, or with ``allow_truncated`` the files before the first gap."""
    values = {file: [int(digits) for digits in number.findall(file.stem)] for file in files}
    files = sorted(files, key=lambda file: (values[file], file.name))
    columns = np.array([values[file] for file in files], dtype=object)
    moving = [column for column in columns.T if len(set(column)) > 1]
    if len(moving) > 1:
        raise FilmError(
            f"{folder}: two numbers change in the names ({files[0].name}, {files[-1].name}); keep one film per folder"
        )
    if not moving:
        if len(files) > 1:
            raise FilmError(f"{folder}: {files[0].name} and {files[1].name} have the same number; keep one of them")
        return files
    steps = np.diff(moving[0])
    usual = min(steps)
    if usual == 0:
        at = int(np.flatnonzero(steps == 0)[0])
        raise FilmError(f"{folder}: {files[at].name} and {files[at + 1].name} have the same number; keep one of them")
    gaps = [int(i) for i in np.flatnonzero(steps != usual)]
    if gaps and not allow_truncated:
        before, after = files[gaps[0]].name, files[gaps[0] + 1].name
        raise FilmError(
            f"{folder}: pictures are missing between {before} and {after} ({len(gaps)} gaps); copy them again, or "
            "read up to the gap with `allow_truncated`"
        )
    return files[: gaps[0] + 1] if gaps else files


def _read_picture(path: Path, channel: str | None) -> NDArray[Any]:
    """Decode a picture file to grey (height, width), 8 or 16 bit, of one ``channel`` (red, green, blue) where named;
    `FilmError` for other types, damage, and files of several pictures."""
    # start-up: OpenCV costs 0.12 s, MRAW films do without
    import cv2

    suffix, how = path.suffix.lower(), cv2.IMREAD_UNCHANGED
    try:
        data = path.read_bytes()
    except OSError as error:
        raise FilmError(f"{path}: cannot be read ({error.strerror or error})") from None
    if suffix in JPEG_SUFFIXES:
        if not jpeg_ends(data):
            raise FilmError(f"{path}: ends before its picture does; copy it again")
        # unlike the other, it obeys the orientation
        how = cv2.IMREAD_ANYCOLOR | cv2.IMREAD_ANYDEPTH
    picture = decode_picture(np.frombuffer(data, np.uint8), how)
    if picture is None:
        raise FilmError(f"{path}: cannot be decoded; the file is damaged or not a picture")
    if suffix in TIFF_SUFFIXES and (n_pages := cv2.imcount(str(path))) > 1:
        raise FilmError(
            f"{path}: holds {n_pages} pictures, a folder one in each file; track each file on its own, or join them in "
            "one TIFF"
        )
    if picture.dtype not in (np.uint8, np.uint16):
        raise FilmError(f"{path}: pixel type {picture.dtype}, readable are 8 and 16 bit; convert the picture")
    return to_grey(picture, channel)
