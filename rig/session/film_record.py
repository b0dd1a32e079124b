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

    ``frames_after`` is by how many frames the clock ran on after its last one: the film was cut there, or frames were
    dropped within it. With frame pulses nothing else distinguishes the two.
    """

    model_config = ConfigDict(populate_by_name=True)

    schema_name: Literal["piano-action-rig film 1"] = Field(default=SCHEMA, alias="schema")
    film: str
    source: str
    sha256: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
    n_frames: Annotated[int, Field(strict=True, ge=1)]
    first_frame: Annotated[int, Field(strict=True, ge=0)]
    frames_after: Annotated[int, Field(strict=True, ge=0)] = 0
    frame_rate_hz: Annotated[float, Field(gt=0, allow_inf_nan=False)] | Literal["unknown"] = "unknown"
    attached_utc: str
    author: str = "unknown"


def record_path(film: Path) -> Path:
    """Path of the record of a film beside its trial."""
    return film.with_suffix(".film.toml")


def write_record(film: Path, record: FilmRecord) -> Path:
    """Write the record of a film that lies beside its trial."""
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
