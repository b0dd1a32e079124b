"""``pianorig attach``: bring a film from the camera's computer into its session."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pianorig import workflows
from pianorig.console.options import AsJson
from pianorig.console.output import tell


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

    Frame count, rate, trigger frame and hash must fit; the original stays where it is.

    Example:  pianorig attach film.mraw --trial 3 sessions/try
    """
    record = workflows.attach_film(
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
