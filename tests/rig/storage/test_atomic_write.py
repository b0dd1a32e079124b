"""Files are whole or absent."""

from __future__ import annotations

import hashlib

import pytest

from rig.errors import InputError
from rig.storage.atomic_write import replace_when_complete, sha256_of_file, write_text


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


def test_the_hash_of_a_file_is_that_of_its_bytes(tmp_path) -> None:
    data = bytes(range(256)) * 5000
    (tmp_path / "b").write_bytes(data)
    assert sha256_of_file(tmp_path / "b") == hashlib.sha256(data).hexdigest()
    with pytest.raises(InputError, match="cannot be read"):
        sha256_of_file(tmp_path / "missing")
