"""Frames of a film get the times of the pulses that their trial counted, and no others."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rig import CameraInfo, InputError
from rig.session.film_record import count_clock_pulses, frame_times

CLOCK = CameraInfo(2000.0, 0.0123, 1e-4, 500, 2e-6)


def trial(camera: CameraInfo | None = CLOCK) -> Any:
    return SimpleNamespace(path=Path("trial_0001.h5"), read=lambda: SimpleNamespace(camera=camera))


def film(path: Path, n_frames: int = 40, first: int | None = None) -> Any:
    """A film whose header counts its frames from ``first``, or says nothing."""
    own = None if first is None else (first + np.arange(n_frames)) / 2000.0 + 0.5e-4
    return SimpleNamespace(path=path, n_frames=n_frames, exposure_s=1e-4, frame_time_s=own, has_camera_times=True)


def test_frames_without_a_counted_pulse_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "film.mraw"
    with pytest.raises(InputError, match="frames 0 to 500 found, allowed 0 to 499"):
        frame_times(trial(), film(path, 501))
    with pytest.raises(InputError, match="frames -3 to 36 found"):
        frame_times(trial(), film(path, first=-3))
    with pytest.raises(InputError, match="has no frame clock"):
        frame_times(trial(None), film(path))


def test_a_clock_that_drifts_by_frames_in_a_long_film_counts_right() -> None:
    own = np.arange(40_000) / 2000.2
    film = SimpleNamespace(
        path=Path("f.cine"), n_frames=own.size, exposure_s=None, frame_time_s=own, has_camera_times=True
    )
    np.testing.assert_array_equal(count_clock_pulses(film, 2000.0), np.arange(40_000))


@pytest.mark.parametrize(
    "bad", [[0.0, 1.0, 1.5, 2.5], [0.0, 0.5, 1.0, 1.5], [0.0, 1.0, 1.0, 2.0], [0.0, 1.0, 2.4, 3.0]]
)
def test_times_that_no_frame_clock_gives_are_refused(bad: list[float]) -> None:
    film = SimpleNamespace(
        path=Path("f.cine"), n_frames=4, exposure_s=None, frame_time_s=np.array(bad) / 2000.0, has_camera_times=True
    )
    with pytest.raises(
        InputError, match=r"frame \d comes .* periods of the frame clock .2000 Hz. after the one before"
    ):
        count_clock_pulses(film, 2000.0)
