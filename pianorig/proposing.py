"""Outlines proposed from a film: a TOML file to correct and a picture to look at."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from .errors import InputError


def propose(film: Path, out: Path, *, allow_truncated: bool = False) -> dict[str, Any]:
    """Write proposed outlines to ``out`` and a picture of them beside it; an existing file is not overwritten.

    Returns
    -------
    dict : ``out``, ``picture``, ``bodies`` (names)
    """
    import cv2

    import vision
    from vision.proposal import draw_bodies, propose_bodies

    if out.suffix != ".toml":
        raise InputError(f"{out}: --propose-bodies writes outlines; the name must end in .toml")
    if out.exists():
        raise InputError(f"{out}: exists and may hold corrected outlines; choose another name or remove it")
    with vision.open_film(film, allow_truncated=allow_truncated) as source:
        bodies = propose_bodies(source)
        picture = draw_bodies(source.read(0), bodies, source.bit_depth)
    drawing = out.with_suffix(".png")
    ok, data = cv2.imencode(".png", picture)
    if not ok:
        raise InputError(f"{drawing}: the picture cannot be encoded")
    try:
        drawing.write_bytes(data.tobytes())
    except OSError as problem:
        raise InputError(f"{drawing}: cannot be written ({problem.strerror})") from None
    vision.save_bodies(out, bodies)
    return {"out": out, "picture": drawing, "bodies": [body.name for body in bodies]}
