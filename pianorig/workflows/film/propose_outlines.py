"""Outlines proposed from a film: a TOML file to correct and a picture to judge it by."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import vision
from pianorig.errors import CommandInputError
from vision.output.outline_drawing import grey_picture


def propose_outlines(
    film: Path, out: Path, *, allow_truncated: bool = False, channel: str | None = None
) -> dict[str, Any]:
    """Write proposed outlines to ``out`` and a picture of them beside it; an existing file is not overwritten.

    Where none can be proposed, the picture shows frames to draw outlines on, and the first frame is written pixel by
    pixel, as ``…_frame.png``.

    Returns
    -------
    dict : ``out``, ``picture``, ``bodies`` (names)

    Raises
    ------
    vision.TrackingError : none can be proposed; the reason and the pictures are named
    """
    if out.suffix != ".toml":
        raise CommandInputError(f"{out}: --propose-bodies writes outlines; the name must end in .toml")
    if out.exists():
        raise CommandInputError(f"{out}: exists and may hold corrected outlines; choose another name or remove it")
    with vision.open_film(film, allow_truncated=allow_truncated, channel=channel) as source:
        try:
            bodies = vision.propose_bodies(source)
        except vision.TrackingError as error:
            plain = out.with_name(f"{out.stem}_frame.png")
            vision.write_picture(out.with_suffix(".png"), vision.draw_frames(source))
            vision.write_picture(plain, grey_picture(source.read(0), source.bit_depth))
            raise vision.TrackingError(
                f"{error}: {out.with_suffix('.png')} shows frames and their pixels, {plain} the first one as it is"
            ) from None
        picture = vision.draw_bodies(source.read(0), bodies, source.bit_depth)
    drawing = out.with_suffix(".png")
    vision.write_picture(drawing, picture)
    vision.save_bodies(out, bodies)
    return {"out": out, "picture": drawing, "bodies": [body.name for body in bodies]}
