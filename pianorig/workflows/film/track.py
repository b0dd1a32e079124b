"""Tracking a film, alone or as part of a session: film and outlines in, table and pictures out."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Unpack

import numpy as np

import vision
from pianorig.console.failures import Interrupted, how_stopped
from pianorig.errors import CommandInputError
from pianorig.workflows.film.session_film import SessionFilm
from validation.measurement.film_offset import clock_offsets
from vision.tracking.options import TrackOptions
from vision.uncertainty.budget import TERMS


@contextmanager
def tracking_kept(unfinished: Path) -> Iterator[None]:
    """Turn Ctrl-C during a tracking into a message that says what is kept in the file ``unfinished``.

    Raises
    ------
    Interrupted : in place of KeyboardInterrupt
    """
    try:
        yield
    except KeyboardInterrupt as interrupt:
        kept = f"frames so far are kept in {unfinished}, the same command goes on there"
        left = kept if unfinished.is_file() else "no frame was kept"
        raise Interrupted(f"{how_stopped(interrupt)}; {left}; no table was written") from interrupt


def camera_of(
    calibration: Path | None, u_tilt_deg: float | None = None, u_distortion_percent: float | None = None
) -> vision.CameraModel:
    """What is known of the camera: its calibration file, or the standard uncertainties assumed without one."""
    if calibration is None:
        plain = vision.AssumedCamera()
        return vision.AssumedCamera(
            plain.u_tilt_rad if u_tilt_deg is None else float(np.radians(u_tilt_deg)),
            plain.u_radial if u_distortion_percent is None else u_distortion_percent / 100.0,
        )
    if u_tilt_deg is not None or u_distortion_percent is not None:
        raise CommandInputError(f"{calibration}: a calibrated camera needs no --tilt and --distortion; leave one out")
    return vision.load_calibration(calibration)


def rows_per_second(shutter: str | None, rows: float | None) -> float | None:
    """Rows per second of the sensor's shutter: infinite for a global one, None where it is not declared."""
    if shutter not in (None, "global", "rolling"):
        raise CommandInputError(f"--shutter {shutter}: choose global or rolling")
    if (shutter == "rolling") != (rows is not None):
        raise CommandInputError("--shutter rolling and --rows-per-second ROWS go together: give both or neither")
    return float("inf") if shutter == "global" else rows


def draw_track(
    film: SessionFilm,
    result: vision.TrackResult,
    *,
    overlay: Path | None = None,
    contact_sheet: Path | None = None,
    plot: Path | None = None,
) -> None:
    """Draw what was tracked, each where a file is named for it.

    Parameters
    ----------
    overlay : film with the tracked outlines (.avi)
    contact_sheet : picture of the worst frames (.png)
    plot : angles and residuals over time (.png)
    """
    if plot is not None:
        vision.write_plot(plot, result)
    if overlay is None and contact_sheet is None:
        return
    bodies = vision.load_bodies(film.outlines)
    with film.open(allow_truncated=True) as source:
        if overlay is not None:
            vision.write_overlay(overlay, source, bodies, result)
        if contact_sheet is not None:
            vision.write_contact_sheet(contact_sheet, source, bodies, result)


def track_film_file(film: SessionFilm, **options: Unpack[TrackOptions]) -> vision.TrackResult:
    """Track the bodies of one film; frame times from the trial's frame clock when it has one.

    Parameters
    ----------
    options : every, method, confirm, camera, checkpoint, expected, progress and more, see `vision.track`

    Raises
    ------
    CommandInputError : no outlines are known for the film, or it needs no frame rate
    rig.errors.InputError : its frame clock does not fit
    """
    bodies = vision.load_bodies(film.outlines)
    with film.open() as source:
        times, options["u_time_s"] = film.frame_times(source)
        result = vision.track(source, bodies, times, **options)
    if film.owner is not None:
        result.info["clock_offset"] = clock_offsets(film.owner[1], result)
        film.store_angles(result.to_table(), _attributes(result, options.get("every", 1)))
    return result


def _attributes(result: vision.TrackResult, every: int) -> dict[str, Any]:
    """How the angles were found and what makes up their uncertainty, as attributes of the stored table."""
    attributes: dict[str, Any] = {"method": result.method, "every": every, "n_still": result.n_still}
    attributes |= {f"{b}_u_common_rad": float(u) for b, u in zip(result.bodies, result.u_common_rad, strict=True)}
    attributes |= {"camera": result.budget.camera, "shutter": result.budget.shutter}
    for body, (offset, u) in result.info.get("clock_offset", {}).items():
        attributes |= {f"{body}_clock_offset_s": offset, f"{body}_u_clock_offset_s": u}
    for relative, tail in ((False, ""), (True, "_relative")):
        for body, terms in result.budget.typical(relative).items():
            attributes |= {f"{body}{tail}_u_{name}_rad": value for name, value in terms.items()}
    return attributes


def tracking_summary(result: vision.TrackResult) -> dict[str, Any]:
    """Frames, lost ones, predicted and median uncertainty of each body and the terms of both (rad)."""
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
        "shutter": result.budget.shutter,
        "clock_offset_s": result.info.get("clock_offset", {}),
        **{name: result.info[name] for name in ("rows_resumed", "rows_confirmed", "wide_searches")},
    }


def budget_lines(budget: vision.ErrorBudget) -> list[str]:
    """A budget as lines of text, mdeg: one row per angle, one column per term."""
    names = (*TERMS, "total")
    lines = [f"{'u in mdeg':<26}" + "".join(f"{name[:10]:>11}" for name in names)]
    rows = {**budget.typical(), **{f"{b} from parent": terms for b, terms in budget.typical(relative=True).items()}}
    for body, terms in rows.items():
        lines.append(f"  {body:<24}" + "".join(f"{np.degrees(terms[name]) * 1e3:>11.1f}" for name in names))
    return [*lines, f"  ({budget.camera})", f"  ({budget.shutter})"]
