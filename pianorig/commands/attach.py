"""``pianorig attach``: bring a film from the camera's computer into its session."""

from __future__ import annotations

import shutil
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import rig
import vision
from pianorig import workflows
from pianorig.console.options import AsJson
from pianorig.console.output import tell
from pianorig.errors import CommandInputError
from rig.atomic_write import replace_when_complete, sha256_of_file

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from rig.session.film_record import FilmRecord

RATE_TOLERANCE = 1e-3  # of a film's rate: clocks of cameras differ by 1e-4, play-back rates by tens
HEADERS = (".cihx", ".cih", ".CIHX", ".CIH")


def command(
    film: Annotated[Path, typer.Argument(help="Film (.mraw, .cine, .avi, .mp4, .tif and others).")],
    session: Annotated[
        Path | None, typer.Argument(help="Session folder; default: this folder, else the newest below sessions/.")
    ] = None,
    trial: Annotated[int, typer.Option("--trial", help="Trial that was filmed.")] = 1,
    sha256: Annotated[
        str | None, typer.Option("--sha256", help="SHA-256 of the film as the camera's computer gave it.")
    ] = None,
    first_frame: Annotated[
        int | None,
        typer.Option("--first-frame", min=0, help="First frame after the trigger, if the film does not say."),
    ] = None,
    frame_rate: Annotated[
        float | None, typer.Option("--frame-rate", help="True rate, frames/s, where the film does not say it.")
    ] = None,
    author: Annotated[str, typer.Option("--author", help="Who writes this.")] = "unknown",
    as_json: AsJson = False,
) -> None:
    """Check a film against a trial; copy it beside the trial.
    Frame count, rate, trigger frame and hash must fit; the original stays where it is. A trial that has a film already
    is refused.

    Example:  pianorig attach film.mraw --trial 3 sessions/try
    """
    record = attach_film(
        film,
        workflows.session_folder(session),
        trial,
        sha256=sha256,
        first_frame=first_frame,
        frame_rate_hz=frame_rate,
        author=author,
    )
    last = record.last_frame
    lines = [f"trial {trial}: {record.film}, frames {record.first_frame} to {last}, SHA-256 {record.sha256[:16]}…"]
    if record.frames_after:
        lines.insert(
            0,
            f"trial {trial}: the frame clock ran on for {record.frames_after} frames; if the film was not cut there, "
            "frames were dropped and its times are wrong from there on: reject the trial with  pianorig annotate",
        )
    tell(as_json, record.model_dump(mode="json", by_alias=True), lines)


def attach_film(
    film: Path,
    session_path: Path,
    number: int,
    *,
    sha256: str | None = None,
    first_frame: int | None = None,
    frame_rate_hz: float | None = None,
    author: str = "unknown",
) -> FilmRecord:
    """Check that a film fits trial ``number`` of a session, copy it beside the trial's file, write its record and a
    note in the annotations; return the record. CommandInputError where it does not fit; nothing stays then."""
    # start-up: 0.5 s of h5py and pandas that --help does not need
    from rig.session.annotation_file import utc_now
    from rig.session.film_record import FilmRecord, count_clock_pulses, record_path, write_record
    from rig.session.folder import FILM_SUFFIXES

    session = rig.Session.open(session_path)
    trial = session.trial(number)
    if trial.film is not None:
        raise CommandInputError(f"{trial.film}: trial {number} has a film already; move it away first")
    camera = trial.read().camera
    if camera is None:
        raise CommandInputError(f"{trial.path}: has no frame clock; it was recorded without a camera")
    with vision.open_film(film) as source:
        data = Path(source.path)
        n_frames, rate = source.n_frames, source.frame_rate_hz
        header = source.header
        said = int(header.start_frame) if header is not None else getattr(source, "start_frame", None)
        if data.is_dir() or data.suffix.lower() not in FILM_SUFFIXES:
            raise CommandInputError(f"{film}: is one picture or a folder of them; allowed {', '.join(FILM_SUFFIXES)}")
        if frame_rate_hz is not None and said is not None:
            raise CommandInputError(f"{film}: its header says {rate} frames/s; leave out --frame-rate")
        rate = frame_rate_hz if frame_rate_hz is not None else rate
        first = _first_frame(film, said, first_frame)
        _check_rate(film, trial, camera, rate)
        steps = count_clock_pulses(source, camera.frame_rate_hz)
    last = first + int(steps[-1])
    _check_range(film, trial, camera, first, last)
    _say_gaps(film, steps)
    digest = sha256_of_file(data)
    if sha256 is not None and digest != sha256.strip().lower():
        raise CommandInputError(
            f"{data}: SHA-256 {digest}, expected {sha256.strip().lower()}; copy it again from the camera"
        )
    _check_unused(session, trial, data, digest)
    target = trial.path.with_suffix(data.suffix.lower())
    copies = [(data, target)]
    if header is not None:  # as on a camera's disk, in capitals or not; the copy is the one that a film is read with
        copies += [(h, target.with_suffix(h.suffix.lower())) for e in HEADERS if (h := data.with_suffix(e)).is_file()]
    done: list[Path] = []
    try:
        for original, copy in copies:
            done.append(copy)
            with replace_when_complete(copy) as temporary:
                shutil.copyfile(original, temporary)
        if sha256_of_file(target) != digest:
            raise CommandInputError(f"{target}: differs from {data} after copying; look at the disk, then try again")
        record = FilmRecord(
            film=target.name, source=str(data), sha256=digest, n_frames=n_frames, first_frame=first,
            frames_after=camera.n_frames - 1 - last, frames_missing=last - first + 1 - n_frames,
            frame_rate_hz=rate if rate is not None else "unknown", attached_utc=utc_now(), author=author,
        )  # fmt: skip
        done.append(record_path(target))
        write_record(target, record)
    except BaseException:
        for copy in done:
            copy.unlink(missing_ok=True)
        raise
    session.annotate(number, "note", f"film {data.name} attached as {target.name}, SHA-256 {digest}", author=author)
    return record


def _check_unused(session: rig.Session, trial: rig.Trial, data: Path, digest: str) -> None:
    """CommandInputError where the film file ``data``, of SHA-256 ``digest``, is attached to another trial of the
    session already."""
    for other in session.trials:
        film = other.film
        if film is None or other.number == trial.number or film.stat().st_size != data.stat().st_size:
            continue
        if sha256_of_file(film) == digest:
            raise CommandInputError(
                f"{data}: is the film of trial {other.number} already ({film.name}), allowed one trial a film; "
                f"name the film of trial {trial.number}"
            )


def _first_frame(film: Path, stated: int | None, option: int | None) -> int:
    """Number of the film's first frame, counted from the trigger: as its header has ``stated`` it, or the command's
    ``option``; `CommandInputError` for neither (None), or two that differ."""
    if stated is not None and option is not None and stated != option:
        raise CommandInputError(
            f"{film}: its header says first frame {stated}, --first-frame {option}; leave out the option"
        )
    if stated is None and option is None:
        raise CommandInputError(f"{film}: does not say its first frame after the trigger; add --first-frame")
    first = stated if stated is not None else option
    return int(first or 0)


def _check_rate(film: Path, trial: rig.Trial, camera: rig.CameraInfo, rate: float | None) -> None:
    if rate is not None and abs(rate - camera.frame_rate_hz) > RATE_TOLERANCE * camera.frame_rate_hz:
        raise CommandInputError(
            f"{film}: {rate:.6g} frames/s, trial {trial.number} has {camera.frame_rate_hz:.6g}; allowed within "
            f"{RATE_TOLERANCE:.1%}; it belongs to another trial, or says its play-back rate: then add --frame-rate"
        )


def _check_range(film: Path, trial: rig.Trial, camera: rig.CameraInfo, first: int, last: int) -> None:
    """CommandInputError where the film's frames ``first`` to ``last``, counted from the trigger, are not all among
    those that the trial's clock counted."""
    if first < 0:
        raise CommandInputError(f"{film}: begins {-first} frames before the trigger; save it from the trigger on")
    if last >= camera.n_frames:
        raise CommandInputError(
            f"{film}: frames {first} to {last}, trial {trial.number} has 0 to {camera.n_frames - 1}; "
            "the film belongs to another trial"
        )


def _say_gaps(film: Path, steps: NDArray[np.int64]) -> None:
    """Warn of frames that the clock counted and the film lacks; ``steps`` (n,): number of each frame in the clock, from
    0."""
    import numpy as np  # start-up: 0.1 s that --help does not need

    gaps = np.flatnonzero(np.diff(steps) > 1)
    if gaps.size:
        missing = int(steps[-1]) + 1 - steps.size
        warnings.warn(
            f"{film}: {missing} frames that the clock counted are missing in it, in {gaps.size} gaps, the first after "
            f"its frame {gaps[0]}; the others are at their times",
            vision.VisionWarning,
            stacklevel=3,
        )
