"""Tracking of a film, alone or as part of a session: frames to draw on, angles, single frames again."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, Unpack

import numpy as np
import pandas as pd

import vision
from pianorig.console.column_file import read_table, write_table
from pianorig.console.failures import Interrupted, how_stopped
from pianorig.console.output import MOST_COLUMNS, table_lines, wrap_text
from pianorig.errors import CommandInputError
from pianorig.workflows.session_film import STEP, SessionFilm
from validation.measurement.film_offset import clock_offsets
from vision.output.contact_sheet import describe_row
from vision.output.outline_drawing import grey_picture
from vision.reference.rectified_film import ASPECTS
from vision.tracking.options import FitOptions, TrackOptions
from vision.uncertainty.budget import TERMS


def draw_frames_of(film: SessionFilm, out: Path) -> dict[str, Path]:
    """Write a picture of frames with a grid in film pixels, to draw outlines on, and the first one pixel by pixel."""
    plain = out.with_name(f"{out.stem}_first.png")
    with film.open() as source:
        vision.write_picture(out, vision.draw_frames(source))
        vision.write_picture(plain, grey_picture(source.read(0), source.bit_depth))
    return {"out": out, "first": plain}


COLUMNS = 3  # of frames in the preview


def preview_track(film: SessionFilm, picture: Path, count: int, **options: Unpack[FitOptions]) -> dict[str, Any]:
    """Fit ``count`` frames spread over a film and draw them into ``picture`` (.png); return picture, frame numbers,
    number of lost frames by body, and lines to print. No table is written."""
    bodies = vision.load_bodies(film.outlines)
    with film.open() as source:
        times, options["u_time_s"] = film.frame_times(source)
        result = numbered_in_film(film, vision.preview(source, bodies, count, times, **options))
    with film.open_whole() as source:
        vision.write_contact_sheet(picture, source, bodies, result, count=count, columns=min(count, COLUMNS))
    lines = []
    for row in range(len(result.frame)):
        where, remark = describe_row(result, row)
        angles = ", ".join(
            f"{body} {np.degrees(angle):+.3f} deg (standard uncertainty {1e3 * np.degrees(u):.1f} mdeg)"
            for body, angle, u in zip(result.bodies, result.angle_rad[row], result.u_angle_rad[row], strict=True)
            if np.isfinite(angle)
        )
        lines.append(f"{where}: {'; '.join(part for part in (angles, remark) if part)}")
    lost = {body: int(n) for body, n in zip(result.bodies, result.failed.sum(axis=0), strict=True)}
    return {"picture": picture, "frames": result.frame.tolist(), "lost": lost, "lines": lines}


@contextmanager
def report_tracking_interrupt(unfinished: Path) -> Iterator[None]:
    """Context that turns Ctrl-C during a tracking into `Interrupted`, whose message says whether the frames so far are
    kept in the file ``unfinished``."""
    try:
        yield
    except KeyboardInterrupt as interrupt:
        kept = f"frames so far are kept in {unfinished}, the same command goes on there"
        left = kept if unfinished.is_file() else "no frame was kept"
        raise Interrupted(f"{how_stopped(interrupt)}; {left}; no table was written") from interrupt


def camera_of(
    calibration: Path | None, u_tilt_deg: float | None = None, u_distortion_percent: float | None = None
) -> vision.CameraModel:
    """What is known of the camera: its calibration file, or without one the standard uncertainties of tilt (degrees)
    and distortion (%), None: the assumed ones; CommandInputError for both."""
    if calibration is None:
        plain = vision.AssumedCamera()
        return vision.AssumedCamera(
            plain.u_tilt_rad if u_tilt_deg is None else float(np.radians(u_tilt_deg)),
            plain.u_radial if u_distortion_percent is None else u_distortion_percent / 100.0,
        )
    if u_tilt_deg is not None or u_distortion_percent is not None:
        raise CommandInputError(f"{calibration}: a calibrated camera needs no --tilt and --distortion; leave one out")
    return vision.load_calibration(calibration)


def check_pixel_aspect(pixel_aspect: float | None, calibration: Path | None) -> None:
    """CommandInputError for a pixel aspect (width over height) that is out of range, or given beside a calibration
    file, which has measured it; None, not given, is fine."""
    if pixel_aspect is None:
        return
    if calibration is not None:
        raise CommandInputError(f"{calibration}: has measured the pixel aspect; leave out --pixel-aspect")
    if not ASPECTS[0] <= pixel_aspect <= ASPECTS[1]:
        raise CommandInputError(
            f"--pixel-aspect {pixel_aspect:g}: allowed {ASPECTS[0]:g} to {ASPECTS[1]:g}, the width of a pixel over its "
            "height"
        )


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
    contact_sheet: Path | None = None,
    plot: Path | None = None,
) -> None:
    """Write a picture (.png) of the worst frames with their outlines (``contact_sheet``) and one of angles and
    residuals over time (``plot``), each where it is named."""
    if plot is not None:
        vision.write_plot(plot, result)
    if contact_sheet is not None:
        with film.open_whole(allow_truncated=True) as source:
            vision.write_contact_sheet(contact_sheet, source, vision.load_bodies(film.outlines), result)


def track_film_file(film: SessionFilm, **options: Unpack[TrackOptions]) -> vision.TrackResult:
    """Track the bodies outlined for a film, at times by its trial's frame clock where it has one, and store the angles
    in its session, if any; no table beside the film is written. Return the result."""
    bodies = vision.load_bodies(film.outlines)
    with film.open() as source:
        times, options["u_time_s"] = film.frame_times(source)
        result = numbered_in_film(film, vision.track(source, bodies, times, **options))
    if film.owner is not None:
        result.info["clock_offset"] = clock_offsets(film.owner[1], result)
        part = {"first_frame": film.first_frame} if film.is_part else {}
        part |= {"last_frame": film.last_frame} if film.last_frame is not None else {}
        film.store_angles(result.to_frame(), _table_attributes(result, options.get("every", 1)) | part)
    return result


def numbered_in_film(film: SessionFilm, result: vision.TrackResult) -> vision.TrackResult:
    return replace(result, frame=result.frame + film.first_frame)


def _table_attributes(result: vision.TrackResult, every: int) -> dict[str, Any]:
    """Attributes of the stored table, by name: every how many frames were tracked (``every``), frames at rest, camera,
    shutter, clock offsets, s, and the typical terms of each angle's uncertainty, rad."""
    attributes: dict[str, Any] = {"every": every, "n_still": result.n_still}
    attributes |= {f"{b}_u_common_rad": float(u) for b, u in zip(result.bodies, result.u_common_rad, strict=True)}
    attributes |= {"camera": result.budget.camera, "shutter": result.budget.shutter}
    if (field := result.info.get("first_field", "none")) != "none":
        attributes["first_field"] = field
    for body, (offset, u) in result.info.get("clock_offset", {}).items():
        attributes |= {f"{body}_clock_offset_s": offset, f"{body}_u_clock_offset_s": u}
    for relative, tail in ((False, ""), (True, "_relative")):
        for body, terms in result.budget.typical(relative).items():
            attributes |= {f"{body}{tail}_u_{name}_rad": value for name, value in terms.items()}
    return attributes


def tracking_summary(result: vision.TrackResult) -> dict[str, Any]:
    """Facts of a tracking by name, as ``--json`` prints them: number of frames, lost ones, predicted and median
    standard uncertainty and its terms by body, rad, clock offsets, s."""
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


ALWAYS = TERMS[: TERMS.index("rows") + 1]
"""Terms that are shown although they are 0."""


def budget_lines(budget: vision.ErrorBudget) -> list[str]:
    """Lines of a table of uncertainty, mdeg: a row for each term and the total, a column for each angle and, as
    ``body/parent``, for each relative angle; then camera and shutter in words."""
    everything = [*budget.absolute.items(), *budget.relative.items()]
    # terms that this film does not have are not shown
    names = [name for name in TERMS if name in ALWAYS or any(key == name and np.any(u > 0.0) for key, u in everything)]
    relative = {f"{body}/parent": terms for body, terms in budget.typical(relative=True).items()}
    angles = list({**budget.typical(), **relative}.items())
    lines = ["uncertainty in mdeg" + (" (/parent: of the angle from the parent)" if relative else "")]
    while angles:
        widths = np.cumsum([max(map(len, names)), *(2 + len(angle) for angle, _ in angles)])
        fitting = max(1, int(np.count_nonzero(widths[1:] <= MOST_COLUMNS - 2)))
        some, angles = angles[:fitting], angles[fitting:]
        head = ("term", *(angle for angle, _ in some))
        rows = [(name, *(f"{np.degrees(terms[name]) * 1e3:.1f}" for _, terms in some)) for name in (*names, "total")]
        lines += [f"  {line}" for line in table_lines(head, rows)]
    return lines + [line for text in (budget.camera, budget.shutter) for line in wrap_text(f"({text})", "  ")]


Place = tuple[float, float, float]  # angle rad, x px, y px


def read_places(texts: Sequence[str]) -> dict[str, Place]:
    """Places of bodies by name, (angle rad, x px, y px), from texts ``body=ANGLE_DEG,X_PX,Y_PX``; CommandInputError for
    another form."""
    places = {}
    for text in texts:
        name, _, values = text.partition("=")
        try:
            angle, x, y = (float(value) for value in values.split(","))
        except ValueError:
            raise CommandInputError(
                f"--place {text}: allowed body=ANGLE_DEG,X_PX,Y_PX, for example jack=-12.5,213,88"
            ) from None
        places[name.strip()] = (float(np.radians(angle)), x, y)
    return places


def retrack(
    film: SessionFilm,
    table_file: Path,
    frames: Sequence[int],
    places: dict[str, Place],
    **options: Unpack[FitOptions],
) -> pd.DataFrame:
    """Fit single frames (numbers in the film) again, bodies from ``places`` or interpolated between other frames;
    rewrite their rows in ``table_file`` and the session; return the new rows. CommandInputError for a frame not in the
    table."""
    from scipy.interpolate import make_interp_spline  # start-up: only a frame that is fitted again needs it

    bodies = vision.load_bodies(film.outlines)
    needed = (f"{body.name}{tail}" for body in bodies for tail in ("_rad", "_x_px", "_y_px", "_flag"))
    table = read_table(table_file, "track the film first", ("time_s", "frame", *needed))
    unknown = sorted(set(places) - {body.name for body in bodies})
    if unknown:
        raise CommandInputError(f"--place {unknown[0]}: is not a body of {film.outlines}")
    stored = None if film.owner is None else film.owner[0].read_derived(STEP, film.owner[1].number)
    attributes = {} if stored is None else {k: v for k, v in stored[1].items() if k != "parents_sha256"}
    if "first_frame" in attributes and not film.is_part:
        film = replace(
            film, first_frame=int(attributes["first_frame"]), last_frame=_number_or_none(attributes.get("last_frame"))
        )
    rows = []
    for frame in frames:
        if frame < 0:
            raise CommandInputError(f"--retrack {frame}: allowed numbers of frames from 0 on")
        found = np.flatnonzero(table["frame"].to_numpy() == frame)
        if found.size != 1:
            raise CommandInputError(f"--retrack {frame}: no such frame in {table_file}")
        rows.append(int(found[0]))
    with film.open() as source:
        times, u_time = film.frame_times(source)
        if film.owner is None and len(table) > 1:  # times of a film on its own are those it was tracked with
            in_film = film.first_frame + np.arange(source.n_frames)
            there = table[table["frame"] >= 0]  # others are missing in the film
            times = make_interp_spline(there["frame"], there["time_s"], k=1)(in_film)
        options["u_time_s"] = u_time
        if options.get("deinterlace"):
            options["first_field"] = _tracked_field(film, source, attributes)
        if options.get("n_still") is None:
            options["n_still"] = attributes.get("n_still")
        result = vision.retrack_frames(
            source,
            bodies,
            [frame - film.first_frame for frame in frames],
            [{**_interpolate_places(table, row, bodies), **places} for row in rows],
            times,
            **options,
        )
    now = _table_attributes(result, 1)
    for name in ("n_still", "camera", "shutter"):
        if attributes.get(name, now[name]) != now[name]:
            raise CommandInputError(
                f"{film.path}: {name} is {now[name]}, the table's is {attributes[name]}; fit the frame again with "
                "pianorig track --retrack  and the options of the first tracking"
            )
    new = pd.DataFrame(result.to_frame())
    for number, row in enumerate(rows):
        for name in table.columns.drop(["time_s", "frame"]):
            table.loc[row, name] = new.loc[number, name]
    write_table(table_file, table)
    if film.owner is not None:
        before = [int(number) for number in str(attributes.get("retracked_frames", "")).split(", ") if number]
        every = ", ".join(map(str, sorted({*before, *frames})))
        film.store_angles(table, {**attributes, "retracked_frames": every})
    return new


def _tracked_field(film: SessionFilm, source: vision.Film, attributes: dict[str, Any]) -> str:
    """Field of interlaced frames that the table is of, 'even' or 'odd' rows, by the stored attributes, else by the
    film; `CommandInputError` where neither says it."""
    known = attributes.get("first_field", source.first_field)
    if known is None:
        raise CommandInputError(
            f"{film.path}: its file does not say which rows of its interlaced frames were tracked; track it whole again"
        )
    return str(known)


def _number_or_none(value: Any) -> int | None:
    return None if value is None else int(value)


def _interpolate_places(table: pd.DataFrame, row: int, bodies: Sequence[vision.Body]) -> dict[str, Place]:
    """Place (angle rad, x px, y px) of each body in the table's row of this index, interpolated over the frame number
    from the other rows in which it is known; CommandInputError where none is."""
    places = {}
    frame = table["frame"].to_numpy(dtype=float)
    for body in bodies:
        values = table[[f"{body.name}_rad", f"{body.name}_x_px", f"{body.name}_y_px"]].to_numpy(dtype=float)
        known = np.isfinite(values).all(axis=1)
        known[row] = False
        if not known.any():
            raise CommandInputError(f"body {body.name} is lost in every other frame; name its place with --place")
        angle, x, y = (float(np.interp(frame[row], frame[known], values[known, k])) for k in range(3))
        places[body.name] = (angle, x, y)
    return places
