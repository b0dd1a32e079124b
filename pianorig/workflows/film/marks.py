"""Points and lines followed through a film, alone or beside its bodies."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import vision
from pianorig.workflows.film.session_film import SessionFilm


def follow_marks_of(
    film: SessionFilm,
    marks: Path,
    *,
    every: int = 1,
    n_still: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> vision.MarkResult:
    """Follow the marks of a file through a film.

    Parameters
    ----------
    marks : TOML file, see `vision.load_marks`
    every, n_still, progress : as for `vision.follow_marks`

    Raises
    ------
    vision.VisionInputError : marks or film that cannot be used
    """
    known = vision.load_marks(marks)
    with film.open() as source:
        times, _ = film.frame_times(source)
        return vision.follow_marks(source, known, times, every=every, n_still=n_still, progress=progress)


def marks_summary(result: vision.MarkResult) -> dict[str, dict[str, float]]:
    """Per mark: frames, lost ones, and median standard uncertainty, px, of a line's offset or of a point's x and y."""
    lines = {}
    for i, mark in enumerate(result.marks):
        known = ~result.failed[:, i]
        names = ["u_offset_px"] if isinstance(mark, vision.LineMark) else ["u_x_px", "u_y_px"]
        values = {name: getattr(result, name)[known, i] for name in names}
        lines[mark.name] = {
            "frames": len(result.frame),
            "lost": int((~known).sum()),
            **{f"median_{name}": float(sorted(value)[len(value) // 2]) for name, value in values.items() if len(value)},
        }
    return lines


def marks_lines(summary: dict[str, dict[str, float]]) -> list[str]:
    """`marks_summary` as lines of text."""
    lines = []
    for name, facts in summary.items():
        sizes = [
            f"{key.removeprefix('median_').removesuffix('_px')} {facts[key]:.4f} px" for key in facts if "u_" in key
        ]
        lines.append(f"  {name:<16} {facts['lost']} frames lost; median {', '.join(sizes) or 'u not known'}")
    return lines
