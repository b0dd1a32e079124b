"""The records of a trial's journal: their bytes, and what can be read of a file that may end anywhere.

``trial_NNNN.journal`` is a sequence of records: magic ``PAJ1``, kind, sequence number, first sample, number of samples,
payload length, CRC-32 of all that and of the payload, payload; little-endian. Kinds in this order: the trial's head
(JSON), the motor command (float64, V), blocks (force N, force raw, counts of three encoders and, where the camera is
counted, of its exposures, as int64, then the further channels that the head names, as float64), the end (JSON: status,
reason). Space reserved for later records is zero. Reading stops at the first record that is not complete and next in
sequence: the result is always the beginning of what was written, whatever happened to the file.
"""

from __future__ import annotations

import json
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np

from rig.atomic_write import translate_os_error
from rig.backend import Block
from rig.session.trial_head import TrialHead

MAGIC = b"PAJ1"
HEAD, COMMAND, BLOCK, END = 1, 2, 3, 4
ENCODERS = 3
_CHUNK = 1 << 20
_FIXED = struct.Struct("<4sIQQII")
_CRC = struct.Struct("<I")
OVERHEAD = _FIXED.size + _CRC.size
"""Bytes of a record without its payload."""


class Record(NamedTuple):
    kind: int
    sequence: int
    first_sample: int
    n: int
    payload: bytes


@dataclass(frozen=True, eq=False)
class Journal:
    """The undamaged beginning of a journal.

    ``head`` is None when not even that is complete; ``n_samples`` were found before the first damage;
    ``ending`` is (status, reason) when the recorder wrote its closing record;
    ``left_over`` counts bytes after the last complete record that are not zero, e.g. of a torn record, and
    ``records_behind`` is True when later records follow the damage; ``n_bytes`` and ``n_records`` are what was read;
    ``only_begun`` is True when the recorder was stopped before its first block was whole: no sample can be behind.
    """

    head: TrialHead | None
    n_samples: int
    ending: tuple[str, str] | None
    left_over: int
    records_behind: bool
    n_bytes: int
    n_records: int
    only_begun: bool = False


def bytes_per_sample(head: TrialHead) -> int:
    """Bytes of one sample of every channel, at most: 8 fewer without a counted camera."""
    return 8 * (2 + ENCODERS + 1 + len(head.channels))


def encode(kind: int, sequence: int, first_sample: int, n: int, payload: bytes) -> bytes:
    fixed = _FIXED.pack(MAGIC, kind, sequence, first_sample, n, len(payload))
    return fixed + _CRC.pack(zlib.crc32(payload, zlib.crc32(fixed))) + payload


def encode_block(block: Block) -> bytes:
    """Bytes of a block as the journal stores them, little-endian: force (N), electrical readings, encoder counts (n, 3)
    row by row, then, where recorded, exposure counts and further channels (n, k)."""
    columns = (block.force_n, block.force_raw)
    floats = b"".join(np.ascontiguousarray(column, dtype="<f8").tobytes() for column in columns)
    counts = np.ascontiguousarray(block.encoder_count, dtype="<i8").tobytes()
    if block.exposure_count is not None:
        counts += np.ascontiguousarray(block.exposure_count, dtype="<i8").tobytes()
    if block.channel_values is not None:
        counts += np.ascontiguousarray(block.channel_values, dtype="<f8").tobytes()
    return floats + counts


def read_records(stream: BinaryIO, first_sequence: int = 0) -> Iterator[Record]:
    """Yield the records at the stream's position one by one, numbered from ``first_sequence``; stop without an error at
    the first that is incomplete, damaged or out of sequence."""
    expected = first_sequence
    while True:
        start = stream.read(OVERHEAD)
        if len(start) < OVERHEAD:
            return
        magic, kind, sequence, first, n, length = _FIXED.unpack_from(start)
        if magic != MAGIC or sequence != expected:
            return
        (crc,) = _CRC.unpack_from(start, _FIXED.size)
        payload = stream.read(length)
        if len(payload) != length or zlib.crc32(payload, zlib.crc32(start[: _FIXED.size])) != crc:
            return
        yield Record(kind, sequence, first, n, payload)
        expected += 1


def scan(stream: BinaryIO) -> Journal:
    """Summary of a journal up to its first damage: head, number of samples, ending, and what lies behind; its samples
    are checked but not kept. Never raises for what the file holds."""
    head_json: bytes | None = None
    head: TrialHead | None = None
    ending: tuple[str, str] | None = None
    at = count = samples = 0
    for record in read_records(stream):
        try:
            if record.kind == HEAD and record.sequence == 0:
                head_json = record.payload
            elif record.kind == COMMAND and record.sequence == 1 and head_json is not None:
                head = TrialHead.from_plain(json.loads(head_json), np.frombuffer(record.payload, dtype="<f8"))
            elif record.kind == BLOCK and head is not None and ending is None and record.first_sample == samples:
                samples += decode_block(record, head).force_n.size
            elif record.kind == END and head is not None and record.first_sample == samples:
                plain = json.loads(record.payload)
                ending = (str(plain["status"]), str(plain["reason"]))
            else:
                break
        except (ValueError, TypeError, KeyError, AttributeError, OverflowError, RecursionError):
            break
        at, count = at + OVERHEAD + len(record.payload), count + 1
    stream.seek(at)
    left_over, behind = _scan_rest(stream)
    stream.seek(at)
    only_begun = not samples and not behind and _is_begun_record(stream.read(OVERHEAD), count)
    return Journal(head, samples, ending, left_over, behind, at, count, only_begun)


def _is_begun_record(data: bytes, sequence: int) -> bool:
    """Whether the first bytes of what follows are those of record ``sequence``, as far as they were written."""
    written = data.rstrip(b"\0")
    kind = (HEAD, COMMAND, BLOCK)[min(sequence, 2)]
    return _FIXED.pack(MAGIC, kind, sequence, 0, 0, 0)[: len(written)].startswith(written[: len(MAGIC) + 8])


def _scan_rest(stream: BinaryIO) -> tuple[int, bool]:
    """Bytes from the stream's position to the last that is not zero, and whether a record's mark stands anywhere in
    them but at their start (records behind a damage)."""
    last = size = 0
    behind, before = False, b""
    while chunk := stream.read(_CHUNK if size else 1):  # a torn record begins at the very first byte
        if bare := len(chunk.rstrip(b"\0")):
            last = size + bare
        behind = behind or MAGIC in before + chunk
        before = (before + chunk)[1 - len(MAGIC) :] if size else b""
        size += len(chunk)
    return last, behind


def scan_journal(path: Path) -> Journal:
    with translate_os_error(path, "read"), path.open("rb") as stream:
        return scan(stream)


def stored_blocks(path: Path, scanned: Journal) -> Iterator[Block]:
    with translate_os_error(path, "read"), path.open("rb") as stream:
        yield from decode_blocks(stream, scanned)


def decode_blocks(stream: BinaryIO, scanned: Journal) -> Iterator[Block]:
    for record in islice(read_records(stream), scanned.n_records):
        if record.kind == BLOCK and scanned.head is not None:
            yield decode_block(record, scanned.head)


def decode_block(record: Record, head: TrialHead) -> Block:
    """Return the block of samples that a record holds; ValueError when its length does not fit the channels that the
    trial's head names."""
    n, further = record.n, len(head.channels)
    most = n * bytes_per_sample(head)
    if len(record.payload) not in (most - 8 * n, most):
        raise ValueError("length of a block")
    counted = len(record.payload) == most and n > 0
    force_n, force_raw = np.frombuffer(record.payload, dtype="<f8", count=2 * n).reshape(2, n)
    count = np.frombuffer(record.payload, dtype="<i8", count=ENCODERS * n, offset=16 * n).reshape(n, ENCODERS)
    behind = 8 * n * (2 + ENCODERS)
    exposures = np.frombuffer(record.payload, dtype="<i8", count=n, offset=behind) if counted else None
    values = None
    if further:
        behind += 8 * n * counted
        values = np.frombuffer(record.payload, dtype="<f8", count=n * further, offset=behind).reshape(n, further)
    return Block(record.first_sample, force_n, force_raw, count, exposures, values)
