"""Write films as Photron MRAW with the CIHX header that Photron's viewers read.

Films are written frame by frame, so memory does not grow with them. A file appears under its name only when it is
complete: it is written under a temporary name and renamed, the data before the header that makes it readable.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vision.atomic_write import remove, temporary_name
from vision.errors import FilmError
from vision.film.cih_header import FilmHeader, cihx_bytes
from vision.film.frame_check import check_frame


def write_mraw(
    path: str | os.PathLike[str],
    frames: Iterable[ArrayLike],
    frame_rate_hz: float,
    *,
    bit_depth: int = 8,
    exposure_s: float | None = None,
    start_frame: int = 0,
    comment: str = "",
) -> int:
    """Write frames as Photron MRAW plus CIHX.

    Parameters
    ----------
    path : path
        Ends in ``.mraw``; the header is written next to it as ``.cihx``.
    frames : iterable of ndarray, shape (height, width)
        Whole numbers within ``0 .. 2**bit_depth - 1``.
    frame_rate_hz : float
    bit_depth : {8, 12, 16}
        Storage per pixel; 12 packs two pixels in three bytes.
    exposure_s : float or None
    start_frame : int
        Number of the first frame counted from the trigger.
    comment : str

    Returns
    -------
    int
        Number of frames written.

    Raises
    ------
    FilmError
        Frames that do not fit the stated format, or a folder that cannot be written; nothing is left behind.

    Examples
    --------
    >>> import numpy as np
    >>> import vision
    >>> vision.write_mraw("grey.mraw", [np.full((48, 64), 900)] * 3, 2000.0, bit_depth=12)
    3
    """
    path = Path(path)
    if path.suffix != ".mraw":
        raise FilmError(f"{path}: an MRAW film must end in .mraw")
    if bit_depth not in (8, 12, 16):
        raise FilmError(f"{path}: bit depth {bit_depth} cannot be stored; choose 8, 12 or 16")
    if not 0.0 < frame_rate_hz < 1e9:
        raise FilmError(f"{path}: frame rate {frame_rate_hz} Hz; needs a positive number")
    header_path = path.with_suffix(".cihx")
    temporary, temporary_header = temporary_name(path), temporary_name(header_path)
    shape: tuple[int, ...] | None = None
    n_frames = 0
    try:
        try:
            with temporary.open("wb") as file:
                pending = np.empty(0, dtype=np.uint16)
                for given in frames:
                    frame = check_frame(path, given, shape, bit_depth, n_frames)
                    shape = frame.shape
                    if bit_depth == 12:
                        flat = np.concatenate([pending, frame.reshape(-1).astype(np.uint16)])
                        even = flat.size - flat.size % 2
                        pending = flat[even:]
                        file.write(pack12(flat[:even]))
                    else:
                        file.write(np.ascontiguousarray(frame, dtype="<u2" if bit_depth == 16 else np.uint8).data)
                    n_frames += 1
                if pending.size:
                    file.write(pack12(np.append(pending, 0).astype(np.uint16))[:2])
            if shape is None:
                raise FilmError(f"{path}: no frames to write")
            header = FilmHeader(
                width=shape[1],
                height=shape[0],
                n_frames=n_frames,
                colour_bit=bit_depth,
                effective_bit=bit_depth,
                colour_type="Mono" if bit_depth != 12 else "Raw",
                frame_rate_hz=frame_rate_hz,
                exposure_s=exposure_s,
                start_frame=start_frame,
                comment=comment,
            )
            temporary_header.write_bytes(cihx_bytes(header))
            _swap(path, temporary, header_path, temporary_header)
        except OSError as error:
            raise FilmError(f"{path}: cannot be written ({error.strerror or error}); check folder and disk") from None
    finally:
        remove(temporary)
        remove(temporary_header)
    return n_frames


def pack12(values: NDArray[np.uint16]) -> bytes:
    """Pack an even number of 12-bit values, two in three bytes, the first in the upper bits."""
    first, second = values[0::2], values[1::2]
    out = np.empty((first.size, 3), dtype=np.uint8)
    out[:, 0] = first >> 4
    out[:, 1] = ((first & 15) << 4) | (second >> 8)
    out[:, 2] = second & 255
    return out.tobytes()


def _swap(path: Path, new_data: Path, header_path: Path, new_header: Path) -> None:
    """Put a new film in place of an old one; an old header never describes new data, not even for a moment."""
    old_header = header_path.with_name(f".{header_path.name}.{os.getpid()}.old")
    had_header = header_path.exists()
    if had_header:
        os.replace(header_path, old_header)
    try:
        os.replace(new_data, path)
    except OSError:
        # the old film is in use (Windows): leave it as it was
        if had_header:
            os.replace(old_header, header_path)
        raise
    os.replace(new_header, header_path)
    remove(old_header)
