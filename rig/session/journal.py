"""The journal of a trial: its head, the bytes of its records, the thread that writes them, a view of it as it grows.

The head is what is known of a trial before its first sample, and makes a trial of blocks. It opens the journal.
Recorder and recovery both assemble trials here, so that a recovered trial is the one that would have been sealed. The
frame clock leads from the camera's pulses, or from its counted exposures, to the times of the frames.

``trial_NNNN.journal`` is a sequence of records: magic ``PAJ1``, kind, sequence number, first sample, number of samples,
payload length, CRC-32 of all that and of the payload, payload; little-endian. Kinds in this order: the trial's head
(JSON), the motor command (float64, V), blocks (force N, force raw, counts of three encoders and, where the camera is
counted, of its exposures, as int64, then the further channels that the head names, as float64), the end (JSON: status,
reason). Space reserved for later records is zero. Reading stops at the first record that is not complete and next in
sequence: the result is always the beginning of what was written, whatever happened to the file.

Every block of the trial in progress is on its way to the disk before any observer receives it: recorder → queue → one
writing thread → file; removed once the trial is sealed in HDF5. *Committed* means that the operating system has taken
the bytes: killing the program cannot lose them. They are forced onto the disk itself at least every second and when the
journal is closed: a power failure loses no more than that.

:meth:`JournalWriter.append` returns when its block is committed, normally within a millisecond. When the disk is slow
it stops waiting after 50 ms, so that the limits go on being watched, and does not wait again until the disk has caught
up; when a block has waited 5 s, or the disk refuses, it raises :class:`rig.errors.RecordingFault`. Room for the longest
possible trial is reserved before the motor moves, so that a full disk is noticed then.

The live view of a session that another process records shows the journal of the current trial, then the sealed trial.
The journal is opened for reading, read from where the last read ended, and closed at once: no lock is taken and nothing
is written, so the recording cannot be disturbed. Only complete records in sequence are taken; the rest is read next
time.
"""

from __future__ import annotations

import io
import json
import os
import struct
import threading
import time
import zlib
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from itertools import islice
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig import platform_calls
from rig.arrays import ArrayRecord
from rig.atomic_write import refused
from rig.backend import Block, Timing
from rig.configuration.profile import MotorCommand
from rig.configuration.rig_file import CameraConfig, RigConfig
from rig.errors import HardwareFault, RecordingFault, RigInputError, is_defect
from rig.session.annotation_file import utc_now
from rig.session.folder import Session
from rig.session.info import PASSIVE, ChannelInfo, EncoderInfo, ForceInfo, restored
from rig.session.trial_data import CameraInfo, TrialData


@dataclass(frozen=True)
class FrameClock:
    """Clock of the frame pulses: rate, Hz; first rising edge, exposure and standard uncertainty of the times, s."""

    frame_rate_hz: float
    first_pulse_s: float
    exposure_s: float
    u_time_s: float
    counted: bool = False
    """The camera runs by itself; rate and first pulse are nominal, the counted exposures tell the real ones."""

    @classmethod
    def of(cls, camera: CameraConfig | None, timing: Timing) -> FrameClock | None:
        """Return the clock of a configured camera; None without one."""
        if camera is None:
            return None
        if camera.mode == "counted":
            return cls(camera.frame_rate_hz, 0.0, camera.exposure_s, camera.u_time_s, counted=True)
        if timing.frame_rate_hz is None or timing.first_pulse_s is None:
            return None
        return cls(timing.frame_rate_hz, timing.first_pulse_s, camera.exposure_s, camera.u_time_s)

    def frames_counted(self, time_s: NDArray[np.float64], count: NDArray[np.int64]) -> CameraInfo | None:
        """Return the frames of a camera whose exposures were counted at each sample, (n,); None with fewer than three.

        The k-th exposure began within the sample interval in which the count passed k. Every straight line through
        all these intervals is possible: the middle one is taken, and the standard uncertainty is that of a time that
        is anywhere between the extreme ones. Where no line fits, the camera was irregular and has no frame clock. When
        those before the first sample began is not known: a counter without a start trigger counts once it is armed.
        """
        at = np.flatnonzero(np.diff(count, prepend=count[:1]) > 0)
        number = (count[at] - 1).astype(float)
        if at.size < 3 or number[-1] <= number[0]:
            return None
        interval_s = float(time_s[1] - time_s[0])
        late_s, early_s = time_s[at], time_s[at] - interval_s
        span = number[-1] - number[0]
        guess_s = np.polyfit(number, late_s - interval_s / 2, 1)[0]
        periods = guess_s + np.linspace(-2.0, 2.0, 801) * interval_s / span
        lowest = np.array([np.max(early_s - period * number) for period in periods])
        highest = np.array([np.min(late_s - period * number) for period in periods])
        possible = lowest <= highest
        if not possible.any():
            return None
        periods, lowest, highest = periods[possible], lowest[possible], highest[possible]
        ends = [(lowest + periods * k, highest + periods * k) for k in (number[0], number[-1])]
        middle = [(low.min() + high.max()) / 2 for low, high in ends]
        half_s = max((high.max() - low.min()) / 2 for low, high in ends)
        period_s = (middle[1] - middle[0]) / span
        return CameraInfo(
            frame_rate_hz=float(1.0 / period_s),
            first_frame_time_s=float(middle[0] - number[0] * period_s) + self.exposure_s / 2,
            exposure_s=self.exposure_s,
            n_frames=int(count[-1]),
            u_time_s=float(np.hypot(self.u_time_s, half_s / np.sqrt(3.0))),
        )

    def frames_until(self, end_s: float) -> CameraInfo:
        frames = int(np.floor((end_s - self.first_pulse_s - self.exposure_s) * self.frame_rate_hz + 1e-9)) + 1
        return CameraInfo(
            frame_rate_hz=self.frame_rate_hz,
            first_frame_time_s=self.first_pulse_s + self.exposure_s / 2,
            exposure_s=self.exposure_s,
            n_frames=max(frames, 0),
            u_time_s=self.u_time_s,
        )


@dataclass(frozen=True, eq=False)
class TrialHead:
    """All of a trial except the input samples; ``command_v`` is the whole motor command, V."""

    number: int
    started_utc: str
    simulated: bool
    sample_rate_hz: float
    blow_start_s: float
    command_v: NDArray[np.float64]
    encoders: tuple[EncoderInfo, ...]
    force_info: ForceInfo
    frame_clock: FrameClock | None = None
    condition: str = ""
    plan_entry: int = 0
    channels: tuple[ChannelInfo, ...] = ()
    provenance: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def of(
        cls,
        config: RigConfig,
        timing: Timing,
        command: MotorCommand,
        *,
        number: int,
        simulated: bool,
        condition: str = "",
        plan_entry: int = 0,
    ) -> TrialHead:
        """Return the head of trial ``number``, which begins now, from the rig file and the device's timing."""
        return cls(
            number=number,
            started_utc=utc_now(),
            simulated=simulated,
            sample_rate_hz=timing.sample_rate_hz,
            blow_start_s=command.blow_start_s,
            command_v=command.volts,
            encoders=tuple(EncoderInfo.of(encoder) for encoder in config.encoders),
            force_info=replace(
                ForceInfo.of(config, timing.force_group_delay_s), device_scaling=timing.force_device_scaling
            ),
            frame_clock=FrameClock.of(config.camera, timing),
            condition=condition,
            plan_entry=plan_entry,
            channels=(
                *(ChannelInfo.of(channel) for channel in config.channels),
                *([ChannelInfo.opposite_head(config)] if config.key_opposite is not None else []),
            ),
        )

    def to_plain(self) -> dict[str, Any]:
        """Return all but the command as numbers, text and lists."""
        plain = asdict(replace(self, command_v=np.empty(0)))
        del plain["command_v"]
        return plain

    @classmethod
    def from_plain(cls, plain: dict[str, Any], command_v: NDArray[np.float64]) -> TrialHead:
        """Restore a head from :meth:`to_plain`; raises KeyError, TypeError or ValueError for anything else."""
        clock = plain["frame_clock"]
        return cls(
            number=int(plain["number"]),
            started_utc=str(plain["started_utc"]),
            simulated=bool(plain["simulated"]),
            sample_rate_hz=float(plain["sample_rate_hz"]),
            blow_start_s=float(plain["blow_start_s"]),
            command_v=command_v,
            encoders=tuple(EncoderInfo(**encoder) for encoder in plain["encoders"]),
            force_info=restored(ForceInfo, plain["force_info"]),
            frame_clock=FrameClock(**clock) if clock else None,
            condition=str(plain.get("condition", "")),
            plan_entry=int(plain.get("plan_entry", 0)),
            channels=tuple(ChannelInfo.from_plain(channel) for channel in plain.get("channels", [])),
            provenance={str(key): str(value) for key, value in plain.get("provenance", {}).items()},
        )

    def assemble(self, blocks: Sequence[Block], status: str, reason: str) -> TrialData:
        part = self.part(blocks, 0)
        return replace(part, status=status, reason=reason, camera=self.camera(blocks, part.n_valid))

    def part(self, blocks: Sequence[Block], first_sample: int) -> TrialData:
        """Return the samples of ``blocks`` as the part of the trial from ``first_sample`` on, without camera."""
        end = first_sample
        for block in blocks:
            if block.first_sample != end:
                raise HardwareFault(
                    f"trial {self.number}: a block starts at sample {block.first_sample}, expected {end}; "
                    "samples are missing"
                )
            end += block.force_n.size
        volts = np.zeros(end - first_sample)
        commanded = self.command_v[first_sample:end]
        volts[: commanded.size] = commanded
        known = {one.name: getattr(self, one.name) for one in fields(self)}
        del known["command_v"], known["frame_clock"]
        joined = blocks or (self._no_samples(first_sample),)
        return TrialData(
            **known,
            status="incomplete",
            time_s=np.arange(first_sample, end) / self.sample_rate_hz,
            raw_force_n=np.concatenate([block.force_n for block in joined]),
            force_raw=np.concatenate([block.force_raw for block in joined]),
            motor_command_v=volts,
            encoder_count=np.concatenate([block.encoder_count for block in joined]),
            channel_values=np.concatenate([block.channel_values for block in joined]) if self.channels else None,
        )

    def _no_samples(self, first_sample: int) -> Block:
        none = np.empty(0)
        values = np.empty((0, len(self.channels))) if self.channels else None
        return Block(first_sample, none, none, np.empty((0, len(self.encoders)), dtype=np.int64), None, values)

    def camera(self, blocks: Iterable[Block], n_samples: int) -> CameraInfo | None:
        """Return the frames of a trial of ``n_samples``, by the counted exposures where it runs by itself."""
        if self.frame_clock is None:
            return None
        if not self.frame_clock.counted:
            return self.frame_clock.frames_until((n_samples - 1) / self.sample_rate_hz)
        counts = [block.exposure_count for block in blocks]
        if not counts or any(count is None for count in counts):
            return None
        counted = np.concatenate([count for count in counts if count is not None])
        return self.frame_clock.frames_counted(np.arange(n_samples) / self.sample_rate_hz, counted)


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


def block_payload(block: Block) -> bytes:
    columns = (block.force_n, block.force_raw)
    floats = b"".join(np.ascontiguousarray(column, dtype="<f8").tobytes() for column in columns)
    counts = np.ascontiguousarray(block.encoder_count, dtype="<i8").tobytes()
    if block.exposure_count is not None:
        counts += np.ascontiguousarray(block.exposure_count, dtype="<i8").tobytes()
    if block.channel_values is not None:
        counts += np.ascontiguousarray(block.channel_values, dtype="<f8").tobytes()
    return floats + counts


def records(stream: BinaryIO, first_sequence: int = 0) -> Iterator[Record]:
    """Yield the complete records that follow in ``stream``, in sequence from ``first_sequence``, one in memory."""
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
    """Check a journal up to the first damage, one block in memory; never raises for what it holds."""
    head_json: bytes | None = None
    head: TrialHead | None = None
    ending: tuple[str, str] | None = None
    at = count = samples = 0
    for record in records(stream):
        try:
            if record.kind == HEAD and record.sequence == 0:
                head_json = record.payload
            elif record.kind == COMMAND and record.sequence == 1 and head_json is not None:
                head = TrialHead.from_plain(json.loads(head_json), np.frombuffer(record.payload, dtype="<f8"))
            elif record.kind == BLOCK and head is not None and ending is None and record.first_sample == samples:
                samples += block_of(record, head).force_n.size
            elif record.kind == END and head is not None and record.first_sample == samples:
                plain = json.loads(record.payload)
                ending = (str(plain["status"]), str(plain["reason"]))
            else:
                break
        except (ValueError, TypeError, KeyError, AttributeError, OverflowError, RecursionError):
            break
        at, count = at + OVERHEAD + len(record.payload), count + 1
    stream.seek(at)
    left_over, behind = _remains(stream)
    stream.seek(at)
    only_begun = not samples and not behind and _begins_a_record(stream.read(OVERHEAD), count)
    return Journal(head, samples, ending, left_over, behind, at, count, only_begun)


def _begins_a_record(data: bytes, sequence: int) -> bool:
    """Whether the first bytes of what follows are those of record ``sequence``, as far as they were written."""
    written = data.rstrip(b"\0")
    kind = (HEAD, COMMAND, BLOCK)[min(sequence, 2)]
    return _FIXED.pack(MAGIC, kind, sequence, 0, 0, 0)[: len(written)].startswith(written[: len(MAGIC) + 8])


def _remains(stream: BinaryIO) -> tuple[int, bool]:
    """Return the bytes of the rest up to the last that is not zero, and whether a record begins behind its first."""
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
    """Check a journal file; raises RigInputError only when the file itself cannot be read."""
    with refused(path, "read"), path.open("rb") as stream:
        return scan(stream)


def stored_blocks(path: Path, scanned: Journal) -> Iterator[Block]:
    """Yield the blocks of a journal that was scanned, one at a time; raises as :func:`scan_journal`."""
    with refused(path, "read"), path.open("rb") as stream:
        yield from blocks_of(stream, scanned)


def blocks_of(stream: BinaryIO, scanned: Journal) -> Iterator[Block]:
    for record in islice(records(stream), scanned.n_records):
        if record.kind == BLOCK and scanned.head is not None:
            yield block_of(record, scanned.head)


def block_of(record: Record, head: TrialHead) -> Block:
    """Return the block a record holds; ValueError when its length does not fit the head's channels."""
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


PATIENCE_S = 0.05
STALL_LIMIT_S = 5.0
SYNC_EVERY_S = 1.0
CLOSE_LIMIT_S = 30.0


class JournalWriter:
    """Writes the journal of one trial.

    Parameters
    ----------
    path : Path
        File to create; must not exist.
    head : TrialHead
        Written and committed before the constructor returns.
    most_samples, most_blocks : int
        Largest trial for which room is reserved.
    write, synchronise, now_s : callable
        The system's calls, to be replaced in tests.
    """

    def __init__(
        self,
        path: Path,
        head: TrialHead,
        most_samples: int = 0,
        most_blocks: int = 0,
        *,
        write: Callable[[int, bytes], int] = os.write,
        synchronise: Callable[[int], None] = platform_calls.synchronise,
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self.path = path
        self._write, self._synchronise, self._now_s = write, synchronise, now_s
        self._condition = threading.Condition()
        self._waiting: deque[tuple[bytes, int, float]] = deque()
        """(bytes, samples committed once they are written, time of arrival)"""
        self._committed = self._synced = self._samples = self._sequence = 0
        self._error: BaseException | None = None
        self._closing = self._stalled = False
        first = self._record(HEAD, 0, json.dumps(head.to_plain()).encode())
        command = np.ascontiguousarray(head.command_v, dtype="<f8").tobytes()
        beginning = first + self._record(COMMAND, head.command_v.size, command)
        room = len(beginning) + most_samples * bytes_per_sample(head) + (most_blocks + 1) * OVERHEAD + 4096
        with refused(path, "created"):
            self._file = platform_calls.open_raw(path, os.O_RDWR | os.O_CREAT | os.O_EXCL)
        try:
            platform_calls.lock(self._file)
            platform_calls.reserve(self._file, path, room)
            self._write_all(beginning)
            self._synchronise(self._file)
        except OSError as error:
            os.close(self._file)
            path.unlink(missing_ok=True)
            raise RigInputError(
                f"{path}: no room for a trial of {room / 1e6:.1f} MB ({error.strerror or error}); free some space"
            ) from error
        self._thread = threading.Thread(target=self._run, name=f"journal {path.name}", daemon=True)
        self._thread.start()

    @property
    def committed_samples(self) -> int:
        """Samples that survive when the program is killed."""
        return self._committed

    @property
    def synced_samples(self) -> int:
        """Samples that have been forced onto the disk."""
        return self._synced

    def append(self, block: Block) -> int:
        """Queue the next block; return the number of samples committed."""
        n = block.force_n.size
        if block.first_sample != self._samples:
            raise RecordingFault(
                f"{self.path}: a block starts at sample {block.first_sample}, expected {self._samples}", phase="write"
            )
        payload = block_payload(block)
        with self._condition:
            self._raise_error()
            self._samples += n
            now_s = self._now_s()
            self._waiting.append((self._record(BLOCK, n, payload, block.first_sample), self._samples, now_s))
            self._condition.notify_all()
            if not self._stalled:
                self._condition.wait_for(lambda: not self._waiting or self._error is not None, PATIENCE_S)
            self._stalled = bool(self._waiting)
            self._raise_error()
            if self._waiting and now_s - self._waiting[0][2] > STALL_LIMIT_S:
                raise RecordingFault(
                    f"{self.path}: the disk has taken nothing for {now_s - self._waiting[0][2]:.1f} s, allowed "
                    f"{STALL_LIMIT_S:g} s; record to a faster disk",
                    phase="write",
                )
            return self._committed

    def close(self, status: str, reason: str) -> None:
        """Write the closing record, force all onto the disk and close the file."""
        with self._condition:
            if self._error is None:
                ending = json.dumps({"status": status, "reason": reason}).encode()
                record = self._record(END, 0, ending, self._samples)
                self._waiting.append((record, self._samples, self._now_s()))
            self._closing = True
            self._condition.notify_all()
        self._thread.join(CLOSE_LIMIT_S)
        if self._thread.is_alive():
            raise RecordingFault(f"{self.path}: the disk hangs; {self._committed} samples are safe", phase="write")
        os.close(self._file)
        self._raise_error()

    def remove(self) -> None:
        """Delete the journal of a trial that is sealed, or has no sample."""
        platform_calls.remove(self.path)

    def _record(self, kind: int, n: int, payload: bytes, first_sample: int = 0) -> bytes:
        record = encode(kind, self._sequence, first_sample, n, payload)
        self._sequence += 1
        return record

    def _raise_error(self) -> None:
        own = self._error is not None and is_defect(self._error) and not isinstance(self._error, OSError)
        if self._error is not None and (own or isinstance(self._error, RecordingFault)):
            raise self._error
        if self._error is not None:
            words = getattr(self._error, "strerror", None) or f"{type(self._error).__name__}: {self._error}"
            raise RecordingFault(
                f"{self.path}: cannot be written ({words}); {self._committed} samples are safe, free some space",
                phase="write",
            ) from self._error

    def _write_all(self, data: bytes) -> None:
        view = memoryview(data)
        while view:
            view = view[self._write(self._file, view) :]  # type: ignore[arg-type]

    def _run(self) -> None:
        try:
            last_sync_s = self._now_s()
            while self._step():
                if self._synced < self._committed and self._now_s() - last_sync_s >= 0.5 * SYNC_EVERY_S:
                    self._sync()
                    last_sync_s = self._now_s()
            self._sync()
        except BaseException as error:
            with self._condition:
                self._error = error
                self._condition.notify_all()

    def _step(self) -> bool:
        """Write the next record; return whether more may follow."""
        with self._condition:
            if not self._waiting and not self._closing:
                self._condition.wait(0.25 * SYNC_EVERY_S)
            if not self._waiting:
                return not self._closing
            data, samples, _ = self._waiting[0]
        self._write_all(data)
        with self._condition:
            self._waiting.popleft()
            self._committed = samples
            self._condition.notify_all()
        return True

    def _sync(self) -> None:
        samples = self._committed
        if platform_calls.is_deleted(self._file):
            raise RecordingFault(
                f"{self.path}: was deleted while it was being written; its samples are lost", phase="write"
            )
        self._synchronise(self._file)
        self._synced = samples


OpenJournal = Callable[[Path, TrialHead, int, int], JournalWriter]
"""Creates the journal of a trial: path, head, largest number of samples and of blocks."""


KEEP_S = 30.0
"""How much of a trial in progress is kept and shown, s: a long one must not fill the memory."""

LOOKS = 3
"""Without a journal, one after the other, that show the end of a recording of what somebody plays."""
READ_BYTES = 2_000_000
"""Most that a poll reads of a journal whose head is known: some seconds of a dozen channels."""


class JournalFollower:
    """Reads a growing journal incrementally; ``head`` is None until it is complete.

    ``blocks`` are the last 30 s, ``first_count`` the encoders' counts at the trial's first sample.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.head: TrialHead | None = None
        self.blocks: list[Block] = []
        self.first_count: NDArray[np.int64] | None = None
        self._n_bytes = self._n_records = 0

    def poll(self) -> bool:
        """Read what was written since the last poll; False when the journal is gone."""
        try:
            with self.path.open("rb") as stream:
                stream.seek(self._n_bytes)
                # beyond the last record lie the zeros set aside for the whole trial, which are not read again and again
                data = stream.read() if self.head is None else stream.read(READ_BYTES)
        except OSError:
            return False
        if self.head is None:
            journal = scan(io.BytesIO(data))
            if journal.head is not None:
                self.head, self.blocks = journal.head, list(blocks_of(io.BytesIO(data), journal))
                self._n_bytes, self._n_records = journal.n_bytes, journal.n_records
                self._drop_old(self.head)
            return True
        for record in records(io.BytesIO(data), self._n_records):
            self._n_bytes += OVERHEAD + len(record.payload)
            self._n_records += 1
            if record.kind == BLOCK:
                self.blocks.append(block_of(record, self.head))
        self._drop_old(self.head)
        return True

    def _drop_old(self, head: TrialHead) -> None:
        if not self.blocks:
            return
        if self.first_count is None:
            self.first_count = self.blocks[0].encoder_count[:1]
        last = self.blocks[-1]
        oldest = last.first_sample + last.force_n.size - KEEP_S * head.sample_rate_hz
        kept = next(k for k, block in enumerate(self.blocks) if block.first_sample + block.force_n.size > oldest)
        del self.blocks[:kept]


@dataclass(frozen=True, eq=False)
class LiveView(ArrayRecord):
    """A session at one moment."""

    # trial, trials: number of the trial, and how many the plan has
    trial: int
    trials: int
    state: str  # ``recording``, or the status of a sealed trial
    condition: str
    # time_s, force_n: (n,), of a trial in progress the last 30 s
    time_s: NDArray[np.float64]
    force_n: NDArray[np.float64]
    angle_rad: NDArray[np.float64]  # (n, len(names)), of the bodies ``names`` from the first sample on
    names: tuple[str, ...]
    sealed: int  # trials sealed so far

    @property
    def finished(self) -> bool:
        """Whether nothing is being recorded and the plan's trials are there."""
        return self.state != "recording" and self.sealed >= self.trials


class SessionFollower:
    """Reads a session repeatedly; one journal is read on from where the last poll ended."""

    def __init__(self, session: str | Path) -> None:
        self.session = Session.open(session, require_trials=False)
        self._journal: JournalFollower | None = None
        self._idle = 0

    @property
    def ended(self) -> bool:
        """Whether nobody plays any more: as long as somebody may, a journal lies there, but for an instant."""
        return self.session.info.profile.name == PASSIVE and self._idle >= LOOKS

    def poll(self) -> LiveView | None:
        """Return the present view; None before the first sample."""
        journals = self.session.journals
        if journals:
            path = list(journals.values())[-1]
            if self._journal is None or self._journal.path != path:
                self._journal = JournalFollower(path)
            if self._journal.poll() and self._journal.head is not None and self._journal.blocks:
                blocks, zero = self._journal.blocks, self._journal.first_count
                part = self._journal.head.part(blocks, blocks[0].first_sample)
                return self._view(replace(part, status="recording"), len(self.session.trials), zero)
        trials = self.session.trials
        self._idle = 0 if journals or not (trials or self._journal) else self._idle + 1
        return self._view(trials[-1].read(), len(trials)) if trials else None

    def _view(self, data: TrialData, sealed: int, zero: NDArray[np.int64] | None = None) -> LiveView:
        return LiveView(
            data.number, self.session.info.plan.trials, data.status, data.condition, data.time_s, data.raw_force_n,
            data.angle_rad(zero), tuple(encoder.name for encoder in data.encoders), sealed,
        )  # fmt: skip
