"""A file that another program opened for writing and closed unchanged is read, named once and sealed again.

So is one that a program holds open. What is not as it was sealed is refused, whatever was done to its end.
"""

from __future__ import annotations

import os
import shutil
import stat
import subprocess
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pandas as pd
import pytest

from rig import InputError, Trial, TrialData, platform_calls
from rig.session.derived_table import read_table, write_table
from rig.session.seal import MARK, content_sha256, has_seal, seal_again
from rig.session.sealed_trial import read_status, read_trial, trial_problem, write_trial
from tests.rig.session.test_sealed_trial import assert_same, trial

SHIPPED = Path(__file__).parents[3] / "sessions"
HOLD = """
import sys, h5py
with h5py.File(sys.argv[1], sys.argv[2], locking=True) as file:
    print("open", flush=True)
    sys.stdin.readline()
"""


@pytest.fixture
def sealed(tmp_path: Path) -> tuple[Path, TrialData]:
    path, data = tmp_path / "trial_0001.h5", trial(60, provenance={"operator": "Ana Müller", "EMPTY": ""})
    write_trial(path, data)
    return path, data


def open_and_close(path: Path, change: Callable[[h5py.File], object] = lambda file: None) -> None:
    """What pandas.HDFStore(path), or MATLAB, does to a file."""
    path.chmod(0o644)
    with h5py.File(path, "a") as file:
        change(file)


@contextmanager
def held(path: Path, mode: str) -> Iterator[None]:
    """Another program that has the file open."""
    path.chmod(0o644)
    command = [sys.executable, "-c", HOLD, str(path), mode]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout is not None and other.stdout.readline() == "open\n"
        yield
        other.communicate("\n")


@pytest.mark.parametrize("path", sorted(SHIPPED.rglob("trial_????.h5")), ids=lambda path: "-".join(path.parts[-3:]))
def test_the_digest_of_a_shipped_trial_is_found_again_in_its_file(path: Path) -> None:
    with h5py.File(path, "r") as file:
        if "sha256" in file.attrs:  # a table of an earlier version has none
            assert content_sha256(file) == file.attrs["sha256"]


@pytest.mark.parametrize("left", [1, len(MARK) + 64])
def test_a_seal_of_which_a_part_is_left_is_written_anew(sealed: Any, left: int) -> None:
    path, _ = sealed
    whole = path.read_bytes()
    path.chmod(0o644)
    path.write_bytes(whole[: whole.rindex(MARK) + left])
    seal_again(path)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert read_trial(path).n_valid == 60
    assert path.read_bytes() == whole or left < len(MARK)


CHANGES: dict[str, Callable[[h5py.File], object]] = {
    "a sample": lambda file: file["daq/force"].__setitem__(3, 99.0),
    "an attribute": lambda file: file["daq/force"].attrs.__setitem__("group_delay_s", 0.0),
    "a new group": lambda file: file.create_group("mine"),
    "the digest gone": lambda file: file.attrs.__delitem__("sha256"),
}


@pytest.mark.parametrize("what", CHANGES)
def test_a_trial_that_was_changed_is_refused_and_not_sealed_again(sealed: Any, what: str) -> None:
    path, _ = sealed
    open_and_close(path, CHANGES[what])
    for use in (read_trial, read_status, seal_again):
        with pytest.raises(InputError, match=r"not what was sealed: truncated, or altered") as refusal:
            use(path)
        assert str(path) in str(refusal.value) and "\n" not in str(refusal.value)
    assert "not what was sealed" in trial_problem(path)


def test_a_bit_flipped_after_the_seal_was_lost_is_found_and_crashes_nothing(sealed: Any) -> None:
    path, data = sealed
    open_and_close(path)
    body, draw = path.read_bytes(), np.random.default_rng(48)
    for k, at in enumerate(draw.integers(len(body), size=4)):
        damaged = bytearray(body)
        damaged[at] ^= 1 << int(draw.integers(8))
        path.write_bytes(damaged)
        os.utime(path, ns=(k, k))  # a file written twice within the clock's tick
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                assert_same(read_trial(path), data)  # a place that holds nothing
            except InputError as refusal:
                assert "not what was sealed" in str(refusal)


def test_a_sealed_trial_that_is_locked_but_whole_is_read(sealed: Any) -> None:
    """As by a program whose HDF5 marks a file only when it is changed."""
    fcntl = pytest.importorskip("fcntl")
    path, data = sealed
    with path.open("rb") as other:
        fcntl.flock(other, fcntl.LOCK_EX)
        assert_same(read_trial(path), data)


@pytest.mark.parametrize("has_lost_its_seal", [False, True])
def test_a_lock_is_named_where_the_trial_cannot_be_read_beside_it(sealed: Any, has_lost_its_seal: bool) -> None:
    path, data = sealed
    if has_lost_its_seal:
        open_and_close(path)
    with held(path, "r+"):
        for use in (read_trial, seal_again):
            with pytest.raises(InputError, match=r"another program has it open for writing; close it there"):
                use(path)
        assert "another program has it open" in trial_problem(path)
    seal_again(path)
    assert_same(read_trial(path), data)


def test_a_trial_is_read_that_was_open_in_a_program_which_was_killed(sealed: Any) -> None:
    path, data = sealed
    whole = path.read_bytes()
    path.chmod(0o644)
    command = [sys.executable, "-c", HOLD, str(path), "r+"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout is not None and other.stdout.readline() == "open\n"
        other.kill()
    marked = path.read_bytes()
    assert [k for k in range(len(whole)) if marked[k] != whole[k]] == [20] and not has_seal(path)
    with pytest.warns(UserWarning, match="was ended while it had it open") as seen:
        assert_same(read_trial(path), data)
        assert_same(read_trial(path), data)
    assert len(seen) == 1
    path.write_bytes(marked[:-200] + bytes([marked[-200] ^ 1]) + marked[-199:])
    for use in (read_trial, seal_again):
        with pytest.raises(InputError, match="altered|not what was sealed"):
            use(path)
    path.write_bytes(marked)
    seal_again(path)
    assert path.read_bytes() == whole and has_seal(path)


def test_a_copy_of_a_trial_under_the_name_of_another_is_not_counted_twice(tmp_path: Path) -> None:
    for number in (1, 2):
        write_trial(tmp_path / f"trial_{number:04d}.h5", trial(40 + number, number=number))
    trials = [Trial(tmp_path / f"trial_{number:04d}.h5", number, None) for number in (1, 2)]
    assert [one.problem for one in trials] == ["", ""]
    shutil.copy(tmp_path / "trial_0001.h5", tmp_path / "copy.h5")
    os.replace(tmp_path / "copy.h5", tmp_path / "trial_0002.h5")
    assert trials[0].problem == "" and trials[1].status == "unreadable"
    assert "trial_0002.h5: is a copy of trial_0001.h5; restore trial 2" in trials[1].problem
    os.replace(tmp_path / "trial_0001.h5", tmp_path / "trial_0003.h5")  # another number is no other trial
    assert trials[1].problem == ""


def test_a_derived_table_closed_unchanged_is_read_too(tmp_path: Path) -> None:
    path = tmp_path / "trial_0001.h5"
    table = pd.DataFrame({"time_s": [0.0, 0.5], "seen": [True, False], "name": ["a", "ü"]})
    write_table(path, table, {"step": "angles"}, {"trial_0001.h5": "0" * 64})
    open_and_close(path)
    with pytest.warns(UserWarning, match="took its seal off"):
        pd.testing.assert_frame_equal(read_table(path)[0], table)
    open_and_close(path, lambda file: file["table/time_s"].__setitem__(0, 1.0))
    with pytest.raises(InputError, match="not what was sealed"):
        read_table(path)


def test_a_sealed_trial_is_read_only_where_that_harms_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(platform_calls, "WINDOWS", False)
    write_trial(tmp_path / "a.h5", trial(5))
    assert not (tmp_path / "a.h5").stat().st_mode & 0o222
    monkeypatch.setattr(platform_calls, "WINDOWS", True)  # a folder that holds such a file cannot be removed there
    write_trial(tmp_path / "b.h5", trial(5))
    assert (tmp_path / "b.h5").stat().st_mode & stat.S_IWUSR


def test_a_read_only_trial_is_sealed_again_where_the_system_refuses_to_replace_such_files(
    sealed: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, data = sealed
    open_and_close(path)
    path.chmod(0o444)
    plain = os.replace

    def as_windows(source: Any, target: Any) -> None:
        if Path(target).exists() and not Path(target).stat().st_mode & stat.S_IWUSR:
            raise PermissionError(13, "Permission denied", str(target))
        plain(source, target)

    monkeypatch.setattr(os, "replace", as_windows)
    seal_again(path)
    assert has_seal(path)
    assert_same(read_trial(path), data)
