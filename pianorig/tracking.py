"""Tracking a film, alone or as part of a session: film and outlines in, table out.

A film beside a trial of a session takes its frame times from the trial's frame clock and its outlines from the
session's ``bodies.toml``, and its result is stored as the derived step ``angles``, with the hashes of what it
was made from.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .errors import InputError

if TYPE_CHECKING:
    from rig.session import Session, Trial
    from vision.results import TrackResult

BODIES_NAME = "bodies.toml"
STEP = "angles"


def session_trial_of(film: Path) -> tuple[Session, Trial] | None:
    """Session and trial a film belongs to, or None for a film on its own."""
    if not film.with_suffix(".h5").is_file() or not (film.parent / "session.toml").is_file():
        return None
    from rig.session import Session

    session = Session.open(film.parent)
    for trial in session.trials:
        if trial.film is not None and trial.film.resolve() == film.resolve():
            return session, trial
    return None


def outlines_of(film: Path, bodies_file: Path | None) -> Path:
    """File with a film's outlines: the one named, or its session's.

    Raises
    ------
    InputError : there is no such film, or it belongs to no session and no file is named
    """
    if not film.exists():
        raise InputError(f"{film}: no such film")
    if bodies_file is not None:
        return bodies_file
    owner = session_trial_of(film)
    if owner is None:
        raise InputError(f"{film}: does not belong to a session; name its outlines with --bodies B.toml")
    return owner[0].path / BODIES_NAME


def expected_uncertainty(film: Path, bodies_file: Path | None = None) -> dict[str, float]:
    """Standard uncertainty of each body's angle (rad) to expect, before the film is tracked."""
    import vision

    bodies = vision.load_bodies(outlines_of(film, bodies_file))
    return vision.predict_uncertainty(film, bodies)


def draw_track(
    film: Path, bodies_file: Path | None, result: TrackResult, overlay: Path | None, contact_sheet: Path | None
) -> None:
    """Draw what was tracked: an overlay film (.avi) and a contact sheet of the worst frames (.png), where named."""
    import vision

    if overlay is None and contact_sheet is None:
        return
    bodies = vision.load_bodies(outlines_of(film, bodies_file))
    with vision.open_film(film) as source:
        if overlay is not None:
            vision.write_overlay(overlay, source, bodies, result)
        if contact_sheet is not None:
            vision.write_contact_sheet(contact_sheet, source, bodies, result)


def track_film_file(
    film: Path,
    bodies_file: Path | None = None,
    *,
    method: str = "icgn",
    every: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> TrackResult:
    """Track the bodies of one film; frame times from the trial's frame clock when it has one.

    Parameters
    ----------
    film : film file
    bodies_file : TOML with outlines; by default the session's
    method, every, progress : see `vision.track_film`

    Raises
    ------
    InputError : no outlines are known for the film, or its frame clock does not fit
    """
    import vision

    owner = session_trial_of(film)
    bodies_file = outlines_of(film, bodies_file)
    bodies = vision.load_bodies(bodies_file)
    times = None
    with vision.open_film(film) as source:
        if owner is not None:
            camera = owner[1].read().camera
            if camera is None:
                raise InputError(
                    f"{owner[1].path}: has no frame clock; record with a camera, or track a copy elsewhere"
                )
            own = source.frame_time_s
            middle = 0.5 * (source.exposure_s or 0.0)
            index = np.arange(source.n_frames) if own is None else np.rint((own - middle) * camera.frame_rate_hz)
            index = index.astype(int)
            if index[0] < 0 or index[-1] >= camera.n_frames:
                raise InputError(
                    f"{film}: frames {index[0]} to {index[-1]} found, allowed 0 to {camera.n_frames - 1}, "
                    f"the pulses its trial counted; the film belongs to another trial or was cut"
                )
            times = camera.frame_time_s[index]
        result = vision.track_film(source, bodies, times, method=method, every=every, progress=progress)
    if owner is not None:
        session, trial = owner
        session.write_derived(
            STEP,
            trial.number,
            result.to_table(),
            {
                "method": method,
                "every": every,
                "n_still": result.n_still,
                **{f"{b}_u_common_rad": float(u) for b, u in zip(result.bodies, result.u_common_rad, strict=True)},
            },
            {film.name: file_sha256(film), bodies_file.name: file_sha256(bodies_file), trial.path.name: trial.sha256},
        )
    return result


def file_sha256(path: Path) -> str:
    """SHA-256 of a file's bytes, read in pieces."""
    digest = hashlib.sha256()
    with open(path, "rb") as file:
        while piece := file.read(1 << 20):
            digest.update(piece)
    return digest.hexdigest()


def summary(result: TrackResult) -> dict[str, Any]:
    """Numbers a user wants after tracking: frames, lost, predicted and median uncertainty per body (rad)."""
    return {
        "frames": len(result.frame),
        "lost": {b: int(n) for b, n in zip(result.bodies, result.failed.sum(axis=0), strict=True)},
        "predicted_u_rad": {b: float(u) for b, u in zip(result.bodies, result.predicted_u_rad, strict=True)},
        "median_u_rad": {
            b: float(np.nanmedian(u)) if np.isfinite(u).any() else float("nan")
            for b, u in zip(result.bodies, result.u_angle_rad.T, strict=True)
        },
    }
