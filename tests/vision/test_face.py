"""The face of the package: every name of the stub is there, and what a user does not need is not loaded."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import vision

STUB = ast.parse(Path(vision.__file__).with_suffix(".pyi").read_text(encoding="utf-8"))
NAMES = sorted(alias.asname or "" for node in STUB.body if isinstance(node, ast.ImportFrom) for alias in node.names)


@pytest.mark.parametrize("name", NAMES)
def test_name_of_the_stub_is_there(name: str) -> None:
    assert name in dir(vision) and name in vision.__all__
    assert getattr(vision, name).__doc__.strip()


def test_older_names_still_work() -> None:
    assert "track_film" not in dir(vision)
    assert vision.InputError is vision.VisionInputError
    assert vision.VisionInputError.exit_code == 2


def test_unknown_names_are_errors() -> None:
    with pytest.raises(AttributeError, match="nothing_of_ours"):
        _ = vision.nothing_of_ours
    with pytest.raises(TypeError, match="tolerence"):
        vision.track("film.mraw", [], tolerence=1.0)
    with pytest.raises(TypeError, match="every"):
        vision.retrack_frames("film.mraw", [], [0], [{}], every=2)


@pytest.mark.parametrize(
    ("code", "absent"),
    [
        ("import vision; dir(vision)", ["numpy", "numba", "cv2", "pandas", "scipy", "vision.errors"]),
        ("import vision.errors", ["numpy", "numba", "cv2"]),
        ("from vision import load_bodies, Body, FilmError", ["numba", "cv2", "pandas", "scipy"]),
        ("from vision import open_film, TrackResult, write_mraw", ["numba", "cv2", "pandas", "scipy"]),
        ("import vision.film.mraw", ["numba", "cv2", "pandas", "scipy"]),
        ("from vision import estimate_offset, FrameFlag, ErrorBudget", ["numba", "cv2", "pandas", "scipy"]),
        ("from vision import CameraModel, load_calibration", ["numba", "cv2", "pandas", "scipy"]),
        ("from vision import cramer_rao_bound, write_overlay", ["numba", "pandas", "scipy", "matplotlib"]),
        # whoever asks for the tracker tracks, and that needs the compiled fit
        ("from vision import track", ["pandas", "scipy.optimize", "matplotlib"]),
    ],
)
def test_heavy_packages_stay_out(code: str, absent: list[str]) -> None:
    script = f"{code}\nimport sys\nprint(','.join(m for m in {absent!r} if m in sys.modules))"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""
