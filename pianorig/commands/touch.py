"""``pianorig touch``: how actions feel, side by side."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import model
from pianorig.console.column_file import FIGURE_ENDINGS, check_writable, write_rows
from pianorig.console.options import AsJson, Scale, Scene, Settings, complete_file
from pianorig.console.output import file_lines, tell
from pianorig.console.overrides import load_changed, name_with_scene
from pianorig.console.progress import working


def command(
    actions: Annotated[
        list[str], typer.Argument(help="Built-in actions or TOML files.", autocompletion=complete_file("model/actions"))
    ],
    set_: Settings = None,
    scale: Scale = None,
    scene: Scene = None,
    figure: Annotated[Path | None, typer.Option("--figure", help="Draw all in one sheet: .svg, .pdf or .png.")] = None,
    curve: Annotated[
        Path | None, typer.Option("--curve", help="Write the force-dip curves: .csv with action, way, dip_m, force_n.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Compare how actions feel, from slow press to repetition.

    Slow press and release: down, up, balance and friction weight, let-off peak; hammer speeds, fastest repetition.

    Example:  pianorig touch hirschkorn2004 hirschkorn2004-regulated --figure touch.svg
    """
    check_writable(figure, *FIGURE_ENDINGS)
    check_writable(curve, ".csv")
    chosen = [name_with_scene(load_changed(action, set_, scale, scene), scene) for action in actions]
    names = [a.name for a in chosen]
    names = [n if names.count(n) == 1 else given for n, given in zip(names, actions, strict=True)]
    feels = []
    for action, name in zip(chosen, names, strict=True):
        with working(f"pressing, striking and repeating {name}", quiet=as_json):
            feels.append(model.touch.feel(action, name=name))
    if figure is not None:
        model.touch.figure.draw(feels, figure)
    if curve is not None:
        points = [
            {"action": felt.name, "way": way, "dip_m": dip_m, "force_n": force_n}
            for felt in feels
            for way, columns in zip(("down", "up"), felt.weights.curve(), strict=True)
            for dip_m, force_n in zip(*columns, strict=True)
        ]
        write_rows(curve, points)
    rows = [f.rows() for f in feels]
    width = max(12, *(len(name) for name in names))
    lines = [f"{'':<26}" + "".join(f"  {name:>{width}}" for name in names)]
    for words in rows[0]:
        values = [row[words] for row in rows]
        lines.append(f"{words:<26}" + "".join(f"  {_number(v, words):>{width}}" for v in values))
    for f in feels:
        loaded = [remark for remark in f.remarks if remark not in f.weights.remarks]
        lines += [f"{f.name}: {remark}" for remark in (*f.weights.remarks, *loaded[:1])]
        if len(loaded) > 1:
            lines.append(f"{f.name}: the check presses it at {len(loaded) - 1} larger forces, too; --json lists them")
    plain = [{"action": f.name} | row | {"remarks": list(f.remarks)} for f, row in zip(feels, rows, strict=True)]
    facts = {"actions": plain, "figure": figure, "curve": curve}
    tell(as_json, facts, [*lines, *file_lines([figure, curve])])


def _number(value: float, row: str) -> str:
    """Three digits, none below a milligram, where rounding lies; of newtons none below 10 uN."""
    return "-" if value != value else f"{round(value, 3 if row.endswith(', g') else 5) + 0.0:.3g}"
