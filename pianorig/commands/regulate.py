"""``pianorig regulate``: find the seven adjustments that bring an action to the regulation of the thesis."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

import model
from pianorig import workflows
from pianorig.console.column_file import FIGURE_ENDINGS, check_writable
from pianorig.console.options import BUILT_IN_ACTION, AsJson, Figure, Scene, Settings, complete_file
from pianorig.console.output import file_lines, table_lines, tell, wrap_text
from pianorig.console.overrides import load_changed, name_with_scene, read_settings
from pianorig.console.progress import working


def command(
    action: Annotated[str, typer.Argument(help=BUILT_IN_ACTION, autocompletion=complete_file("model/actions"))],
    out: Annotated[
        Path | None, typer.Option("--out", help="TOML file to write; without it the action is only measured.")
    ] = None,
    target_mm: Annotated[
        list[str] | None,
        typer.Option(
            "--target-mm",
            help="Another length wanted, name=mm; may be repeated. Names: dip, hammer_height, jack, repetition, "
            "let_off, drop, check.",
        ),
    ] = None,
    set_: Settings = None,
    scene: Scene = None,
    figure: Figure = None,
    as_json: AsJson = False,
) -> None:
    """Measure and regulate an action as a technician does.
    Dip, hammer height, jack, repetition lever, let-off, drop, back check: measured, and with --out set by turning their
    seven screws, and written as an action.

    Example:  pianorig regulate hirschkorn2004 --out regulated.toml
    Example:  pianorig regulate hirschkorn2004 --target-mm let_off=1.5 --out soft.toml
    """
    check_writable(out, ".toml")
    check_writable(figure, *FIGURE_ENDINGS)
    given = load_changed(action, set_, scene=scene)
    said = name_with_scene(given, scene).name
    wanted = {name: 1e-3 * length for name, length in read_settings(target_mm or [], "--target-mm").items()}
    targets = model.regulation.targets_at(wanted)
    if out is None:
        _measure(given, said, targets, figure, as_json)
    else:
        _regulate(given, said, wanted, (out, figure), as_json)


def _measure(
    given: model.Action,
    title: str,
    targets: Sequence[model.regulation.RegulationTarget],
    figure: Path | None,
    as_json: bool,
) -> None:
    """Measure the seven regulated lengths of an action, print each with the wanted one, mm, under ``title``, and draw
    them where ``figure`` names a file; the action is not changed."""
    with working("measuring the action", quiet=as_json):
        seen = model.regulation.measure(given)
    rows: list[dict[str, Any]] = [
        {
            "target": t.name,
            "words": t.words,
            "wanted_m": t.wanted_m,
            "measured_m": seen.value_m[t.name],
            "remark": seen.remarks.get(t.name),
        }
        for t in targets
    ]
    cells = [(row["words"], _millimetres(row["wanted_m"]), _millimetres(row["measured_m"])) for row in rows]
    lines = table_lines((f"{title}, mm", "wanted", "measured"), cells)
    for row in rows:
        lines += wrap_text(str(row["remark"]), f"{row['target']}: ") if row["remark"] else []
    if figure is not None:
        workflows.draw_targets(rows, "measured_m", figure)
    more = {"figure": figure} if figure is not None else {}
    tell(as_json, {"action": given.name, "targets": rows} | more, [*lines, *file_lines([figure])])


def _regulate(
    given: model.Action, title: str, wanted_m: Mapping[str, float], files: tuple[Path, Path | None], as_json: bool
) -> None:
    """Turn the seven screws of an action until the ``wanted_m`` lengths are met, write the result, and print each
    length before and after; ``files``: the action to write, and the figure or None."""
    out, figure = files
    with working("turning seven screws until seven targets are met", quiet=as_json):
        done = model.regulation.regulate(given, wanted_m=wanted_m)
    model.write_action(
        done.action,
        out,
        [
            f"{done.action.name}: {title} regulated by `pianorig regulate` to the targets of Hirschkorn (2004), "
            f"Section 2.3{model.regulation.other_lengths(done.targets)}.",
            f"{_turned_words(done)} differ from the given set; their source begins with 'regulated'. Standard",
            "uncertainty of a screw: what changes its target by its tolerance of 0.02 mm (rectangular).",
        ],
    )
    rows: list[dict[str, Any]] = [
        {
            "target": t.name,
            "words": t.words,
            "wanted_m": t.wanted_m,
            "before_m": done.before.value_m[t.name],
            "after_m": done.after.value_m[t.name],
            "screw": s.name,
            "path": s.path,
            "turned_m": done.turned_m[t.name],
        }
        for t, s in zip(done.targets, model.regulation.SCREWS, strict=True)
    ]
    lengths = ("wanted_m", "before_m", "after_m")
    cells = [
        (row["words"], *(_millimetres(row[key]) for key in lengths), row["screw"], f"{1e3 * row['turned_m']:+.3f}")
        for row in rows
    ]
    lines = table_lines((f"{title}, mm", "wanted", "before", "after", "screw", "turned"), cells)
    if done.rest_rail_m:
        rail = model.regulation.REST_RAIL
        lowered = f"lowered {-1e3 * done.rest_rail_m:.2f} mm"
        lines.append(f"the hammer lay on its rest rail ({rail.path}): {lowered}, clear of it")
    if done.action is given:
        lines.append("all seven targets are met: nothing was turned")
    facts: dict[str, Any] = {"action": done.action.name, "out": out, "targets": rows, "looks": done.evaluations}
    if figure is not None:
        workflows.draw_targets(rows, "before_m", figure)
        facts["figure"] = figure
    facts["rest_rail_m"] = done.rest_rail_m
    tell(as_json, facts, [*lines, *file_lines([figure]), f"{out}: {done.action.name}"])


def _turned_words(done: model.regulation.Regulation) -> str:
    count = sum(1 for turn in (*done.turned_m.values(), done.rest_rail_m) if turn)
    return f"{count or 'No'} quantities"


def _millimetres(value: float) -> str:
    # + 0.0 so that a tiny negative number does not read -0.00
    return "-" if value != value else f"{round(1e3 * value, 2) + 0.0:.2f}"
