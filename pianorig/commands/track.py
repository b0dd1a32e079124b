"""``pianorig track``: angles from a high-speed film."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pianorig import workflows
from pianorig.console.column_file import FIGURE_ENDINGS, check_writable, write_table
from pianorig.console.options import AsJson, refuse_beside
from pianorig.console.output import tell
from pianorig.console.progress import bar, say
from pianorig.errors import CommandInputError

if TYPE_CHECKING:
    from vision.tracking.options import FitOptions

READ = ("film", "out", "frame_rate", "allow_truncated", "channel", "first_frame", "last_frame")
"""What counts however a film is read."""


def command(
    ctx: typer.Context,
    film: Annotated[
        Path, typer.Argument(help="Film (.mraw, .cine, .avi, .mp4, .tif and others) or folder of pictures.")
    ],
    bodies: Annotated[
        Path | None, typer.Option("--bodies", help="TOML file with the outlines; default: the session's.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", help="CSV file; default: FILM with the ending .angles.csv.")
    ] = None,
    every: Annotated[int, typer.Option("--every", help="Use every N-th frame.")] = 1,
    n_still: Annotated[
        int | None, typer.Option("--n-still", min=1, help="Frames at rest at the start; default: found from the film.")
    ] = None,
    confirm: Annotated[
        str, typer.Option("--confirm", help="Rows to confirm by a backward pass: doubtful, all or none.")
    ] = "doubtful",
    threads: Annotated[
        int | None,
        typer.Option("--threads", min=1, help="Threads; default: the computer's. The angles do not depend on it."),
    ] = None,
    calibration: Annotated[
        Path | None, typer.Option("--calibration", help="Camera file of calibrate camera; corrects the angles.")
    ] = None,
    tilt: Annotated[
        float | None, typer.Option("--tilt", help="Without calibration: standard uncertainty of the tilt, deg [1].")
    ] = None,
    distortion: Annotated[
        float | None,
        typer.Option("--distortion", help="Without calibration: that of the distortion at the corner, % [0.1]."),
    ] = None,
    shutter: Annotated[
        str | None, typer.Option("--shutter", help="Of the sensor, for the budget: global or rolling.")
    ] = None,
    rows_per_second: Annotated[
        float | None, typer.Option("--rows-per-second", help="With --shutter rolling: rows read per second.")
    ] = None,
    frame_rate: Annotated[
        float | None, typer.Option("--frame-rate", help="True rate, frames/s, where the film does not say it.")
    ] = None,
    pixel_aspect: Annotated[
        float | None,
        typer.Option("--pixel-aspect", help="Width of a pixel over its height; default: the film's, else 1."),
    ] = None,
    deinterlace: Annotated[
        bool, typer.Option("--deinterlace", help="Of interlaced frames, track the field exposed first.")
    ] = False,
    allow_truncated: Annotated[
        bool, typer.Option("--allow-truncated", help="Read a film that was cut short to its last whole frame.")
    ] = False,
    channel: Annotated[
        str | None,
        typer.Option("--channel", help="Of a colour film red, green or blue; of a TIFF a channel's number."),
    ] = None,
    first_frame: Annotated[int, typer.Option("--from", min=0, help="First frame that is used; the still ones.")] = 0,
    last_frame: Annotated[int | None, typer.Option("--to", min=0, help="Last frame that is used.")] = None,
    restart: Annotated[
        bool, typer.Option("--restart", help="Start from the first frame, although an interrupted run could go on.")
    ] = False,
    retrack: Annotated[
        list[int] | None,
        typer.Option("--retrack", help="Fit this frame again, alone, and put it into the table; may be repeated."),
    ] = None,
    place: Annotated[
        list[str] | None,
        typer.Option("--place", help="Where a body is in those frames: body=ANGLE_DEG,X_PX,Y_PX; may be repeated."),
    ] = None,
    draw_frames: Annotated[
        Path | None,
        typer.Option("--draw-frames", help="Draw frames with a grid (.png), to draw outlines on, instead of tracking."),
    ] = None,
    preview: Annotated[
        int | None,
        typer.Option("--preview", min=1, max=60, help="First fit N frames and draw them: OUT with .preview.png."),
    ] = None,
    contact_sheet: Annotated[
        Path | None, typer.Option("--contact-sheet", help="Picture (.png) of the worst frames.")
    ] = None,
    figure: Annotated[
        Path | None, typer.Option("--figure", help="Draw angles and residuals: .svg, .pdf or .png.")
    ] = None,
    as_json: AsJson = False,
    propose_bodies: Annotated[Path | None, typer.Option("--propose-bodies", hidden=True)] = None,
    marks: Annotated[Path | None, typer.Option("--marks", hidden=True)] = None,
    overlay: Annotated[Path | None, typer.Option("--overlay", hidden=True)] = None,
) -> None:
    """Track rigid bodies; give angles and their uncertainty.
    A row a frame goes into the table --out, in place of one that is there, and into the film's session. Stopped by
    Ctrl-C, the same command goes on where it was.

    Example:  pianorig track film.mraw --bodies bodies.toml --out jack.csv --contact-sheet worst.png --figure jack.png
    """
    if film.name in ("", ".."):
        film = film.resolve()
        if not film.name:
            raise CommandInputError(f"{film}: is no film; give a film or a folder of pictures")
    if propose_bodies is not None:
        raise CommandInputError(
            "--propose-bodies is gone: draw the outlines with pianorig bench, or over --draw-frames FRAMES.png"
        )
    if marks is not None:
        raise CommandInputError("--marks is gone: track a body with an outline around the point or edge")
    if overlay is not None:
        raise CommandInputError("--overlay is gone: pianorig bench steps through the film with the tracked outlines")
    target = out if out is not None else film.with_suffix(".angles.csv")
    for path, endings in (
        (target, (".csv",)),
        (draw_frames, (".png",)),
        (contact_sheet, (".png",)),
        (figure, FIGURE_ENDINGS),
    ):
        check_writable(path, *endings)
    filmed = workflows.SessionFilm(film, bodies, frame_rate, allow_truncated, channel, first_frame, last_frame)
    if draw_frames is not None:
        refuse_beside(ctx, "--draw-frames", "tracks nothing", "draw_frames", "film", *READ[3:])
        drawn = workflows.draw_frames_of(filmed, draw_frames)
        tell(as_json, drawn, [f"{drawn['out']}: frames with a grid in film pixels; {drawn['first']}: the first one"])
        return
    camera = workflows.camera_of(calibration, tilt, distortion)
    workflows.check_pixel_aspect(pixel_aspect, calibration)
    fit: FitOptions = {
        "n_still": n_still,
        "camera": camera,
        "pixel_aspect": pixel_aspect,
        "deinterlace": deinterlace,
        "rows_per_s": workflows.rows_per_second(shutter, rows_per_second),
    }
    if retrack:
        whole = {"restart", "preview", "contact_sheet", "figure"}
        refuse_beside(ctx, "--retrack", "fits single frames only", *(ctx.params.keys() - whole))
        places = workflows.read_places(place or [])
        rows = workflows.retrack(filmed, target, retrack, places, **fit)
        facts = {"out": target, "rows": rows.to_dict(orient="records")}
        tell(as_json, facts, [f"{target}: {len(rows)} frames fitted again"])
        return
    if place:
        raise CommandInputError("--place: goes with --retrack FRAME")
    if (doubt := filmed.doubt_about_times) is not None:
        say(f"warning: {doubt}", quiet=as_json)
    seen = None
    if preview is not None:
        looked_at = target.with_suffix(".preview.png")
        seen = workflows.preview_track(filmed, looked_at, preview, **fit)
        say("\n".join([*seen["lines"], f"look at {looked_at}; Ctrl-C if outlines do not fit"]), quiet=as_json)
    unfinished = target.with_name(f"{target.name}.unfinished.npz")
    if restart:
        unfinished.unlink(missing_ok=True)
    with workflows.report_tracking_interrupt(unfinished), bar("tracking", quiet=as_json) as progress:
        result = workflows.track_film_file(
            filmed,
            **fit,
            every=every,
            confirm=confirm,
            threads=threads,
            checkpoint=unfinished,
            expected=lambda budget: say("expected " + "\n".join(workflows.budget_lines(budget)), quiet=as_json),
            progress=progress,
        )
    write_table(target, result.to_frame())
    workflows.draw_track(filmed, result, contact_sheet=contact_sheet, plot=figure)
    facts = workflows.tracking_summary(result)
    again = f", {facts['rows_resumed']} from an interrupted run" if facts["rows_resumed"] else ""
    lines = [
        f"{target}: {facts['frames']} frames{again}, {facts['rows_confirmed']} confirmed backward",
        *(f"  {body:<11} {facts['lost'][body]} frames lost" for body in result.bodies),
        *workflows.budget_lines(result.budget),
        *(
            f"  film against the encoder of the {body}: {offset * 1e6:+.0f} us (standard uncertainty {u * 1e6:.0f})"
            for body, (offset, u) in facts["clock_offset_s"].items()
        ),
    ]
    before = {"out": target, "doubt_about_times": doubt, **({"preview": seen} if seen else {})}
    tell(as_json, before | facts, lines)
