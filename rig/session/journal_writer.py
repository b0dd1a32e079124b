"""The thread that writes the journal of a trial: every block is on its way to the disk before any observer receives it.

*Committed* means that the operating system has taken the bytes: killing the program cannot lose them. They are forced
onto the disk at least every second and when the journal is closed: a power failure loses no more than that. Room for
the longest possible trial is reserved before the motor moves.

:meth:`JournalWriter.append` returns when its block is committed. When the disk is slow it stops waiting after 50 ms, so
that the limits go on being watched; when a block has waited 5 s, or the disk refuses, it raises
:class:`rig.errors.RecordingFault`.
"""

from __future__ import annotations

import json
import mmap
import os
import threading
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path

import numpy as np

from rig import platform_calls
from rig.atomic_write import translate_os_error
from rig.backend import Block
from rig.errors import RecordingFault, RigInputError, is_defect
from rig.session.journal_records import BLOCK, COMMAND, END, HEAD, OVERHEAD, bytes_per_sample, encode, encode_block
from rig.session.trial_head import TrialHead

PATIENCE_S = 0.05  # between two looks at what waits to be written
STALL_LIMIT_S = 5.0  # without a block written, after which the disk is said to stall
SYNC_EVERY_S = 1.0
CLOSE_LIMIT_S = 30.0  # for the rest to be written at the end: a network folder may take seconds


class JournalWriter:
    """Writes the journal of one trial.

    Parameters
    ----------
    path : file to create; must not exist
    head : written and committed before the constructor returns
    most_samples, most_blocks : largest trial for which room is reserved
    write, synchronise, now_s : the system's calls, to be replaced in tests
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
        room = len(beginning) + most_samples * bytes_per_sample(head) + (most_blocks + 1) * OVERHEAD
        room += mmap.PAGESIZE  # that the end may begin
        with translate_os_error(path, "created"):
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
        """Queue the next block for the writing thread, wait for it 50 ms at most, and return the number of samples
        written so far; RecordingFault where samples are missing before it, writing failed, or the disk took nothing for
        5 s."""
        n = block.force_n.size
        if block.first_sample != self._samples:
            raise RecordingFault(
                f"{self.path}: a block starts at sample {block.first_sample}, expected {self._samples}", phase="write"
            )
        payload = encode_block(block)
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
        """Write the closing record with a trial's ``status`` and ``reason``, force all onto the disk and close the
        file; RecordingFault where writing failed or takes longer than 30 s."""
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
        platform_calls.remove(self.path)

    def _record(self, kind: int, n: int, payload: bytes, first_sample: int = 0) -> bytes:
        """Bytes of the next record, of ``n`` samples; the sequence number goes on."""
        record = encode(kind, self._sequence, first_sample, n, payload)
        self._sequence += 1
        return record

    def _raise_error(self) -> None:
        """Raise what the writing thread failed with as `RecordingFault`, a defect of a program as itself; return where
        it did not fail."""
        is_own_defect = self._error is not None and is_defect(self._error) and not isinstance(self._error, OSError)
        if self._error is not None and (is_own_defect or isinstance(self._error, RecordingFault)):
            raise self._error
        if self._error is not None:
            reason = getattr(self._error, "strerror", None) or f"{type(self._error).__name__}: {self._error}"
            raise RecordingFault(
                f"{self.path}: cannot be written ({reason}); {self._committed} samples are safe, free some space",
                phase="write",
            ) from self._error

    def _write_all(self, data: bytes) -> None:
        view = memoryview(data)
        while view:
            view = view[self._write(self._file, view) :]  # type: ignore[arg-type]

    def _run(self) -> None:
        """Write queued records and sync them, about once a second, until the journal is closed: the body of its own
        thread, whose error the next call of another raises."""
        try:
            last_sync_s = self._now_s()
            while self._write_next():
                if self._synced < self._committed and self._now_s() - last_sync_s >= 0.5 * SYNC_EVERY_S:
                    self._sync()
                    last_sync_s = self._now_s()
            self._sync()
        except BaseException as error:
            with self._condition:
                self._error = error
                self._condition.notify_all()

    def _write_next(self) -> bool:
        """Write the oldest queued record, waiting for one for a while; return False once the queue is empty and the
        journal is to be closed."""
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
        """Force what was written onto the disk (fsync) and note how many samples that makes safe; raise
        `RecordingFault` where the file was deleted."""
        samples = self._committed
        if platform_calls.is_deleted(self._file):
            raise RecordingFault(
                f"{self.path}: was deleted while it was being written; its samples are lost", phase="write"
            )
        self._synchronise(self._file)
        self._synced = samples


OpenJournal = Callable[[Path, TrialHead, int, int], JournalWriter]
"""Creates the journal of a trial: path, head, largest number of samples and of blocks."""
