"""Outlines proposed from a film: a TOML file to correct and a picture to look at."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pianorig.errors import InputError


def propose(film: Path, out: Path, *, allow_truncated: bool = False) -> dict[str, Any]:
    """Write proposed outlines to ``out`` and a picture of them beside it; an existing file is not overwritten.

    Returns
    -------
    dict : ``out``, ``picture``, ``bodies`` (names)
    """
    import vision
    from vision.output.outline_drawing import draw_bodies, write_picture
    from vision.tracking.propose_outlines import propose_bodies

    if out.suffix != ".toml":
        raise InputError(f"{out}: --propose-bodies writes outlines; the name must end in .toml")
    if out.exists():
        raise InputError(f"{out}: exists and may hold corrected outlines; choose another name or remove it")
    with vision.open_film(film, allow_truncated=allow_truncated) as source:
        bodies = propose_bodies(source)
        picture = draw_bodies(source.read(0), bodies, source.bit_depth)
    drawing = out.with_suffix(".png")
    write_picture(drawing, picture)
    vision.save_bodies(out, bodies)
    return {"out": out, "picture": drawing, "bodies": [body.name for body in bodies]}
