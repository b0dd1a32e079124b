"""Films stored as pictures: a TIFF with one frame per page, or a folder with one PNG, TIFF, BMP or JPEG per frame.

OpenCV decodes one picture at a time, so memory does not grow with the film. A folder is read in the order of the
numbers in the file names. These formats carry no frame rate: the caller gives the frame times. Pictures that cannot be
decoded, or differ in size or depth from the first, raise `FilmError`.

A TIFF file must hold all the pages it points to; decoders stop at a broken pointer as if it were the last. Format: TIFF
6.0 (Adobe, 1992) and BigTIFF: a header with the place of the first directory; each directory ends with the place of the
next, zero after the last. Directories list where the strips or tiles of their picture lie.
"""

from __future__ import annotations

import os
import re
import struct
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from vision.errors import FilmError
from vision.film.source import Compression, Film, NewestFrame, grey_of, jpeg_steps

OFFSETS, COUNTS = (273, 324), (279, 325)
"""Tags of the places and sizes of strips and tiles."""
SIZES = {3: ("H", 2), 4: ("I", 4), 16: ("Q", 8)}
MAX_PAGES = 10_000_000


def chain_is_whole(path: Path) -> bool:
    """False when a directory or a strip lies beyond the end of the file; True for files of another format."""
    with path.open("rb") as file:
        size = os.fstat(file.fileno()).st_size
        head = file.read(16)
        if head[:4] not in (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"):
            return True
        order, big = "<" if head[:2] == b"II" else ">", b"+" in head[:4]
        try:
            at = int(struct.unpack(order + ("Q" if big else "I"), head[8:16] if big else head[4:8])[0])
            seen: set[int] = set()
            while at and at not in seen and len(seen) < MAX_PAGES:
                seen.add(at)
                at, whole = _page(file, at, order, big, size)
                if not whole:
                    return False
        except struct.error:
            return False
    return True


def _page(file: BinaryIO, at: int, order: str, big: bool, size: int) -> tuple[int, bool]:
    """Place of the next directory, and whether this page's own data lie inside the file."""
    entry, count_code, offset_code = (20, "Q", "Q") if big else (12, "H", "I")
    file.seek(at)
    (n,) = struct.unpack(order + count_code, file.read(struct.calcsize(count_code)))
    if n * entry > size:
        return 0, False
    table = file.read(n * entry)
    (following,) = struct.unpack(order + offset_code, file.read(struct.calcsize(offset_code)))
    found: dict[int, tuple[int, ...]] = {}
    for k in range(n):
        raw = table[k * entry : (k + 1) * entry]
        tag, kind, count = struct.unpack(order + ("HHQ" if big else "HHI"), raw[: 12 if big else 8])
        if tag in OFFSETS + COUNTS and kind in SIZES:
            code, width = SIZES[kind]
            room = raw[12:] if big else raw[8:]
            if count * width > len(room):
                file.seek(struct.unpack(order + offset_code, room)[0])
                room = file.read(min(count * width, size))
            found[tag] = struct.unpack(f"{order}{count}{code}", room[: count * width])
    for where, length in zip(OFFSETS, COUNTS, strict=True):
        ends = zip(found.get(where, ()), found.get(length, ()), strict=False)
        if any(start + extent > size for start, extent in ends):
            return int(following), False
    return int(following), True


JPEG_SUFFIXES = (".jpg", ".jpeg")
PICTURE_SUFFIXES = (".png", ".tif", ".tiff", ".bmp", *JPEG_SUFFIXES)


class _Pictures(Film):
    """Pictures of one size and depth, each decoded whole."""

    def __init__(self, path: Path, n_frames: int, channel: str | None) -> None:
        self.path, self.n_frames, self._channel = path, n_frames, channel
        self._newest = NewestFrame()
        _, first = self._decoded(0)
        (self.height, self.width), self._type = first.shape, first.dtype
        self.bit_depth = 8 * first.dtype.itemsize

    def read(self, index: int) -> NDArray[Any]:
        """Whole frame, shape (height, width)."""
        self._check_index(index)
        return self._newest.of(index, self._fitting)

    def _fitting(self, index: int) -> NDArray[Any]:
        where, picture = self._decoded(index)
        if picture.shape != (self.height, self.width) or picture.dtype != self._type:
            raise FilmError(
                f"{where}: {picture.shape[1]} x {picture.shape[0]} {picture.dtype}, the first picture is "
                f"{self.width} x {self.height} {self._type}; keep one film per folder or file"
            )
        return picture

    def _decoded(self, index: int) -> tuple[str, NDArray[Any]]:
        """Where a picture stands, and its grey values."""
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
        self._files = _one_series(path, sorted(found, key=_by_number), allow_truncated)
        super().__init__(path, len(self._files), channel)
        if self._files[0].suffix.lower() in JPEG_SUFFIXES:
            self.compression = Compression(jpeg_steps(self._files[0].read_bytes()))

    def _decoded(self, index: int) -> tuple[str, NDArray[Any]]:
        # start-up: OpenCV costs 0.12 s, MRAW films do without
        import cv2

        where = str(self._files[index])
        return where, _grey(cv2.imread(where, cv2.IMREAD_UNCHANGED), where, self._channel)


class PagedPicture(_Pictures):
    """A TIFF file with one frame per page, or a single picture."""

    def __init__(self, path: Path, *, allow_truncated: bool = False, channel: str | None = None) -> None:
        # start-up: as above
        import cv2

        try:
            n_frames = int(cv2.imcount(str(path), cv2.IMREAD_UNCHANGED))
        except cv2.error as error:
            raise FilmError(f"{path}: cannot be decoded ({error.err})") from None
        if n_frames < 1:
            raise FilmError(f"{path}: cannot be decoded; the file is damaged or not a picture")
        super().__init__(path, n_frames, channel)
        if allow_truncated:
            self.n_frames = self._whole_pages()
        elif path.suffix.lower() in (".tif", ".tiff") and not chain_is_whole(path):
            raise FilmError(
                f"{path}: the file ends before its last page ({self.n_frames} pages are listed); copy it again, or "
                "read what is whole with --allow-truncated"
            )

    def _whole_pages(self) -> int:
        """Pages up to the first that cannot be decoded."""
        for index in range(1, self.n_frames):
            try:
                self._decoded(index)
            except FilmError:
                return index
        return self.n_frames

    def _decoded(self, index: int) -> tuple[str, NDArray[Any]]:
        # start-up: as above
        import cv2

        where = f"{self.path}: page {index}"
        try:
            ok, pages = cv2.imreadmulti(str(self.path), start=index, count=1, flags=cv2.IMREAD_UNCHANGED)
        except cv2.error as error:
            raise FilmError(f"{where} cannot be decoded ({error.err})") from None
        if not ok or len(pages) != 1:
            raise FilmError(f"{where} of {self.n_frames} cannot be decoded; the film is cut short")
        return where, _grey(pages[0], where, self._channel)


def _by_number(file: Path) -> tuple[list[int], str]:
    return [int(digits) for digits in re.findall(r"\d+", file.stem)], file.name


def _one_series(folder: Path, files: list[Path], allow_truncated: bool) -> list[Path]:
    """The files, when their names differ only by a number that grows by equal steps."""
    if not re.search(r"\d", files[0].stem):
        return files
    kinds = {re.sub(r"\d+", "#", file.name): file.name for file in files}
    if len(kinds) > 1:
        first, second = list(kinds.values())[:2]
        raise FilmError(f"{folder}: {first} and {second} are named differently; keep one film per folder")
    numbers = np.array([_by_number(file)[0] for file in files], dtype=object)
    moving = [column for column in numbers.T if len(set(column)) > 1]
    if len(moving) > 1:
        raise FilmError(
            f"{folder}: two numbers change in the names ({files[0].name}, {files[-1].name}); keep one film per folder"
        )
    if not moving:
        return files
    steps = np.diff(moving[0])
    usual = min(steps)
    gaps = [int(i) for i in np.flatnonzero(steps != usual)]
    if gaps and not allow_truncated:
        before, after = files[gaps[0]].name, files[gaps[0] + 1].name
        raise FilmError(
            f"{folder}: pictures are missing between {before} and {after} ({len(gaps)} gaps); copy them again, or "
            "read up to the gap with --allow-truncated"
        )
    return files[: gaps[0] + 1] if gaps else files


def _grey(picture: NDArray[Any] | None, where: str, channel: str | None) -> NDArray[Any]:
    if picture is None:
        raise FilmError(f"{where}: cannot be decoded; the file is damaged or not a picture")
    if picture.dtype not in (np.uint8, np.uint16):
        raise FilmError(f"{where}: pixel type {picture.dtype}, readable are 8 and 16 bit; convert the picture")
    return grey_of(picture, channel)
