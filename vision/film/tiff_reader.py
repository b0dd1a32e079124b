"""TIFF films through tifffile: pages, ImageJ hyperstacks, stacks beyond 4 GB, OME; the axes say which pages are frames.

One axis beside the picture's own is time, whichever its name; channels are never taken for it, one has to be chosen.
Frames that lie uncompressed in the file are read region by region; others are decoded whole, each from its own place,
so that the last costs what the first does. What tifffile decodes only with a package of its own (LZW, JPEG, palettes,
packed 12 bit) goes to OpenCV as a file of one page.
"""

from __future__ import annotations

import logging
import os
import struct
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from vision.errors import FilmError, VisionWarning
from vision.film.mmap_window import FileWindow
from vision.film.orientation import MATRICES, interpret_display_matrix
from vision.film.source import CHANNELS, Compression, Film, NewestFrame, decode_picture, to_grey

if TYPE_CHECKING:
    import tifffile

ORIENTATION = 274
OFFSETS, COUNTS = (273, 324), (279, 325)  # tags of the places and sizes of strips and tiles
SIZES = {3: "u2", 4: "u4", 16: "u8"}
MAX_PAGES, MOST_STRIPS, MOST_TAGS = 10_000_000, 65_536, 4096
"""Of a film, and of a page: a strip holds a row at least, and tiles are larger; pages have some twenty tags."""
STRIPS_AT_ONCE = 1024
PLAIN, BY_TIFFFILE = 1, (1, 8, 32946, 32773, 34925)
"""Compression: none, and what tifffile decodes by itself (deflate, PackBits, LZMA)."""
JPEG = (6, 7)
PACKED_BITS = (10, 12, 14)
"""Of a page whose values follow one another without a gap; OpenCV gives them in the upper part of 16."""
WHITE_IS_ZERO, BLACK_IS_ZERO, RGB = 0, 1, 2
TAGS_OF_A_PAGE = {256: "I", 257: "I", 258: "H", 259: "H", 262: "H", 266: "H", 277: "H", 278: "I", 284: "H", 317: "H",
                  320: "H", 322: "I", 323: "I", 338: "H", 339: "H", 347: "B", 530: "H"}  # fmt: skip
"""What a page needs to be decoded without the others: tag and kind of number."""
CODES = {"B": 7, "H": 3, "I": 4}


class TiffFilm(Film):
    """A TIFF file with one frame per page, or with axes.

    Parameters
    ----------
    allow_truncated : read up to the last whole page instead of refusing a file that was cut short
    channel : ``red``, ``green`` or ``blue`` of colour pages; a number from 1 where the file has channels
    """

    def __init__(self, path: Path, *, allow_truncated: bool = False, channel: str | None = None) -> None:
        # start-up: tifffile costs 0.05 s, other films do without
        import tifffile

        # what it remarks of a file is found here, and said in one line
        logging.getLogger("tifffile").setLevel(logging.CRITICAL)
        self.path = path
        if not allow_truncated and not has_whole_pages(path):
            raise FilmError(
                f"{path}: the file ends before its last page; copy it again, or read what is whole with "
                "`allow_truncated`"
            )
        try:
            self._tiff = tifffile.TiffFile(path)
            series = list(self._tiff.series)
        except (tifffile.TiffFileError, OSError, ValueError, IndexError, KeyError, struct.error) as error:
            raise FilmError(f"{path}: cannot be decoded; the file is damaged or not a picture ({error})") from None
        self._file = FileWindow(path)
        self._newest = NewestFrame()
        self._turned: Callable[[NDArray[Any]], NDArray[Any]] | None = None
        try:
            self._read_axes(series, channel)
            self._count_imagej(allow_truncated)
            self._drop_incomplete_frames(allow_truncated)
            self._orient()
        except FilmError:
            self.close()
            raise

    def close(self) -> None:
        self._tiff.close()
        super().close()

    def read_region(self, index: int, y0: int, y1: int, x0: int, x1: int) -> NDArray[Any]:
        self._check_index(index)
        self._check_region(y0, y1, x0, x1)
        if self._turned is not None:
            return self._newest.get(index, self._read_turned)[y0:y1, x0:x1]
        return self._read_stored(index, y0, y1, x0, x1)

    def _read_turned(self, index: int) -> NDArray[Any]:
        grey = self._read_stored(index, 0, self._stored[0], 0, self._stored[1])
        return grey if self._turned is None else self._turned(grey)

    def _read_stored(self, index: int, y0: int, y1: int, x0: int, x1: int) -> NDArray[Any]:
        """Rectangle of a decoded grey frame before it is turned; the whole page where it is compressed and turned."""
        start = self._find_frame_offset(index)
        if start is None:
            if self._turned is not None:
                return self._decode_page(index)
            return self._newest.get(index, self._decode_page)[y0:y1, x0:x1]
        width = self._stored[1]
        row = width * self._samples * self._type.itemsize
        data = self._file.view(start + y0 * row, start + y1 * row).view(self._type)
        return self._grey(data.reshape(y1 - y0, width, self._samples)[:, x0:x1])

    def _orient(self) -> None:
        """Set the displayed size and the function that turns a stored picture upright; warns where the picture is
        turned."""
        tag = self._key.tags.get(ORIENTATION)
        matrix = MATRICES.get(tag.value) if tag is not None and isinstance(tag.value, int) else None
        turned = None if matrix is None else interpret_display_matrix(matrix)
        if turned is None:
            return
        words, is_transposed, self._turned = turned
        if is_transposed:
            self.height, self.width = self._stored[::-1]
        warnings.warn(f"{self.path}: its file wants the picture {words}, which is done", VisionWarning, stacklevel=5)

    def _read_axes(self, series: list[Any], channel: str | None) -> None:
        """Set size, depth, compression and the order of the frames' pages from the file's series and the chosen
        channel; `FilmError` for two axes of frames."""
        if not series:
            raise FilmError(f"{self.path}: holds no picture")
        kinds = {(one.axes.lstrip("IQT"), one.shape[-len(one.axes.lstrip("IQT")) :], str(one.dtype)) for one in series}
        if len(kinds) > 1:
            shapes = ", ".join(sorted({" x ".join(map(str, one.shape)) for one in series}))
            raise FilmError(
                f"{self.path}: holds {len(series)} series of pictures ({shapes}); keep one film per folder or file"
            )
        one = series[0]
        size = dict(zip(one.axes, one.shape, strict=True))
        if "Y" not in size or "X" not in size or one.dtype not in (np.uint8, np.uint16):
            kind = one.dtype if "Y" in size else f"axes {one.axes}"
            raise FilmError(f"{self.path}: pixel type {kind}, readable are 8 and 16 bit; convert the picture")
        self._key = one.keyframe
        self.height, self.width, self._samples = size["Y"], size["X"], size.get("S", 1)
        self._stored = self.height, self.width
        self.bit_depth = 8 * one.dtype.itemsize
        if self.bit_depth == 16 and one.keyframe.bitspersample in PACKED_BITS:
            self.bit_depth = one.keyframe.bitspersample
        self._type = np.dtype(one.dtype).newbyteorder(self._tiff.byteorder)
        outer = [(axis, count) for axis, count in zip(one.axes, one.shape, strict=True) if axis not in "YXS"]
        along = [(axis, count) for axis, count in outer if count > 1 and axis != "C"]
        if len(along) > 1:
            words = " and ".join(f"{count} along {axis}" for axis, count in along)
            raise FilmError(f"{self.path}: its pages have two axes ({words}); a film has one: save one of them")
        chosen = self._choose_channel(size.get("C", 1), channel, len(along))
        grid = np.arange(int(np.prod([count for _, count in outer], dtype=np.int64))).reshape(
            [n for _, n in outer] or [1]
        )
        for place, (axis, _) in enumerate(outer):
            if axis == "C":
                grid = grid.take([chosen], axis=place)
        # programs that append pages make a series of each
        self._at = [(one, int(page)) for page in grid.reshape(-1)]
        for other in series[1:]:
            self._at += [(other, page) for page in range(other.size // (self.height * self.width * self._samples))]
        self.n_frames = len(self._at)
        if one.keyframe.compression in JPEG:
            self.compression = Compression(None)

    def _count_imagej(self, allow_truncated: bool) -> None:
        """Set the frames of an ImageJ stack with a single directory to those that the file holds; `FilmError` for fewer
        than its header states, unless ``allow_truncated``."""
        said = int((self._tiff.imagej_metadata or {}).get("images", 1)) if self._tiff.is_imagej else 1
        series = self._at[0][0]
        found = sum(one.size for one in {id(one): one for one, _ in self._at}.values())
        found //= self.height * self.width * self._samples
        if found >= said:
            return
        if len(self._tiff.pages) == 1 and series.dataoffset is not None:
            frame_bytes = self.height * self.width * self._samples * self._type.itemsize
            found = (self._file.size - series.dataoffset) // frame_bytes
        if not allow_truncated and found < said:
            raise FilmError(
                f"{self.path}: its header says {said} images and holds {found}; the file is cut short: copy it again, "
                "or read what is whole with `allow_truncated`"
            )
        self._at = [(series, page) for page in range(min(found, said))]
        self.n_frames = len(self._at)

    def _choose_channel(self, n_channels: int, channel: str | None, n_along: int) -> int:
        """Index of the chosen channel (its number from 1, or a colour) beside ``n_along`` axes of frames; sets
        ``self._colour``, the name of a colour or None. `FilmError` where it does not fit."""
        self._colour = channel if channel in CHANNELS else None
        is_number = channel is not None and channel.isdecimal()
        if n_channels > 1:
            if not is_number or not 1 <= int(channel or 0) <= n_channels:
                found = "" if channel is None else f", {channel} is none"
                only = "" if n_along else "; were they frames, save them along time"
                raise FilmError(
                    f"{self.path}: holds {n_channels} channels{found}; choose one by its number (`channel` 1 to "
                    f"{n_channels}){only}"
                )
            return int(channel or 1) - 1
        if is_number and channel != "1":
            raise FilmError(f"{self.path}: holds one channel; leave the channel ({channel}) out")
        if self._colour is not None and self._samples < 3 and self._key.photometric in (WHITE_IS_ZERO, BLACK_IS_ZERO):
            raise FilmError(f"{self.path}: is a grey film; leave the channel ({channel}) out")
        return 0

    def _find_frame_offset(self, index: int) -> int | None:
        """Byte at which a frame lies uncompressed and whole; None where it has to be decoded."""
        key = self._key
        if key.compression != PLAIN or key.bitspersample != 8 * self._type.itemsize or key.photometric > RGB:
            return None
        if key.is_tiled or (self._samples > 1 and key.planarconfig != 1):
            return None
        series, page = self._at[index]
        frame_bytes = self.height * self.width * self._samples * self._type.itemsize
        if series.dataoffset is not None:
            return int(series.dataoffset) + page * frame_bytes
        offsets, counts = self._strips(index)
        lies_together = all(a + n == b for a, n, b in zip(offsets, counts, offsets[1:], strict=False))
        return int(offsets[0]) if lies_together and sum(counts) >= frame_bytes else None

    def _strips(self, index: int) -> tuple[tuple[int, ...], tuple[int, ...]]:
        series, number = self._at[index]
        page = series.pages[number]
        if page is None:
            raise FilmError(f"{self.path}: page {index} is not in the file; keep all files of the film together")
        return page.dataoffsets, page.databytecounts

    def _drop_incomplete_frames(self, allow_truncated: bool) -> None:
        """Raise `FilmError` for a frame that lies beyond the end of the file, or, with ``allow_truncated``, drop the
        frames from the first such one on, unless that is the first of all."""
        for index in range(self.n_frames):
            start = self._find_frame_offset(index) if self._at[index][0].dataoffset is not None else None
            if start is not None:
                end = start + self.height * self.width * self._samples * self._type.itemsize
            else:
                offsets, counts = self._strips(index)
                end = max((a + n for a, n in zip(offsets, counts, strict=True)), default=0)
            if end <= self._file.size:
                continue
            if allow_truncated and index:
                self.n_frames = index
                return
            raise FilmError(
                f"{self.path}: frame {index} of {self.n_frames} lies beyond the end of the file; copy it again, or "
                "read what is whole with `allow_truncated`"
            )

    def _decode_page(self, index: int) -> NDArray[Any]:
        """Decode a page to grey, as it is stored."""
        series, number = self._at[index]
        page, key = series.pages[number], self._key
        try:
            is_whole = key.bitspersample == 8 * self._type.itemsize
            if key.compression in BY_TIFFFILE and key.photometric <= RGB and is_whole:
                picture = page.asarray()
                if key.planarconfig != 1 and picture.ndim == 3:
                    picture = np.moveaxis(picture, 0, -1)
                picture = picture.reshape(*self._stored, self._samples)
            else:
                return self._decode_with_opencv(page, index)
        except FilmError:
            raise
        except (ValueError, OSError, IndexError, RuntimeError, struct.error) as error:
            raise FilmError(f"{self.path}: page {index} cannot be decoded ({error}); the film is damaged") from None
        return self._grey(picture)

    def _decode_with_opencv(self, page: tifffile.TiffPage, index: int) -> NDArray[Any]:
        """Decode a page that tifffile does not, to grey, as it is stored."""
        # start-up: OpenCV costs 0.12 s, other films do without
        import cv2

        strips = [
            self._file.view(at, at + count).data
            for at, count in zip(page.dataoffsets, page.databytecounts, strict=True)
        ]
        data = np.frombuffer(build_one_page_file(self._key, strips, self._tiff.byteorder), np.uint8)
        picture = decode_picture(data, cv2.IMREAD_UNCHANGED)
        if picture is None or picture.shape[:2] != self._stored:
            stored = f"{self._key.bitspersample} bit, compression {getattr(self._key.compression, 'name', '')}"
            raise FilmError(
                f"{self.path}: page {index} of {self.n_frames} ({stored}) cannot be decoded; the film is damaged, or "
                "of a kind that is not read: save it uncompressed, of 8 or 16 bit"
            )
        if picture.dtype not in (np.uint8, np.uint16):
            raise FilmError(f"{self.path}: pixel type {picture.dtype}, readable are 8 and 16 bit; convert the picture")
        if self._key.bitspersample in PACKED_BITS:
            picture = picture >> (16 - self._key.bitspersample)
        return to_grey(picture, self._colour)

    def _grey(self, picture: NDArray[Any]) -> NDArray[Any]:
        """Grey of (height, width, samples) as stored; colours are red, green, blue there."""
        if not self._type.isnative:
            picture = picture.astype(self._type.newbyteorder("="))
        if self._samples >= 3:
            return to_grey(np.ascontiguousarray(picture[..., 2::-1]), self._colour)
        grey = picture[..., 0]
        return (2**self.bit_depth - 1) - grey if self._key.photometric == WHITE_IS_ZERO else grey


def build_one_page_file(keyframe: Any, strips: list[memoryview], byteorder: str) -> bytes:
    """Bytes of a TIFF file of one page: tags of tifffile's ``keyframe``, and the page's own strips or tiles;
    ``byteorder`` '<' or '>'."""
    where, how_long = (324, 325) if keyframe.is_tiled else (273, 279)
    entries: dict[int, tuple[str, list[int]]] = {}
    for tag in keyframe.tags:
        if tag.code in TAGS_OF_A_PAGE:
            value = tag.value
            values = np.ravel(list(value) if isinstance(value, bytes) else value).tolist()
            entries[tag.code] = (TAGS_OF_A_PAGE[tag.code], [int(one) for one in values])
    at_strips = 8 + 2 + 12 * (len(entries) + 2) + 4
    extra = b""
    places = []
    at = at_strips
    for strip in strips:
        places.append(at)
        at += len(strip)
    entries[where], entries[how_long] = ("I", places), ("I", [len(strip) for strip in strips])
    directory = struct.pack(byteorder + "H", len(entries))
    for tag_code, (kind, numbers) in sorted(entries.items()):
        data = struct.pack(f"{byteorder}{len(numbers)}{kind}", *numbers)
        if len(data) > 4:
            field = struct.pack(byteorder + "I", at + len(extra))
            extra += data + b"\0" * (len(data) % 2)
        else:
            field = data.ljust(4, b"\0")
        directory += struct.pack(byteorder + "HHI", tag_code, CODES[kind], len(numbers)) + field
    head = (b"II*\0" if byteorder == "<" else b"MM\0*") + struct.pack(byteorder + "I", 8)
    return b"".join([head, directory, b"\0" * 4, *strips, extra])


def has_whole_pages(path: Path) -> bool:
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
                at, whole = _check_directory(file, at, order, big, size)
                if not whole:
                    return False
        except struct.error:
            return False
    return True


def _check_directory(file: BinaryIO, at: int, byte_order: str, is_big: bool, size: int) -> tuple[int, bool]:
    """Byte of the next directory (0: none), and whether the strips of the page whose directory is at byte ``at`` lie
    inside a file of ``size`` bytes; ``byte_order`` is '<' or '>', ``is_big`` BigTIFF."""
    entry, count_code, offset_code = (20, "Q", "Q") if is_big else (12, "H", "I")
    file.seek(at)
    (n,) = struct.unpack(byte_order + count_code, file.read(struct.calcsize(count_code)))
    if n > MOST_TAGS:
        return 0, False
    table = file.read(n * entry)
    (following,) = struct.unpack(byte_order + offset_code, file.read(struct.calcsize(offset_code)))
    found: dict[int, tuple[np.dtype[Any], int, int]] = {}
    for k in range(n):
        raw = table[k * entry : (k + 1) * entry]
        tag, kind, count = struct.unpack(byte_order + ("HHQ" if is_big else "HHI"), raw[: 12 if is_big else 8])
        if tag in OFFSETS + COUNTS and kind in SIZES:
            number = np.dtype(byte_order + SIZES[kind])
            if count > MOST_STRIPS:
                return int(following), False
            room = raw[12:] if is_big else raw[8:]
            inline = count * number.itemsize <= len(room)
            place = at + struct.calcsize(count_code) + (k + 1) * entry - len(room)
            found[tag] = number, count, place if inline else int(struct.unpack(byte_order + offset_code, room)[0])
    for where, length in zip(OFFSETS, COUNTS, strict=True):
        if where in found and length in found and not _lie_inside(file, found[where], found[length], size):
            return int(following), False
    return int(following), True


def _lie_inside(
    file: BinaryIO,
    starts: tuple[np.dtype[Any], int, int],
    lengths: tuple[np.dtype[Any], int, int],
    size: int,
) -> bool:
    """Whether all strips of a page lie inside a file of ``size`` bytes; their offsets and lengths are read from it as
    (number type, count, byte).

    Some at a time, since a damaged file may claim many.
    """
    count = min(starts[1], lengths[1])
    for first in range(0, count, STRIPS_AT_ONCE):
        part = []
        for number, _, at in (starts, lengths):
            file.seek(at + first * number.itemsize)
            wanted = min(STRIPS_AT_ONCE, count - first) * number.itemsize
            data = file.read(wanted)
            if len(data) < wanted:
                return False
            part.append(np.frombuffer(data, number).astype(np.float64))
        if np.any(part[0] + part[1] > size):
            return False
    return True
