"""``trial_NNNN.film.toml``: the origin of a film that came from another computer, and the times of its frames.

``pianorig attach`` checks and copies the film beside its trial and writes this; tracking reads the number of the film's
first frame from it, counted by the trial's frame clock. From the pulses of that clock follow the middle of each
exposure on the trial's clock, whose zero is the AI start trigger, and the standard uncertainty all of them share.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, Protocol

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict, Field

from rig.atomic_write import write_text
from rig.configuration import toml_file
from rig.configuration.rig_file import Table
from rig.errors import RigInputError
from rig.session.folder import Trial

SCHEMA: Literal["piano-action-rig film 1"] = "piano-action-rig film 1"


class FilmRecord(Table):
    """One attached film; ``first_frame`` is the number of its first frame on the trial's frame clock, from 0.

    ``frames_missing`` counts those that the film's own times leave out. ``frames_after`` is by how many frames the
    clock ran on after its last one: the film was cut there, or frames were dropped that its times do not show.
    """

    model_config = ConfigDict(populate_by_name=True)

    schema_name: Literal["piano-action-rig film 1"] = Field(default=SCHEMA, alias="schema")
    film: str
    source: str
    sha256: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
    n_frames: Annotated[int, Field(strict=True, ge=1)]
    first_frame: Annotated[int, Field(strict=True, ge=0)]
    frames_after: Annotated[int, Field(strict=True, ge=0)] = 0
    frames_missing: Annotated[int, Field(strict=True, ge=0)] = 0
    frame_rate_hz: Annotated[float, Field(gt=0, allow_inf_nan=False)] | Literal["unknown"] = "unknown"
    attached_utc: str
    author: str = "unknown"

    @property
    def last_frame(self) -> int:
        return self.first_frame + self.n_frames + self.frames_missing - 1


def record_path(film: Path) -> Path:
    return film.with_suffix(".film.toml")


def write_record(film: Path, record: FilmRecord) -> Path:
    path = record_path(film)
    write_text(path, toml_file.dump_toml(record.model_dump(by_alias=True)))
    return path


def read_record(film: Path) -> FilmRecord | None:
    """Return the record of a film beside its trial; None when it was not attached but recorded there."""
    path = record_path(film)
    if not path.is_file():
        return None
    return toml_file.check(FilmRecord, toml_file.parse_toml(toml_file.read_text(path), str(path)), str(path))


class FilmFile(Protocol):
    """What a film file says of itself; times in s on the camera's own clock, None where the file says nothing."""

    path: Path
    n_frames: int
    exposure_s: float | None
    has_camera_times: bool

    @property
    def frame_time_s(self) -> NDArray[np.float64] | None:
        """Middle of each exposure after the camera's trigger."""


WHOLE = 0.25
"""Frames may be off the pulse of the frame clock by this share of its period: stamps are rounded, clocks drift."""


def count_clock_pulses(film: FilmFile, clock_hz: float) -> NDArray[np.int64]:
    """Pulses of the frame clock of ``clock_hz`` from the first frame of a film to each, (n_frames,), starting at 0:
    where none is missing 0, 1, 2, …; RigInputError where the times between frames are no whole periods.

    From the camera's own times; of a video from its time stamps, whose scale may be that of play-back; else one pulse a
    frame.
    """
    steps = np.zeros(film.n_frames, dtype=np.int64)
    stated_s = film.frame_time_s
    if stated_s is None or film.n_frames < 2:
        return np.arange(film.n_frames)
    intervals = np.diff(stated_s)
    period = 1.0 / clock_hz if film.has_camera_times else float(np.median(intervals))
    if not film.has_camera_times and not _are_whole(intervals / period):
        # where most frames were left out, the shortest interval is that of the clock
        period = float(intervals.min())
    if not _are_whole(intervals / period):
        off = intervals / period - np.maximum(np.rint(intervals / period), 1.0)
        at = int(np.argmax(np.abs(off)))
        raise RigInputError(
            f"{film.path}: frame {at + 1} comes {intervals[at] / period:.3g} periods of the frame clock "
            f"({clock_hz:.6g} Hz) after the one before, allowed whole numbers from 1 on; the film belongs to another "
            "trial, or its time stamps were changed"
        )
    steps[1:] = np.cumsum(np.rint(intervals / period))
    return steps


def _are_whole(multiples: NDArray[np.float64]) -> bool:
    return bool(multiples.min() > 1.0 - WHOLE and np.abs(multiples - np.rint(multiples)).max() <= WHOLE)


def frame_times(trial: Trial, film: FilmFile) -> tuple[NDArray[np.float64], float]:
    """Middles of a film's exposures, s on the trial's clock, (n_frames,), and their common standard uncertainty, s;
    RigInputError where the trial has no frame clock, or the frames are not all among its pulses.

    Which pulse belongs to the first frame is known from the record of an attached film, else from the film's header,
    else it is the first. The others follow as the film's own times say (`count_clock_pulses`), so that a gap stays one.
    """
    camera = trial.read().camera
    if camera is None:
        raise RigInputError(f"{trial.path}: has no frame clock; record with a camera, or track a copy elsewhere")
    attached = read_record(film.path)
    stated_s = film.frame_time_s
    pulse = count_clock_pulses(film, camera.frame_rate_hz)
    if attached is not None:
        pulse += attached.first_frame
    elif stated_s is not None:
        pulse += round(float(stated_s[0] - 0.5 * (film.exposure_s or 0.0)) * camera.frame_rate_hz)
    if pulse[0] < 0 or pulse[-1] >= camera.n_frames:
        raise RigInputError(
            f"{film.path}: frames {pulse[0]} to {pulse[-1]} found, allowed 0 to {camera.n_frames - 1}, "
            f"the pulses its trial counted; the film belongs to another trial or was cut"
        )
    return camera.frame_time_s[pulse], camera.u_time_s
