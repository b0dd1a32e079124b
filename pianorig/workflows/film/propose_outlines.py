"""Outlines proposed from a film: a TOML file to correct and a picture to judge it by."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import vision
from pianorig.errors import CommandInputError


def propose_outlines(film: Path, out: Path, *, allow_truncated: bool = False) -> dict[str, Any]:
    """Write proposed outlines to ``out`` and a picture of them beside it; an existing file is not overwritten.

    Returns
    -------
    dict : ``out``, ``picture``, ``bodies`` (names)
    """
    if out.suffix != ".toml":
        raise CommandInputError(f"{out}: --propose-bodies writes outlines; the name must end in .toml")
    if out.exists():
        raise CommandInputError(f"{out}: exists and may hold corrected outlines; choose another name or remove it")
    with vision.open_film(film, allow_truncated=allow_truncated) as source:
        bodies = vision.propose_bodies(source)
        picture = vision.draw_bodies(source.read(0), bodies, source.bit_depth)
    drawing = out.with_suffix(".png")
    vision.write_picture(drawing, picture)
    vision.save_bodies(out, bodies)
    return {"out": out, "picture": drawing, "bodies": [body.name for body in bodies]}
