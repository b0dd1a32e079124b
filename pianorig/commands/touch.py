"""``pianorig touch``: how actions feel, side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated

import typer

import model
from pianorig.console.column_file import FIGURE_ENDINGS, check_writable, write_rows
from pianorig.console.options import AsJson, Scale, Scene, Settings, complete_file
from pianorig.console.output import file_lines, table_lines, tell, wrap_text
from pianorig.console.overrides import load_changed, name_with_scene
from pianorig.console.progress import working
from validation.numbers import number, with_u


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
            feels.append(model.measure_touch(action, name=name))
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
    lines = table_lines(("±: standard uncertainty", *names), _cells(feels, rows))
    for f in feels:
        loaded = [remark for remark in f.remarks if remark not in f.weights.remarks]
        lines += [line for remark in (*f.weights.remarks, *loaded[:1]) for line in wrap_text(f"{f.name}: {remark}")]
        if len(loaded) > 1:
            more = f"the check presses it at {len(loaded) - 1} larger forces, too; --json lists them"
            lines += wrap_text(f"{f.name}: {more}")
    plain = [{"action": f.name} | row | {"remarks": list(f.remarks)} for f, row in zip(feels, rows, strict=True)]
    facts = {"actions": plain, "figure": figure, "curve": curve}
    tell(as_json, facts, [*lines, *file_lines([figure, curve])])


def _cells(feels: Sequence[model.Touch], rows: Sequence[Mapping[str, float]]) -> list[list[str]]:
    """Rows of the table as text, a column an action: touch weights in grams with their standard uncertainty, everything
    else in the unit of `model.Touch.rows`, whose dicts ``rows`` are."""
    weights = [f.weights.rows() for f in feels]
    table = []
    for words in rows[0]:
        name, _, unit = words.rpartition(", ")
        if name not in weights[0] and not name.startswith("u of "):
            table.append([f"{name} ({unit})", *(_number(row[words]) for row in rows)])
        elif unit == "g":
            grams = [1e3 / f.gravity for f in feels]
            pairs = ((g * w[name][0], g * w[name][1]) for g, w in zip(grams, weights, strict=True))
            table.append([f"{name} (g)", *(with_u(round(value, 4), u).replace("–", "-") for value, u in pairs)])
    return table


def _number(value: float, digits: int = 3) -> str:  # significant
    return "-" if value != value else number(round(value, 5) + 0.0, digits)
