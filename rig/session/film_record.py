"""``trial_NNNN.film.toml``: the origin of a film that came from another computer, checked when it was attached.

``pianorig attach`` copies the film beside its trial and writes this; tracking reads the number of the film's first
frame from it, counted by the trial's frame clock.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import ConfigDict, Field

from rig.configuration import toml_file
from rig.configuration.channels import Table
from rig.storage.atomic_write import write_text

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
