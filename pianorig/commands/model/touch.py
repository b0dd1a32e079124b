"""``pianorig touch``: how actions feel, side by side."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pianorig.console.options import Scale


def command(
    actions: Annotated[list[str], typer.Argument(help="Built-in actions or TOML files.")],
    set_: Annotated[
        list[str] | None, typer.Option("--set", help="Parameter to change in all of them, path=value; may be repeated.")
    ] = None,
    scale: Scale = None,
    figure: Annotated[Path | None, typer.Option("--figure", help="Draw all in one sheet: .svg, .pdf or .png.")] = None,
    curve: Annotated[
        Path | None, typer.Option("--curve", help="Write the force-dip curves: .csv with action, way, dip_m, force_n.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Slow press and release, down, up and friction weight, let-off peak, hammer speeds, fastest repetition.

    Example:  pianorig touch hirschkorn2004 hirschkorn2004-regulated --figure touch.svg
    """
    from model import touch
    from pianorig.console.output import check_writable, print_json, write_table
    from pianorig.console.overrides import load_changed
    from pianorig.errors import InputError

    for path, endings in ((figure, (".svg", ".pdf", ".png")), (curve, (".csv",))):
        if path is not None:
            if path.suffix not in endings:
                raise InputError(f"{path}: ending found {path.suffix!r}, allowed {', '.join(endings)}")
            check_writable(path)
    chosen = [load_changed(action, set_, scale) for action in actions]
    names = [a.name for a in chosen]
    names = [n if names.count(n) == 1 else given for n, given in zip(names, actions, strict=True)]
    feels = [touch.feel(action, name=name) for action, name in zip(chosen, names, strict=True)]
    if figure is not None:
        from model.touch.figure import draw

        draw(feels, figure)
    if curve is not None:
        import pandas as pd

        parts = [
            pd.DataFrame({"action": f.name, "way": way, "dip_m": dip, "force_n": force})
            for f in feels
            for way, (dip, force) in zip(("down", "up"), f.weights.curve(), strict=True)
        ]
        write_table(curve, pd.concat(parts, ignore_index=True))
    if as_json:
        plain = [{"action": f.name} | {k: v if v == v else None for k, v in f.rows().items()} for f in feels]
        print_json({"actions": plain, "figure": figure, "curve": curve})
        return
    width = max(12, *(len(name) for name in names))
    print(f"{'':<26}" + "".join(f"  {name:>{width}}" for name in names))
    for words in feels[0].rows():
        values = [f.rows()[words] for f in feels]
        print(f"{words:<26}" + "".join(f"  {f'{v:.3g}' if v == v else '-':>{width}}" for v in values))
    for path in (figure, curve):
        if path is not None:
            print(path)
