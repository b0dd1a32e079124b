"""``pianorig learn``: make the motor reproduce a recorded force."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pianorig.console.options import Backend, Rig, Selftests, Yes


def command(
    forces: Annotated[list[Path], typer.Argument(help="Recorded forces: CSV, LVM, TDMS, HDF5 or a sealed trial.")],
    out: Annotated[Path, typer.Option("--out", help="Folder to create; one folder per force inside it.")],
    rig: Rig = "virtual",
    backend: Backend = "sim://",
    blows: Annotated[int, typer.Option("--blows", help="Blows at most, for each force.")] = 8,
    goal: Annotated[float, typer.Option("--goal", help="RMS error before key bottom, of the peak there.")] = 0.03,
    scale: Annotated[float, typer.Option("--scale", help="Newtons the motor shall do per unit recorded.")] = 1.0,
    channel: Annotated[str, typer.Option("--channel", help="Name of the force in the file.")] = "force_n",
    time: Annotated[
        str, typer.Option("--time", help="Name of the times; unused where the file has a rate.")
    ] = "time_s",
    key_bottom: Annotated[
        float | None, typer.Option("--key-bottom", help="Time of key bottom in the recording, s; else it is found.")
    ] = None,
    separator: Annotated[str, typer.Option("--separator", help="Between the cells of CSV.")] = ",",
    decimal: Annotated[str, typer.Option("--decimal", help="Decimal sign of CSV.")] = ".",
    operator: Annotated[str, typer.Option("--operator", help="Who records.")] = "unknown",
    yes: Yes = False,
    selftest: Selftests = Path("selftests"),
    as_json: Annotated[bool, typer.Option("--json", help="Print a JSON summary.")] = False,
) -> None:
    """Learn motor profiles whose measured force follows recorded ones, by a few blows on the bench.

    Compared and corrected is up to the first key bottom; what the motor does after it, a second stroke too, is the
    recorded force without its spike, as it is.

    Example:  pianorig learn pianist_forte.csv --out learned/forte
              pianorig record --profile learned/forte/profile.toml
    """
    from pianorig.console.output import print_json
    from pianorig.console.progress import say
    from pianorig.console.prompt import type_answer
    from pianorig.errors import InputError
    from pianorig.workflows.bench.learn import learn_profile, load_target, summary
    from pianorig.workflows.bench.learning_figures import draw_recorded
    from rig.configuration.rig_file import load_rig

    if len({path.stem for path in forces}) < len(forces):
        raise InputError("two forces have the same name; their folders would be the same")
    if key_bottom is not None and len(forces) > 1:
        raise InputError("--key-bottom: allowed with one force at a time")
    if len(separator) != 1 or decimal not in (".", ",") or separator == decimal:
        raise InputError(
            f"--separator {separator!r}, --decimal {decimal!r}: allowed two different signs, decimal . or ,"
        )
    rate = load_rig(rig).config.device.sample_rate_hz
    targets = [
        load_target(
            path,
            rate,
            force_channel=channel,
            time_channel=time,
            scale=scale,
            key_bottom_s=key_bottom,
            separator=separator,
            decimal=decimal,
        )
        for path in forces
    ]
    results = []
    for target in targets:
        folder = out if len(targets) == 1 else out / target.name
        learned = learn_profile(
            target,
            folder,
            rig=rig,
            backend=backend,
            blows=blows,
            goal=goal,
            operator=operator,
            progress=lambda blow: say(f"blow {blow.number}: {100 * blow.error:.2f} % RMS of the peak", quiet=as_json),
            yes=yes,
            ask=type_answer,
            selftests=selftest,
        )
        results.append({**summary(learned), "profile": folder / "profile.toml"})
    draw_recorded(out / "recorded_forces.png", targets)
    if as_json:
        print_json({"out": out, "learned": results})
    else:
        for entry in results:
            print(
                f"{entry['target']}: {entry['rms_percent_of_peak']:.2f} % RMS of the peak before key bottom "
                f"(blow {entry['best_blow']}); profile: {entry['profile']}"
            )
    late = [entry for entry in results if not entry["follows"]]
    if late:
        raise InputError(
            f"{late[0]['target']}: {late[0]['rms_percent_of_peak']:.2f} % after {len(late[0]['rms_percent_by_blow'])} "
            f"blows, goal {100 * goal:g} %; the best profile was written; {late[0]['obstacle']}"
        )
