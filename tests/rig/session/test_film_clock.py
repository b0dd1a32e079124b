"""Frames of a film get the times of the pulses that their trial counted, and no others."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rig import CameraInfo, InputError
from rig.session.film_record import FilmRecord, clock_steps, frame_times, write_record

CLOCK = CameraInfo(2000.0, 0.0123, 1e-4, 500, 2e-6)


def trial(camera: CameraInfo | None = CLOCK) -> Any:
    return SimpleNamespace(path=Path("trial_0001.h5"), read=lambda: SimpleNamespace(camera=camera))


def film(path: Path, n_frames: int = 40, first: int | None = None) -> Any:
    """A film whose header counts its frames from ``first``, or says nothing."""
    own = None if first is None else (first + np.arange(n_frames)) / 2000.0 + 0.5e-4
    return SimpleNamespace(path=path, n_frames=n_frames, exposure_s=1e-4, frame_time_s=own, has_camera_times=True)


@pytest.mark.parametrize(("header", "attached", "first"), [(None, None, 0), (17, None, 17), (17, 30, 30)])
def test_the_record_of_an_attached_film_counts_before_its_header(
    tmp_path: Path, header: int | None, attached: int | None, first: int
) -> None:
    path = tmp_path / "trial_0001.mraw"
    path.write_bytes(b"film")
    if attached is not None:
        known = {"frame_rate_hz": 2000.0, "attached_utc": "2026-01-01T00:00:00+00:00", "author": "ana"}
        record = {"film": path.name, "source": "C001", "sha256": "0" * 64, "n_frames": 40, "frames_after": 0, **known}
        write_record(path, FilmRecord.model_validate({**record, "first_frame": attached}))
    times, u_time = frame_times(trial(), film(path, first=header))
    np.testing.assert_array_equal(times, CLOCK.frame_time_s[first : first + 40])
    assert u_time == CLOCK.u_time_s


def test_frames_without_a_counted_pulse_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "film.mraw"
    with pytest.raises(InputError, match="frames 0 to 500 found, allowed 0 to 499"):
        frame_times(trial(), film(path, 501))
    with pytest.raises(InputError, match="frames -3 to 36 found"):
        frame_times(trial(), film(path, first=-3))
    with pytest.raises(InputError, match="has no frame clock"):
        frame_times(trial(None), film(path))


GAP = np.r_[0:15, 21:46]


@pytest.mark.parametrize(("camera", "rate_hz"), [(True, 2000.0), (True, 2000.1), (False, 25.0)])
def test_frames_that_the_film_leaves_out_stay_out(tmp_path: Path, camera: bool, rate_hz: float) -> None:
    """From a camera's times, also of a clock 50 ppm off; from a video's stamps on the scale of play-back."""
    own = GAP / rate_hz + 0.5e-4
    gapped = SimpleNamespace(
        path=tmp_path / "f.cine", n_frames=40, exposure_s=1e-4, frame_time_s=own, has_camera_times=camera
    )
    times, _ = frame_times(trial(), gapped)
    np.testing.assert_array_equal(times, CLOCK.frame_time_s[GAP])


def test_a_clock_that_drifts_by_frames_in_a_long_film_counts_right() -> None:
    own = np.arange(40_000) / 2000.2
    film = SimpleNamespace(
        path=Path("f.cine"), n_frames=own.size, exposure_s=None, frame_time_s=own, has_camera_times=True
    )
    np.testing.assert_array_equal(clock_steps(film, 2000.0), np.arange(40_000))


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
        clock_steps(film, 2000.0)
