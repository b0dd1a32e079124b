"""``pianorig sensitivity``: the local sensitivities of a blow to an action's parameters, as a table and a figure."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import model
from pianorig import workflows
from pianorig.console import options
from pianorig.console.column_file import make_folder, write_rows
from pianorig.console.options import DEFAULT_ACTION, AsJson, Scale, Scene, Settings
from pianorig.console.output import file_lines, tell
from pianorig.console.overrides import load_changed, name_with_scene
from pianorig.console.progress import say, working
from pianorig.errors import CommandInputError

MOST_LINES = 20  # of a table: one screen
HEADINGS = {
    "let_off_m": "let-off", "strike_m_per_s": "speed", "check_m": "check", "drop_s": "drop time",
    "key curve": "key curve", "hammer curve": "hammer c.",
}  # fmt: skip
DIRECTION = (".normal.x", ".normal.y")


def command(
    blow: Annotated[
        Path,
        typer.Argument(help="A session, one of its sealed trials, or a CSV of time_s,force_n.", show_default=False),
    ],
    action: options.Action = DEFAULT_ACTION,
    parameters: Annotated[
        str | None,
        typer.Option(
            "--parameters",
            help="Names, separated by commas: paths as in --set; laws, groups and patterns as in --scale. By default "
            "all that do something in this blow.",
        ),
    ] = None,
    trial: Annotated[
        int | None, typer.Option("--trial", help="Trial of a session; default the first that is not rejected.")
    ] = None,
    set_: Settings = None,
    scale: Scale = None,
    scene: Scene = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", help="Folder for the table and its figure."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Rank parameters by what they do to a blow.
    Percent of each event and curve per percent of each parameter, about the action as it is; with --out also as a table
    and a picture.

    Over the parameters'
    uncertainties, all varied together: examples/global_sensitivity.py (Morris, Sobol').

    Example:  pianorig sensitivity force.csv --parameters friction,hammer.mass,contact02 --out sensitivity
    """
    names = None if parameters is None else [name.strip() for name in parameters.split(",") if name.strip()]
    chosen = name_with_scene(load_changed(action, set_, scale, scene), scene)
    make_folder(out)
    source = _find_force_file(blow, trial)
    driving = workflows.read_driving_force(source, model.choice_of(chosen).input_column)
    local = _local_sensitivities(chosen, driving, names, as_json)
    if not as_json:
        _print_elasticities(local, chosen.name)
    files: list[Path] = []
    if out is not None:
        files = [out / "local.csv", out / "local.svg"]
        write_rows(files[0], local.rows())
        model.sensitivity.draw_local(local, files[1], name=chosen.name)
    facts = {"action": chosen.name, "blow": source, "local": local.rows(), "files": files}
    tell(as_json, facts, file_lines(files))


def _find_force_file(blow: Path, trial: int | None) -> Path:
    """File of the force: ``blow`` itself where it is a file; of a session folder that of trial ``trial``, by default
    the first that can be read and is not rejected."""
    if not blow.is_dir():
        if trial is not None:
            raise CommandInputError(f"--trial {trial}: goes with a session; {blow} is no folder")
        return blow
    from rig.session.folder import Session  # start-up: h5py and pandas cost 0.4 s that a table does not need

    session = Session.open(blow)
    if trial is not None:
        return session.trial(trial).path
    usable = [one for one in session.readable_trials if one.rejected is None]
    if not usable:
        raise CommandInputError(f"{blow}: all its trials are rejected or unreadable; name one with --trial")
    return usable[0].path


def _local_sensitivities(
    action: model.Action, driving: workflows.DrivingForce, names: list[str] | None, quiet: bool
) -> model.sensitivity.LocalTable:
    """Elasticities (percent per percent) of a blow's results to the parameters ``names``, paths such as
    contact04.friction.A; None: all that have an effect. ``quiet``: no progress."""
    for name in names or ():
        if name.endswith(DIRECTION) and name in action.quantities:
            raise CommandInputError(
                f"--parameters {name}: is fixed by the geometry, as one component of a direction of length 1; leave it "
                "out, or name a position of the same contact"
            )
    wanted = model.sensitivity.effective_paths(action) if names is None else names
    options = model.SensitivityOptions(rest_input=driving.preload_n, allow_idle=names is None)
    with working(f"differentiating a blow by {len(wanted)} parameters", quiet):
        found = model.sensitivities(action, (driving.time_s, driving.force_n), wanted, options=options)
    if found.at_kink and not quiet:
        say(f"at rest {', '.join(found.at_kink)} only just touches: the table holds on that side alone")
    return model.sensitivity.local_table(found)


def _print_elasticities(table: model.sensitivity.LocalTable, action_name: str) -> None:
    """Print a table of elasticities, percent of a result per percent of a parameter: the first `MOST_LINES` parameters,
    and how many more there are."""
    from model.sensitivity.local_table import lines  # start-up: NumPy, which --help does not need

    print(f"{action_name}: percent of a quantity per percent of a parameter")
    for line in lines(table, HEADINGS, MOST_LINES):
        print(line)
    if len(table.parameters) > MOST_LINES:
        print(f"and {len(table.parameters) - MOST_LINES} more, each with less; all in local.csv of --out")
