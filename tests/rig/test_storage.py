"""Files are whole or absent.

Platform calls: this system's, and the Windows branch with Windows' functions put in its place.
"""

from __future__ import annotations

import os
import signal
import sys
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import pytest

from rig import InputError, Session, platform_calls, read_channels
from rig import recover as recover_session
from rig.atomic_write import replace_when_complete, write_text
from rig.session.journal_writer import JournalWriter


def test_an_exception_while_writing_leaves_the_old_file_and_nothing_else(tmp_path) -> None:
    path = tmp_path / "a.txt"
    write_text(path, "old")
    with pytest.raises(RuntimeError), replace_when_complete(path) as temporary:
        temporary.write_text("half")
        raise RuntimeError
    assert path.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["a.txt"]


def test_a_folder_that_is_not_there_gives_one_clear_line(tmp_path) -> None:
    with pytest.raises(InputError, match="cannot be written .* choose a writable place"):
        write_text(tmp_path / "no" / "a.txt", "x")


class FakeMsvcrt:
    """Byte-range locks as Windows keeps them: one holder per file and byte."""

    LK_NBLCK = 2

    def __init__(self) -> None:
        self.held: dict[tuple[int, int], int] = {}
        self.calls: list[tuple[int, int]] = []

    def locking(self, descriptor: int, mode: int, n: int) -> None:
        at = os.lseek(descriptor, 0, os.SEEK_CUR)
        self.calls.append((at, n))
        key = (os.fstat(descriptor).st_ino, at)
        if mode != self.LK_NBLCK or self.held.get(key, descriptor) != descriptor:
            raise PermissionError(13, "Permission denied")
        self.held[key] = descriptor

    def closed(self, descriptor: int) -> None:
        """Drop the locks of a file that was closed, as the system does."""
        self.held = {key: holder for key, holder in self.held.items() if holder != descriptor}


@pytest.fixture
def windows(monkeypatch) -> FakeMsvcrt:
    """Windows as far as files are concerned: no POSIX calls, msvcrt instead of fcntl, O_BINARY, SIGBREAK."""
    fake = FakeMsvcrt()
    monkeypatch.setattr(platform_calls, "WINDOWS", True)
    monkeypatch.setitem(sys.modules, "msvcrt", fake)
    monkeypatch.setitem(sys.modules, "fcntl", None)
    for name in ("fdatasync", "posix_fallocate"):
        monkeypatch.delattr(os, name, raising=False)
    monkeypatch.setattr(os, "O_BINARY", 0, raising=False)
    return fake


def test_a_file_is_locked_far_behind_its_data_and_its_position_kept(windows, tmp_path) -> None:
    path = tmp_path / "f"
    first = platform_calls.open_raw(path, os.O_RDWR | os.O_CREAT)
    second = platform_calls.open_raw(path, os.O_RDWR)
    try:
        assert platform_calls.lock(first) and not platform_calls.lock(second)
        assert windows.calls == [(2**40, 1)] * 2
        assert os.lseek(first, 0, os.SEEK_CUR) == os.lseek(second, 0, os.SEEK_CUR) == 0
    finally:
        os.close(first)
        windows.closed(first)
        assert platform_calls.lock(second)
        os.close(second)


def test_a_recording_is_journalled_guarded_and_recovered_with_windows_calls(
    windows, tmp_path, rig, record_steps
) -> None:
    synced = []
    seen = []

    def progress(state) -> None:
        if not seen:
            with pytest.raises(InputError, match="another program is recording"):
                recover_session(tmp_path / "s")
        seen.append(state.committed_s)
        if state.time_s > 0.4:
            raise ZeroDivisionError

    def open_journal(path, head, *room):
        return JournalWriter(path, head, *room, synchronise=lambda file: (synced.append(file), os.fsync(file))[0])

    with pytest.raises(ZeroDivisionError):
        record_steps(rig, progress=progress, open_journal=open_journal)
    (trial,) = Session.open(tmp_path / "s").trials
    assert trial.status == "defect" and trial.read().n_valid >= seen[-1] * 5000 and synced


def test_signals_that_do_not_exist_here_are_left_out_and_sigbreak_counts_where_it_does(monkeypatch) -> None:
    assert int(signal.SIGTERM) in platform_calls.ending_signals()
    assert int(signal.SIGINT) not in platform_calls.ending_signals()
    assert platform_calls.ending_signals(with_keyboard=True)[0] == int(signal.SIGINT)
    on_windows = SimpleNamespace(SIGTERM=15, SIGINT=2, SIGBREAK=21)
    monkeypatch.setattr(platform_calls, "signal", on_windows)
    assert platform_calls.ending_signals(with_keyboard=True) == [2, 15, 21]


def test_without_room_for_it_nothing_is_reserved(windows, tmp_path) -> None:
    with (tmp_path / "f").open("wb") as file:
        platform_calls.reserve(file.fileno(), tmp_path / "f", 1000)
        with pytest.raises(OSError, match="free"):
            platform_calls.reserve(file.fileno(), tmp_path / "f", 10**18)


def test_ctrl_c_ends_a_library_that_never_comes_back(tmp_path) -> None:
    def handler_within() -> object:
        with platform_calls.ending_by_keyboard():
            return signal.getsignal(signal.SIGINT)

    before = signal.getsignal(signal.SIGINT)
    try:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        assert handler_within() is signal.SIG_DFL
        with ThreadPoolExecutor(1) as pool:
            assert pool.submit(handler_within).result() is signal.default_int_handler
        with pytest.raises(InputError):
            read_channels(tmp_path / "absent.h5")
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        assert handler_within() is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)
