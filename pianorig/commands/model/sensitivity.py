"""``pianorig sensitivity``: which parameters of an action decide about a blow."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pianorig import workflows
from pianorig.console import options
from pianorig.console.column_file import make_folder
from pianorig.console.options import DEFAULT_ACTION, AsJson, Scale, Settings
from pianorig.console.output import print_json
from pianorig.console.overrides import load_changed, read_settings
from pianorig.errors import CommandInputError


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
    chosen = load_changed(action, set_, scale)
    uncertainties = read_settings(u or [], "--u")
    if out is not None:
        make_folder(out)
    order = workflows.SensitivityOrder(
        names, morris=morris, sobol=sobol, uncertainties=uncertainties, seed=seed, workers=workers, cluster=cluster
    )
    facts = workflows.study_sensitivity(chosen, blow, trial, order, out, quiet=as_json)
    if as_json:
        print_json(facts)
