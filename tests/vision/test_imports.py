"""Start-up: what a user does not need is not loaded."""

from __future__ import annotations

import subprocess
import sys

import pytest


@pytest.mark.parametrize(
    ("code", "absent"),
    [
        ("import vision", ["numpy", "numba", "cv2", "pandas", "scipy"]),
        ("import vision.errors", ["numpy", "numba", "cv2"]),
        ("from vision import load_bodies, Body, FilmError", ["numba", "cv2", "pandas", "scipy"]),
        ("from vision import open_film, TrackResult, write_mraw", ["numba", "cv2", "pandas", "scipy"]),
        ("import vision.film.mraw, vision.film.cih, vision.film.mraw_writer", ["numba", "cv2", "pandas", "scipy"]),
        ("from vision import track_film", ["numba", "pandas", "scipy", "matplotlib"]),
    ],
)
def test_heavy_packages_stay_out(code: str, absent: list[str]) -> None:
    script = f"{code}\nimport sys\nprint(','.join(m for m in {absent!r} if m in sys.modules))"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""


def test_unknown_name_is_an_attribute_error() -> None:
    import vision

    assert "track_film" in dir(vision)
    with pytest.raises(AttributeError, match="nothing_of_ours"):
        _ = vision.nothing_of_ours
