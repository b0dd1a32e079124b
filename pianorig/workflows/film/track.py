"""Tracking a film, alone or as part of a session: film and outlines in, table out.

A film beside a trial of a session takes its frame times from the trial's frame clock and its outlines from the
session's ``bodies.toml``, and its result is stored as the derived step ``angles``, with the hashes of what it
was made from.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pianorig.errors import InputError

if TYPE_CHECKING:
    import pandas as pd

    from rig.session import Session, Trial
    from vision import ErrorBudget, Film, TrackResult
    from vision.camera.model import CameraModel

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


def camera_of(
    calibration: Path | None, u_tilt_deg: float | None = None, u_distortion_percent: float | None = None
) -> CameraModel:
    """What is known of the camera: its calibration file, or the standard uncertainties assumed without one."""
    from vision.camera.model import AssumedCamera

    if calibration is None:
        plain = AssumedCamera()
        return AssumedCamera(
            plain.u_tilt_rad if u_tilt_deg is None else float(np.radians(u_tilt_deg)),
            plain.u_radial if u_distortion_percent is None else u_distortion_percent / 100.0,
        )
    if u_tilt_deg is not None or u_distortion_percent is not None:
        raise InputError(f"{calibration}: a calibrated camera needs no --tilt and --distortion; leave one out")
    from vision.camera.file import load_calibration

    return load_calibration(calibration)


def draw_track(
    film: Path,
    bodies_file: Path | None,
    result: TrackResult,
    overlay: Path | None = None,
    contact_sheet: Path | None = None,
    plot: Path | None = None,
) -> None:
    """Draw what was tracked, where named: an overlay film (.avi), a contact sheet of the worst frames (.png), a plot
    of angles and residuals (.png)."""
    import vision

    if plot is not None:
        vision.write_plot(plot, result)
    if overlay is None and contact_sheet is None:
        return
    bodies = vision.load_bodies(outlines_of(film, bodies_file))
    with vision.open_film(film, allow_truncated=True) as source:
        if overlay is not None:
            vision.write_overlay(overlay, source, bodies, result)
        if contact_sheet is not None:
            vision.write_contact_sheet(contact_sheet, source, bodies, result)


def frame_times_of(
    source: Film, owner: tuple[Session, Trial] | None, frame_rate_hz: float | None
) -> tuple[NDArray[np.float64] | None, float]:
    """Times of a film's frames and their standard uncertainty, s: from its trial's frame clock, else from the rate
    named, else None (the film's own)."""
    if owner is None:
        if frame_rate_hz is None:
            return None, 0.0
        if not 0.0 < frame_rate_hz < 1e9:
            raise InputError(f"{source.path}: frame rate {frame_rate_hz:g} Hz; needs a positive number")
        return np.arange(source.n_frames) / frame_rate_hz + 0.5 * (source.exposure_s or 0.0), 0.0
    if frame_rate_hz is not None:
        raise InputError(f"{source.path}: belongs to a trial whose frame clock gives its times; leave out --frame-rate")
    camera = owner[1].read().camera
    if camera is None:
        raise InputError(f"{owner[1].path}: has no frame clock; record with a camera, or track a copy elsewhere")
    from rig.session.film_record import read_record

    attached = read_record(source.path)
    own = source.frame_time_s
    middle = 0.5 * (source.exposure_s or 0.0)
    if attached is not None:
        index = attached.first_frame + np.arange(source.n_frames)
    else:
        index = np.arange(source.n_frames) if own is None else np.rint((own - middle) * camera.frame_rate_hz)
    index = index.astype(int)
    if index[0] < 0 or index[-1] >= camera.n_frames:
        raise InputError(
            f"{source.path}: frames {index[0]} to {index[-1]} found, allowed 0 to {camera.n_frames - 1}, "
            f"the pulses its trial counted; the film belongs to another trial or was cut"
        )
    return camera.frame_time_s[index], camera.u_time_s


def track_film_file(
    film: Path,
    bodies_file: Path | None = None,
    *,
    method: str = "icgn",
    every: int = 1,
    confirm: str = "doubtful",
    camera: CameraModel | None = None,
    frame_rate_hz: float | None = None,
    allow_truncated: bool = False,
    checkpoint: Path | None = None,
    expected: Callable[[ErrorBudget], None] | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> TrackResult:
    """Track the bodies of one film; frame times from the trial's frame clock when it has one.

    Parameters
    ----------
    film : film file
    bodies_file : TOML with outlines; by default the session's
    frame_rate_hz : rate of a film that does not say it, or says its play-back rate
    allow_truncated : read a film that was cut short up to its last whole frame
    method, every, confirm, camera, checkpoint, expected, progress : see `vision.track_film`

    Raises
    ------
    InputError : no outlines are known for the film, or its frame clock does not fit
    """
    import vision

    owner = session_trial_of(film)
    bodies_file = outlines_of(film, bodies_file)
    bodies = vision.load_bodies(bodies_file)
    with vision.open_film(film, allow_truncated=allow_truncated) as source:
        times, u_time = frame_times_of(source, owner, frame_rate_hz)
        result = vision.track_film(
            source,
            bodies,
            times,
            method=method,
            every=every,
            confirm=confirm,
            camera=camera,
            u_time_s=u_time,
            checkpoint=checkpoint,
            expected=expected,
            progress=progress,
        )
    if owner is not None:
        result.info["clock_offset"] = clock_offsets(owner[1], result)
        store_angles(owner, film, bodies_file, result.to_table(), _attributes(result, every))
    return result


def clock_offsets(trial: Trial, result: TrackResult) -> dict[str, tuple[float, float]]:
    """How far the film's clock is off the encoder of each body that has both: s to add to the film's times, and its
    standard uncertainty. Bodies that hardly move are left out; the times themselves are not changed."""
    import vision

    data = trial.read()
    angles = data.angle_rad()
    offsets = {}
    for i, encoder in enumerate(data.encoders):
        if encoder.name not in result.bodies:
            continue
        body = result.column(encoder.name)
        try:
            found = vision.estimate_offset(
                result.time_s, result.angle_rad[:, body], result.u_angle_rad[:, body], data.time_s, angles[:, i]
            )
        except vision.InputError:
            continue
        offsets[encoder.name] = (found.offset_s, found.u_offset_s)
    return offsets


def store_angles(
    owner: tuple[Session, Trial], film: Path, bodies_file: Path, table: pd.DataFrame, attributes: dict[str, Any]
) -> None:
    """Put a table of angles into its session, with the hashes of what it was made from."""
    from rig.session.film_record import read_record
    from rig.storage.atomic_write import sha256_of_file

    session, trial = owner
    made_from = {film.name: sha256_of_file(film), bodies_file.name: sha256_of_file(bodies_file)}
    attached = read_record(film)
    if attached is not None and attached.sha256 != made_from[film.name]:
        raise InputError(
            f"{film}: SHA-256 {made_from[film.name]}, attached with {attached.sha256}; it was altered since: take it "
            "away, with its .film.toml, and attach the original again"
        )
    session.write_derived(STEP, trial.number, table, attributes, {**made_from, trial.path.name: trial.sha256})


def _attributes(result: TrackResult, every: int) -> dict[str, Any]:
    attributes: dict[str, Any] = {"method": result.method, "every": every, "n_still": result.n_still}
    attributes |= {f"{b}_u_common_rad": float(u) for b, u in zip(result.bodies, result.u_common_rad, strict=True)}
    attributes["camera"] = result.budget.camera
    for body, (offset, u) in result.info.get("clock_offset", {}).items():
        attributes |= {f"{body}_clock_offset_s": offset, f"{body}_u_clock_offset_s": u}
    for relative, tail in ((False, ""), (True, "_relative")):
        for body, terms in result.budget.typical(relative).items():
            attributes |= {f"{body}{tail}_u_{name}_rad": value for name, value in terms.items()}
    return attributes


def summary(result: TrackResult) -> dict[str, Any]:
    """Numbers a user wants after tracking: frames, lost, predicted and median uncertainty per body, budget (rad)."""
    return {
        "frames": len(result.frame),
        "lost": {b: int(n) for b, n in zip(result.bodies, result.failed.sum(axis=0), strict=True)},
        "predicted_u_rad": {b: float(u) for b, u in zip(result.bodies, result.predicted_u_rad, strict=True)},
        "median_u_rad": {
            b: float(np.nanmedian(u)) if np.isfinite(u).any() else float("nan")
            for b, u in zip(result.bodies, result.u_angle_rad.T, strict=True)
        },
        "budget_rad": result.budget.typical(),
        "relative_budget_rad": result.budget.typical(relative=True),
        "camera": result.budget.camera,
        "clock_offset_s": result.info.get("clock_offset", {}),
        **{name: result.info[name] for name in ("rows_resumed", "rows_confirmed", "wide_searches")},
    }


def budget_lines(budget: ErrorBudget) -> list[str]:
    """A budget as lines of text, mdeg: one row per angle, one column per term."""
    from vision.uncertainty.budget import TERMS

    names = (*TERMS, "total")
    lines = [f"{'u in mdeg':<26}" + "".join(f"{name[:10]:>11}" for name in names)]
    rows = {**budget.typical(), **{f"{b} from parent": terms for b, terms in budget.typical(relative=True).items()}}
    for body, terms in rows.items():
        lines.append(f"  {body:<24}" + "".join(f"{np.degrees(terms[name]) * 1e3:>11.1f}" for name in names))
    return [*lines, f"  ({budget.camera})"]
