"""``pianorig dataset``: make the published data set, score predictions on its open split."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from pianorig.console.options import AsJson, complete_scene
from pianorig.console.output import tell
from pianorig.console.progress import say
from pianorig.errors import CommandInputError


class Job(StrEnum):
    """What is done."""

    make = "make"
    score = "score"


def command(
    job: Annotated[Job, typer.Argument(help="make: write the data set; score: score predictions on its open split.")],
    predictions: Annotated[
        Path | None, typer.Argument(help="Of score: CSV with trial, time, key_angle, whippen_angle, hammer_angle.")
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", help="Of make: folder to create.")] = None,
    data: Annotated[Path, typer.Option("--data", help="Of score: folder of the data set.")] = Path("dataset"),
    seed: Annotated[int, typer.Option("--seed", min=0, help="Of make: seed of the open split.")] = 20041,
    each: Annotated[
        int, typer.Option("--each", help="Of make: trials of each kind of stroke and specimen, the last one to test.")
    ] = 3,
    sealed_truth: Annotated[
        Path | None,
        typer.Option("--sealed-truth", help="Of make: add a sealed split from fresh randomness, its truth kept here."),
    ] = None,
    films: Annotated[bool, typer.Option("--films/--no-films", help="Of make: film a stroke of each level.")] = True,
    scene: Annotated[
        str,
        typer.Option(
            "--scene",
            help="Of make: what takes part in the specimens, a built-in scene or a TOML file.",
            autocompletion=complete_scene,
        ),
    ] = "whole",
    as_json: AsJson = False,
) -> None:
    """Make the published data set, or score predictions on it.

    Example:  pianorig dataset make --out dataset --each 2
    Example:  pianorig dataset make --out both --each 2 --sealed-truth truth/sealed.json
    """
    if job is Job.make:
        _make(out, sealed_truth, as_json, seed=seed, each=each, films=films, scene=scene)
    else:
        _score(predictions, data, as_json)


def _make(
    out: Path | None, sealed_truth: Path | None, as_json: bool, *, seed: int, each: int, films: bool, scene: str
) -> None:
    from pianorig.workflows.dataset.make import make_dataset  # start-up: the virtual bench, which scoring needs not

    if out is None:
        raise CommandInputError("dataset make: --out is missing, the folder to create")
    trials = make_dataset(
        out, seed=seed, each=each, sealed_truth=sealed_truth, films=films, scene=scene,
        say=(lambda text: None) if as_json else say,
    )  # fmt: skip
    lines = [f"data set: {out} ({', '.join(f'{name} {n} trials' for name, n in trials.items())})"]
    if sealed_truth is not None:
        lines.append(f"truth of the sealed split: {sealed_truth}; keep it, it is nowhere else")
    facts = {"dataset": out, "trials": trials, "sealed_truth": sealed_truth}
    tell(as_json, facts, lines)


def _score(predictions: Path | None, data: Path, as_json: bool) -> None:
    from validation.dataset.score import score  # start-up: h5py and pandas, which making needs not at once

    if predictions is None:
        raise CommandInputError("dataset score: the table of predictions is missing")
    found = score(data, predictions)
    lines = [f"{name}: {value:.2f} % of its range" for name, value in found.by_channel.items()]
    tested = f"{len(found.by_trial)} test trials without a planted fault"
    facts = {"overall_percent": found.overall, "by_channel": found.by_channel, "by_trial": found.by_trial}
    tell(as_json, facts, [*lines, f"score: {found.overall:.2f} % (less is better; {tested})"])
