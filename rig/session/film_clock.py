"""The times of a film's frames: from the pulses of the frame clock that its trial counted.

In: a sealed trial and what the film file says of itself; out: middle of each exposure on the trial's clock, whose zero
is the AI start trigger, and the standard uncertainty all of them share.
"""

from __future__ import annotations

from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from rig.errors import RigInputError
from rig.session.film_record import read_record
from rig.session.folder import Trial


class FilmFile(Protocol):
    """What a film file says of itself; times in s on the camera's own clock, None where the file says nothing."""

    path: Path
    n_frames: int
    exposure_s: float | None

    @property
    def frame_time_s(self) -> NDArray[np.float64] | None:
        """Middle of each exposure after the camera's trigger."""


def frame_times(trial: Trial, film: FilmFile) -> tuple[NDArray[np.float64], float]:
    """Times of a film's frames, s, shape (n_frames,), and their common standard uncertainty.

    Which pulse belongs to which frame is known from the record of an attached film, else from the frame numbers in
    the film's header, else the first frame is the first pulse.

    Raises
    ------
    RigInputError : the trial has no frame clock, or did not count that many pulses
    """
    camera = trial.read().camera
    if camera is None:
        raise RigInputError(f"{trial.path}: has no frame clock; record with a camera, or track a copy elsewhere")
    attached = read_record(film.path)
    own = film.frame_time_s
    pulse = np.arange(film.n_frames)
    if attached is not None:
        pulse += attached.first_frame
    elif own is not None:
        pulse = np.rint((own - 0.5 * (film.exposure_s or 0.0)) * camera.frame_rate_hz).astype(int)
    if pulse[0] < 0 or pulse[-1] >= camera.n_frames:
        raise RigInputError(
            f"{film.path}: frames {pulse[0]} to {pulse[-1]} found, allowed 0 to {camera.n_frames - 1}, "
            f"the pulses its trial counted; the film belongs to another trial or was cut"
        )
    return camera.frame_time_s[pulse], camera.u_time_s
