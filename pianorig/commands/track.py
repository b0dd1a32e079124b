"""``pianorig track``: angles from a high-speed film."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def command(
    film: Annotated[Path, typer.Argument(help="Film: .mraw (+ .cih/.cihx), .avi, .mp4, .tif, folder of pictures.")],
    bodies: Annotated[
        Path | None, typer.Option("--bodies", help="TOML file with the outlines; default: the session's.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", help="CSV file; default: FILM with the ending .angles.csv.")
    ] = None,
    method: Annotated[str, typer.Option("--method", help="icgn or ecc.")] = "icgn",
    every: Annotated[int, typer.Option("--every", help="Track every N-th frame.")] = 1,
    overlay: Annotated[Path | None, typer.Option("--overlay", help="Film (.avi) with the tracked outlines.")] = None,
    contact_sheet: Annotated[
        Path | None, typer.Option("--contact-sheet", help="Picture (.png) of the worst frames.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print a JSON summary.")] = False,
) -> None:
    """Track rigid bodies and give their angles with a standard uncertainty per frame.

    Example:  pianorig track sessions/demo/trial_0001.mraw --out jack.csv
    """
    import math

    from ..output import check_writable, print_json, write_table
    from ..progress import bar, say
    from ..tracking import draw_track, expected_uncertainty, summary, track_film_file

    target = out if out is not None else film.with_suffix(".angles.csv")
    for path in (target, overlay, contact_sheet):
        if path is not None:
            check_writable(path)
    expected = expected_uncertainty(film, bodies)
    words = ", ".join(f"{body} {math.degrees(u) * 1e3:.1f}" for body, u in expected.items())
    say(f"expected standard uncertainty in mdeg: {words}", quiet=as_json)
    with bar("tracking", quiet=as_json) as progress:
        result = track_film_file(film, bodies, method=method, every=every, progress=progress)
    write_table(target, result.to_table())
    draw_track(film, bodies, result, overlay, contact_sheet)
    facts = summary(result)
    if as_json:
        print_json({"out": target, **facts})
        return
    print(f"{target}: {facts['frames']} frames")
    for body in result.bodies:
        u = math.degrees(facts["median_u_rad"][body]) * 1e3
        before = math.degrees(facts["predicted_u_rad"][body]) * 1e3
        print(f"  {body:<11} u = {u:.1f} mdeg (predicted {before:.1f}), {facts['lost'][body]} frames lost")
