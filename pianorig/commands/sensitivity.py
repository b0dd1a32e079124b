"""``pianorig sensitivity``: which parameters of an action decide about a blow.

Local table, Morris's screening and Sobol' indices, as tables and figures.
"""

from __future__ import annotations

from contextlib import nullcontext
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

import model
from pianorig import workflows
from pianorig.console import options
from pianorig.console.column_file import make_folder, write_rows
from pianorig.console.options import DEFAULT_ACTION, AsJson, Scale, Scene, Settings
from pianorig.console.output import file_lines, tell
from pianorig.console.overrides import in_scene, load_changed, read_settings
from pianorig.console.progress import bar, say, working
from pianorig.errors import CommandInputError

MOST_LINES = 20
HEADINGS = {
    "let_off_m": "let-off", "strike_m_per_s": "speed", "check_m": "check", "drop_s": "drop time",
    "key curve": "key curve", "hammer curve": "hammer c.",
}  # fmt: skip
SHOWN = ("let_off_m", "strike_m_per_s", "check_m", "drop_s")  # what is printed; files hold all
SCREENED = 10  # parameters that --morris and --sobol vary where none are named
DIRECTION = (".normal.x", ".normal.y")
TITLES = {
    "morris": "Morris: mean size of the effect of one standard uncertainty (sigma: curved or mixed with others)",
    "sobol": "Sobol': share of the variance, alone and in all, with 95 % intervals",
}
WORDS = {
    "morris": "{mu_star:.3g} ({mu_star_low:.3g} to {mu_star_high:.3g}), sigma {sigma:.2g}",
    "sobol": "{first:.3f} ({first_low:.3f} to {first_high:.3f}), in all {total:.3f} ({total_low:.3f} to "
    "{total_high:.3f})",
}


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
            "all that do something in this blow; with --morris or --sobol the ten that do most.",
        ),
    ] = None,
    trial: Annotated[
        int | None, typer.Option("--trial", help="Trial of a session; default the first that is not rejected.")
    ] = None,
    morris: Annotated[
        int | None, typer.Option("--morris", help="Ways of Morris's screening; each takes P + 1 blows. Usual: 20.")
    ] = None,
    sobol: Annotated[
        int | None,
        typer.Option("--sobol", help="Base members of Sobol' indices, a power of 2; n (P + 2) blows. Usual: 1024."),
    ] = None,
    u: Annotated[
        list[str] | None,
        typer.Option("--u", help="Standard uncertainty instead of the declared one, name=value; may be repeated."),
    ] = None,
    set_: Settings = None,
    scale: Scale = None,
    scene: Scene = None,
    seed: Annotated[int, typer.Option("--seed", help="Of the variants that are drawn.")] = 0,
    workers: Annotated[int | None, typer.Option("--workers", help="Threads; default one per processor.")] = None,
    cluster: Annotated[
        str | None, typer.Option("--cluster", help="Dask scheduler to compute on, tcp://host:8786.")
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", help="Folder for tables, figures and finished members, from which a study goes on."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Rank parameters by what they do to a blow.

    Locally, by Morris's screening, by Sobol' indices.

    Example:  pianorig sensitivity force.csv --parameters friction,hammer.mass,contact02 --out sensitivity
    """
    if morris is None and sobol is None:
        for name, given in (("--u", u), ("--cluster", cluster), ("--workers", workers)):
            if given is not None:
                raise CommandInputError(f"{name}: goes with --morris or --sobol; the local table varies nothing")
    names = None if parameters is None else [name.strip() for name in parameters.split(",") if name.strip()]
    chosen = in_scene(load_changed(action, set_, scale, scene), scene)
    uncertainties = read_settings(u or [], "--u")
    make_folder(out)
    # start-up: NumPy, SciPy and numba, which --help does not need
    from model.screening.members import Study
    from model.screening.morris import check_ways
    from model.screening.sobol import check_base

    if morris is not None:
        check_ways(morris)
    if sobol is not None:
        check_base(sobol)
    if workers is not None and workers < 1:
        raise CommandInputError(f"--workers {workers}: allowed 1 or more")
    if names is not None and (morris is not None or sobol is not None):
        model.screening.spreads(chosen, names, uncertainties)  # refuses, before anything is computed, what cannot vary
    source = _trial_of(blow, trial)
    driving = workflows.read_driving_force(source, model.choice_of(chosen).input_column)
    with nullcontext() if cluster is None else workflows.cluster_executor(cluster) as executor:  # may not be there
        local = _local(chosen, driving, names, as_json)
        facts: dict[str, Any] = {"action": chosen.name, "blow": source, "local": local.rows()}
        if not as_json:
            _print_local(local, chosen.name)
        files = _written(out, "local", local.rows(), partial(model.screening.draw_local, local, name=chosen.name))
        varied: list[model.screening.Spread] = []
        if morris is not None or sobol is not None:
            given = names or list(dict.fromkeys([*local.strongest(SCREENED), *uncertainties]))
            varied = model.screening.spreads(chosen, given, uncertainties)
        parameters_varied = tuple(spread.parameter for spread in varied)
        variants = model.screening.Variants(
            chosen, driving.time_s, driving.force_n, parameters_varied, driving.preload_n
        )
        told = None if as_json else lambda left: say(left.line() + "; after Ctrl-C the same command goes on")
        for name, label, size in (("morris", "screening", morris), ("sobol", "Sobol' members", sobol)):
            if size is None:
                continue
            study, draw = getattr(model.screening, name), getattr(model.screening, f"draw_{name}")
            with bar(label, as_json, "blows") as progress:
                members = Study(executor, workers, progress, None if out is None else out / "members", told)
                found = study(varied, partial(members.run, variants), model.screening.MARKS, size, seed)
            facts[name] = found.rows()
            files += _written(out, name, found.rows(), partial(draw, found))
            if not as_json:
                _print_study(found, name)
    tell(as_json, facts | {"files": files}, file_lines(files))


def _trial_of(blow: Path, trial: int | None) -> Path:
    """File of the force: of a session the trial wanted, by default its first that is not rejected."""
    if not blow.is_dir():
        if trial is not None:
            raise CommandInputError(f"--trial {trial}: goes with a session; {blow} is no folder")
        return blow
    from rig.session.folder import Session  # start-up: h5py and pandas cost 0.4 s that a table does not need

    session = Session.open(blow)
    if trial is not None:
        return session.trial(trial).path
    usable = [one for one in session.trials if one.rejected is None]
    if not usable:
        raise CommandInputError(f"{blow}: all its trials are rejected; name one with --trial")
    return usable[0].path


def _local(
    action: model.Action, driving: workflows.DrivingForce, names: list[str] | None, quiet: bool
) -> model.screening.LocalTable:
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
    return model.screening.local_table(found)


def _written(out: Path | None, name: str, rows: list[dict[str, Any]], draw: Any) -> list[Path]:
    if out is None:
        return []
    files = [out / f"{name}.csv", out / f"{name}.svg"]
    write_rows(files[0], rows)
    draw(files[1])
    return files


def _print_local(table: model.screening.LocalTable, name: str) -> None:
    from model.screening.local import lines  # start-up: NumPy, which --help does not need

    print(f"{name}: percent of a quantity per percent of a parameter")
    for line in lines(table, HEADINGS, MOST_LINES):
        print(line)
    if len(table.parameters) > MOST_LINES:
        print(f"and {len(table.parameters) - MOST_LINES} more, each with less; all in local.csv of --out")


def _print_study(found: Any, kind: str) -> None:
    """The five strongest parameters of each quantity, a line each."""
    print(f"\n{TITLES[kind]}")
    for q, name in enumerate(found.quantities):
        if name in SHOWN:
            lost = f" (missing in {100.0 * found.absent[q]:.1f} % of the members)" if found.absent[q] else ""
            ranked = found.ranked(q)
            print(f"{name}{lost}" if ranked else f"{name}: nothing to say{lost}")
            for j in ranked[:5]:
                print(f"  {found.parameters[j]:<32} {WORDS[kind].format(**found.numbers(q, j))}")
