"""``pianorig study``: what a blow becomes on variants of an action."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, Any, NamedTuple, TypeAlias

import typer

import model
from pianorig import workflows
from pianorig.console.column_file import make_folder, write_rows
from pianorig.console.options import DEFAULT_ACTION, Action, AsJson, Scale, Scene, Settings
from pianorig.console.output import file_lines, tell
from pianorig.console.overrides import load_changed, name_with_scene, read_variant, say_idle
from pianorig.console.progress import working

Rows = list[dict[str, Any]]

Force: TypeAlias = Annotated[
    Path | None,
    typer.Option("--force", help="CSV of time_s,force_n, or a sealed trial; default: the built-in forte."),
]
Out: TypeAlias = Annotated[Path | None, typer.Option("--out", help="Folder for the figures and the tables.")]


class Found(NamedTuple):
    """What a study gives: lines to print, tables by the name of their CSV file, facts of the JSON, figures by name."""

    lines: list[str]
    tables: dict[str, Rows]
    facts: dict[str, Any]
    figures: Mapping[str, Callable[[Path], None]]


def variants(
    force: Annotated[Path, typer.Option("--force", help="CSV of time_s,force_n, or a sealed trial.")],
    variant: Annotated[
        list[str] | None,
        typer.Option("--variant", help='One variant, "name: --set path=value --scale name=factor"; may be repeated.'),
    ] = None,
    action: Action = DEFAULT_ACTION,
    set_: Settings = None,
    scale: Scale = None,
    scene: Scene = None,
    out: Out = None,
    as_json: AsJson = False,
) -> None:
    """Compare variants of an action under one blow.
    Strike, hold and motion of the hammer, for each variant and for the action as it is; with --out also as tables and
    pictures.

    Example:  pianorig study variants --force force.csv --variant "dry: --scale damping=0.1"
    """
    chosen = name_with_scene(load_changed(action, set_, scale, scene), scene)
    given = [model.study.Variant(*read_variant(text)) for text in variant or []]
    say_idle(chosen, [name for one in given for name in (*one.values, *one.factors)])
    _report(chosen, force, "", f"simulating {len(given) + 1} blows", partial(_compare, given), (out, as_json))


def thesis(
    action: Action = DEFAULT_ACTION,
    force: Force = None,
    set_: Settings = None,
    scale: Scale = None,
    scene: Scene = None,
    out: Out = None,
    as_json: AsJson = False,
) -> None:
    """Compare the thesis's variants of damping and friction.
    In a piano and a forte blow, as in its Sections 4.2.2 and 4.4. Which of its observations hold: examples/thesis.

    Example:  pianorig study thesis --action hirschkorn2004-regulated --out thesis
    """
    chosen = name_with_scene(load_changed(action, set_, scale, scene), scene)
    model.choice_of(chosen).need_played_key(chosen.name)  # the piano is a force on the key
    _report(chosen, force, "thesis-forte", "simulating nine blows", _compare_as_thesis, (out, as_json))


def _report(
    action: model.Action,
    force: Path | None,
    built_in: str,
    activity: str,
    study: Callable[[model.Action, Any, Any], Found],
    output: tuple[Path | None, bool],
) -> None:
    """Run ``study`` (action, times s, force N) on the user's table ``force`` or, for None, the ``built_in`` one, print
    what it found; ``output``: folder for its tables and pictures or None, and whether to print JSON."""
    out, as_json = output
    make_folder(out)
    driving = None if force is None else workflows.read_driving_force(force, model.choice_of(action).input_column)
    blow = model.force_table(built_in) if driving is None else (driving.time_s, driving.force_n)
    with working(activity, as_json):
        found = study(action, *blow)
    files: list[Path] = []
    if out is not None:
        for name, draw in found.figures.items():
            files.append(out / name)
            draw(files[-1])
        for name, rows in found.tables.items():
            files.append(out / f"{name}.csv")
            write_rows(files[-1], rows)
    facts = {"action": action.name, "force_table": force or built_in, **found.facts, "files": files}
    tell(as_json, facts, [*found.lines, *file_lines(files)])


def _compare(given: Sequence[model.study.Variant], action: model.Action, time_s: Any, force_n: Any) -> Found:
    """Variants of an action; under a trial the arm's preload acts from the first sample on."""
    study = model.study.compare(action, time_s, force_n, given)
    rows = study.rows()
    figures = {"study.svg": partial(model.study.draw_study, study)}
    return Found(_study_lines(study), {"variants": rows}, {"variants": rows}, figures)


def _compare_as_thesis(action: model.Action, time_s: Any, force_n: Any) -> Found:
    """Compare the thesis's variants: of damping under the built-in piano blow (Section 4.2.2), and of damping and
    friction under the given force as its forte blow (Section 4.4); lines, tables and pictures of both."""
    studies = {
        "piano": model.study.compare(action, *model.force_table("piano"), model.study.PIANO_VARIANTS),
        "forte": model.study.compare(action, time_s, force_n, model.study.FORTE_VARIANTS),
    }
    lines = []
    for blow, study in studies.items():
        lines += [f"{action.name}, {blow}", *_study_lines(study), ""]
    tables = {blow: study.rows() for blow, study in studies.items()}
    figures = {f"{blow}.svg": partial(model.study.draw_study, study) for blow, study in studies.items()}
    return Found(lines[:-1], tables, tables, figures)


def _study_lines(study: model.study.Study) -> list[str]:
    """Lines of a table, a variant a row: time and speed of the strike, whether the hammer is held and where, bounces of
    the lever, RMS difference of the hammer's angle from the action as given."""
    width = max(12, *(len(v.name) for v in study.variants))  # column
    lines = [
        f"{'variant':<{width}}  {'strike s':>9} {'m/s':>6} {'strikes':>7} {'held':>5} {'hold mm':>8} {'moved mm':>9}"
        f" {'lever':>6} {'RMS deg':>8}"
    ]
    for row in study.rows():
        cells: dict[str, Any] = {k: math.nan if v is None else v for k, v in row.items()}
        line = (
            f"{cells['variant']:<{width}}  {cells['strike_s']:>9.4f} {cells['strike_m_per_s']:>6.3f} "
            f"{cells['strikes']:>7} {'yes' if cells['held'] else 'no':>5} {1e3 * cells['hold_m']:>8.2f} "
            f"{1e3 * cells['hold_moved_m']:>9.3f} {cells['lever_bounces']:>6} "
            f"{math.degrees(cells['hammer_rms_rad']):>8.3f}"
        )
        lines.append(line.replace("nan", "  -"))
    return [
        *lines,
        "hold: hammer to string; moved: in the last 0.1 s of the hold; lever: contacts of knuckle and lever meanwhile;",
        "RMS: difference of the hammer's angle from the action as given",
    ]
