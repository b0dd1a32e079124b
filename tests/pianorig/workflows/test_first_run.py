"""What a first demo compiles ahead is called once, and leaves nothing behind."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from model.null_model import time_stepping
from pianorig.workflows import first_run
from validation.scores import iso18571
from vision.frame_fit import compiled


def test_kernels_of_null_model_tracking_and_scores_are_compiled_and_no_file_is_left(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    folders: list[Path] = []
    track = first_run.vision.track

    def tracked(film: Path, bodies: Any) -> Any:
        folders.append(film.parent)
        result = track(film, bodies)
        assert len(result.frame) == first_run.FRAMES
        return result

    monkeypatch.setattr(first_run.vision, "track", tracked)
    first_run.call_once()
    assert len(folders) == 1 and not folders[0].exists()
    for kernel in (time_stepping.integrate, compiled.fit_remaining_bodies, iso18571._best_shift, iso18571._warp):
        assert kernel.signatures
