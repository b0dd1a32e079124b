"""What is shared within a run is made once for each set of arguments, with its files."""

from __future__ import annotations

from pathlib import Path

import numpy as np


def test_it_is_made_once_for_each_set_of_arguments(shared, tmp_path: Path) -> None:
    made = tmp_path / "made"

    def make(folder: Path, size: int) -> tuple[np.ndarray, Path]:
        assert list(folder.iterdir()) == []
        with made.open("a") as log:
            log.write(f"{size} ")
        (folder / "file").write_text(str(size))
        return np.arange(size), folder / "file"

    for size in (3, 4, 3, 4):
        values, file = shared(make, size)
        np.testing.assert_array_equal(values, np.arange(size))
        assert file.read_text() == str(size)
    assert made.read_text() == "3 4 "
