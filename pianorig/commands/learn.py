"""``pianorig learn``: make the motor reproduce a recorded force."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pianorig import workflows
from pianorig.console.options import SELFTESTS, AsJson, Backend, Operator, Rig, Selftests, Yes
from pianorig.console.output import print_json
from pianorig.console.progress import say
from pianorig.console.terminal import type_answer
from pianorig.errors import CommandInputError


def command(
    forces: Annotated[list[Path], typer.Argument(help="Recorded forces: CSV, LVM, TDMS, HDF5 or a sealed trial.")],
    out: Annotated[Path, typer.Option("--out", help="Folder to create; one folder per force inside it.")],
    rig: Rig = "virtual",
    backend: Backend = "sim://",
    blows: Annotated[int, typer.Option("--blows", help="Blows at most, for each force.")] = 8,
    goal: Annotated[
        float, typer.Option("--goal", help="RMS error up to key bottom to reach, as a fraction of the peak there.")
    ] = 0.03,
    scale: Annotated[float, typer.Option("--scale", help="Newtons at the motor per unit in the file.")] = 1.0,
    channel: Annotated[str, typer.Option("--channel", help="Name of the force in the file.")] = "force_n",
    time: Annotated[
        str, typer.Option("--time", help="Name of the times; unused where the file has a rate.")
    ] = "time_s",
    key_bottom: Annotated[
        float | None, typer.Option("--key-bottom", help="Time of key bottom in the recording, s; else it is found.")
    ] = None,
    separator: Annotated[str, typer.Option("--separator", help="Between the cells of CSV.")] = ",",
    decimal: Annotated[str, typer.Option("--decimal", help="Decimal sign of CSV.")] = ".",
    operator: Operator = "unknown",
    yes: Yes = False,
    selftest: Selftests = SELFTESTS,
    as_json: AsJson = False,
) -> None:
    """Learn motor profiles whose force follows recorded ones.

    Force is compared and corrected up to the first key bottom. After that the motor plays the recorded force as it
    is, a second stroke included, without the spike at key bottom.

    Example:  pianorig learn recorded_force.csv --out learned/forte
              pianorig record --profile learned/forte/profile.toml
    """
    if len({path.stem for path in forces}) < len(forces):
        raise CommandInputError("two forces have the same name; their folders would be the same")
    if key_bottom is not None and len(forces) > 1:
        raise CommandInputError("--key-bottom: allowed with one force at a time")
    if len(separator) != 1 or decimal not in (".", ",") or separator == decimal:
        raise CommandInputError(
            f"--separator {separator!r}, --decimal {decimal!r}: allowed two different signs, decimal . or ,"
        )
    targets = [
        workflows.load_target(
            path,
            rig,
            force_channel=channel,
            time_channel=time,
            scale=scale,
            key_bottom_s=key_bottom,
            separator=separator,
            decimal=decimal,
        )
        for path in forces
    ]
    access = workflows.BenchAccess(rig, backend, yes, type_answer, selftest)
    results = []
    for target in targets:
        folder = out if len(targets) == 1 else out / target.name
        learned = workflows.learn_profile(
            target,
            folder,
            access,
            blows=blows,
            goal=goal,
            operator=operator,
            progress=lambda blow: say(f"blow {blow.number}: {100 * blow.error:.2f} % RMS of the peak", quiet=as_json),
        )
        results.append({**workflows.learning_summary(learned), "profile": folder / "profile.toml"})
    workflows.draw_recorded(out / "recorded_forces.png", targets)
    facts = {"out": out, "learned": results}
    missed = [entry for entry in results if not entry["follows"]]
    if as_json and not missed:
        print_json(facts)
    elif not as_json:
        for entry in results:
            print(
                f"{entry['target']}: {entry['rms_percent_of_peak']:.2f} % RMS of the peak before key bottom "
                f"(blow {entry['best_blow']}); profile: {entry['profile']}"
            )
    if missed:
        raise CommandInputError(
            f"{missed[0]['target']}: {missed[0]['rms_percent_of_peak']:.2f} % after "
            f"{len(missed[0]['rms_percent_by_blow'])} blows, goal {100 * goal:g} %; the best profile was written; "
            f"{missed[0]['obstacle']}",
            facts,
        )
