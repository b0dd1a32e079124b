"""Text as other programs write it: UTF-8, UTF-16 with or without its mark, or the western Latin-1 of Windows.

Numbers are ASCII in all of them; an encoding guessed wrongly could only garble a name or a unit, which the mapping
would then not find.
"""

from __future__ import annotations

import codecs
import gzip
import zlib
from pathlib import Path

from rig.errors import RigInputError
from rig.storage.file_errors import refused

_MARKS = (
    (codecs.BOM_UTF8, "utf-8"),
    (codecs.BOM_UTF32_LE, "utf-32-le"),  # before UTF-16, whose mark begins like it
    (codecs.BOM_UTF32_BE, "utf-32-be"),
    (codecs.BOM_UTF16_LE, "utf-16-le"),
    (codecs.BOM_UTF16_BE, "utf-16-be"),
)


def read_text(path: Path) -> str:
    """Read a text file of another program, gzipped or not; raises RigInputError when it cannot be read."""
    with refused(path, "read"):
        data = path.read_bytes()
    if path.suffix.lower() == ".gz":
        try:
            data = gzip.decompress(data)
        except (OSError, EOFError, zlib.error) as error:
            raise RigInputError(f"{path}: not a whole gzip file ({error}); fetch it again") from None
    return decoded(data, str(path))


def decoded(data: bytes, where: str) -> str:
    """Return the text of ``data``; ``where`` names it in errors."""
    for mark, encoding in _MARKS:
        if data.startswith(mark):
            return _decode(data[len(mark) :], encoding, where)
    if wide := _unmarked_utf16(data):
        return _decode(data, wide, where)
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError:
        # cp1252 leaves five bytes undefined, Latin-1 none
        return data.decode("latin-1" if set(data) & set(b"\x81\x8d\x8f\x90\x9d") else "cp1252")


def _decode(data: bytes, encoding: str, where: str) -> str:
    try:
        return data.decode(encoding)
    except UnicodeDecodeError as error:
        raise RigInputError(f"{where}: byte {error.start} is not {encoding} text, as its first bytes say") from error


def _unmarked_utf16(data: bytes) -> str:
    """Return the byte order of UTF-16 without a mark: ASCII signs beside a zero each; empty for other text."""
    begin = data[:256]
    if len(begin) < 4 or len(data) % 2:
        return ""
    for order, zeros, signs in (("utf-16-le", begin[1::2], begin[::2]), ("utf-16-be", begin[::2], begin[1::2])):
        if zeros.count(0) > 0.9 * len(zeros) and 0 not in signs:
            return order
    return ""
