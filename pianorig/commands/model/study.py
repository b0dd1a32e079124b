"""``pianorig study``: the same blow on variants of an action, or the thesis's sensitivity studies checked."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pianorig.console.options import Scale

if TYPE_CHECKING:
    from model import Action
    from model.study import Study
    from model.study.thesis import ThesisStudy

THESIS, LIMIT = "thesis", "friction-limit"


def command(
    action: Annotated[
        str,
        typer.Argument(
            help="Built-in action or a TOML file; or the word thesis: its Figs 4.9-4.11, 4.16-4.19; or the word "
            "friction-limit: threshold speeds beside set-valued friction."
        ),
    ],
    force: Annotated[
        Path | None,
        typer.Option(
            "--force", help="CSV file with the columns time_s,force_n; after thesis or friction-limit: another forte."
        ),
    ] = None,
    variant: Annotated[
        list[str] | None,
        typer.Option("--variant", help='One variant, "name: --set path=value --scale name=factor"; may be repeated.'),
    ] = None,
    set_: Annotated[
        list[str] | None, typer.Option("--set", help="Parameter to change in all, path=value; may be repeated.")
    ] = None,
    scale: Scale = None,
    of: Annotated[
        str | None,
        typer.Option("--of", help="With thesis or friction-limit: the action to study; default hirschkorn2004."),
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", help="Folder for the figure and the tables.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Ask what if: several variants of an action under one blow, in one table and figure.

    Example:  pianorig study hirschkorn2004 --force forte.csv --variant "dry: --scale damping=0.1" --out dry
    """
    from pianorig.console.output import print_json
    from pianorig.console.overrides import load_changed
    from pianorig.errors import InputError

    if out is not None:
        _make_folder(out)
    if action in (THESIS, LIMIT):
        if variant:
            raise InputError(f"study {action}: has its own variants; leave out --variant or name an action")
        chosen = load_changed(of or "hirschkorn2004", set_, scale)
        if action == THESIS:
            facts = _thesis(chosen, force, out, quiet=as_json)
        else:
            from pianorig.workflows.model.friction_limit import friction_limit

            facts = friction_limit(chosen, force, out, quiet=as_json)
    else:
        if of is not None:
            raise InputError(
                f"--of {of}: goes with the words thesis and friction-limit only; name the action instead of {action}"
            )
        if force is None:
            raise InputError("--force: missing; name a CSV file with the columns time_s,force_n")
        facts = _variants(load_changed(action, set_, scale), force, variant or [], out, quiet=as_json)
    if as_json:
        print_json(facts)


def _make_folder(out: Path) -> None:
    """Make the folder for the results, or say why that cannot be."""
    from pianorig.errors import InputError

    try:
        out.mkdir(exist_ok=True)
    except OSError as problem:
        raise InputError(f"{out}: folder cannot be made ({problem.strerror}); choose another --out") from None


def _variants(action: Action, force: Path, texts: list[str], out: Path | None, quiet: bool) -> dict[str, Any]:
    """Simulate, print and write variants of an action."""
    import model
    from model.study import Variant, compare
    from pianorig.console.overrides import read_variant

    wanted = [Variant(*read_variant(text)) for text in texts]
    times, forces = model.read_force_table(force)
    study = compare(action, times, forces, wanted)
    files: list[Path] = []
    if out is not None:
        from model.study.figure import draw_study

        files = [out / "study.svg", out / "variants.csv"]
        draw_study(study, files[0])
        _write_rows(files[1], study.rows())
    if not quiet:
        _print_study(study)
        _print_files(files)
    return {"action": study.action, "force_table": force, "variants": _known(study.rows()), "files": files}


def _thesis(action: Action, force: Path | None, out: Path | None, quiet: bool) -> dict[str, Any]:
    """Simulate, print and write the thesis's studies."""
    import model
    from model.study.thesis import thesis_studies

    studies = thesis_studies(action, None if force is None else model.read_force_table(force))
    files: list[Path] = []
    if out is not None:
        from model.study.figure import draw_thesis

        files = [out / "thesis.svg", out / "observations.csv", out / "piano.csv", out / "forte.csv"]
        draw_thesis(studies, files[0])
        _write_rows(files[1], [asdict(o) for o in studies.observations])
        _write_rows(files[2], studies.piano.rows())
        _write_rows(files[3], studies.forte.rows())
    if not quiet:
        for blow, study in (("piano", studies.piano), ("forte", studies.forte)):
            print(f"{action.name}, {blow}")
            _print_study(study)
            print()
        _print_observations(studies)
        _print_files(files)
    return {
        "action": action.name,
        "observations": _known([asdict(o) for o in studies.observations]),
        "piano": _known(studies.piano.rows()),
        "forte": _known(studies.forte.rows()),
        "files": files,
    }


def _known(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Rows with null where there is no number."""
    return [{k: None if v != v else v for k, v in row.items()} for row in rows]


def _write_rows(path: Path, rows: list[dict[str, Any]]) -> None:
    import pandas as pd

    from pianorig.console.output import write_table

    write_table(path, pd.DataFrame(rows))


def _print_files(files: list[Path]) -> None:
    for path in files:
        print(path)


def _print_study(study: Study) -> None:
    """One line per variant."""
    width = max(12, *(len(v.name) for v in study.variants))
    print(
        f"{'variant':<{width}}  {'strike s':>9} {'m/s':>6} {'strikes':>7} {'held':>5} {'hold mm':>8} {'moved mm':>9}"
        f" {'lever':>6} {'RMS deg':>8}"
    )
    for row in study.rows():
        cells: dict[str, Any] = {k: float("nan") if v is None else v for k, v in row.items()}
        line = (
            f"{cells['variant']:<{width}}  {cells['strike_s']:>9.4f} {cells['strike_m_per_s']:>6.3f} "
            f"{cells['strikes']:>7} {'yes' if cells['held'] else 'no':>5} {1e3 * cells['hold_m']:>8.2f} "
            f"{1e3 * cells['hold_moved_m']:>9.3f} {cells['lever_bounces']:>6} "
            f"{57.29577951308232 * cells['hammer_rms_rad']:>8.3f}"
        )
        print(line.replace("nan", "  -"))
    print(
        "hold: hammer to string; moved: in the last 0.1 s of the hold; lever: touches of knuckle and lever meanwhile;"
    )
    print("RMS: hammer's turn against the action as given")


def _print_observations(studies: ThesisStudy) -> None:
    """The thesis's observations, line by line."""
    holding = sum(o.holds for o in studies.observations)
    print(f"observations of the thesis: {holding} of {len(studies.observations)} hold here")
    for o in studies.observations:
        place = f"{'Sec.' if o.figure == '4.4' else 'Fig.'} {o.figure}"
        print(f"{'holds' if o.holds else 'NOT':<6} {place:<10} {o.statement}")
        print(f"{'':<17} {o.judged_by}: {o.found:.3g}{f' {o.unit}' if o.unit else ''} (allowed {o.allowed})")
