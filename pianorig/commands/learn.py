"""``pianorig learn``: make the motor reproduce a recorded force."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from contextlib import closing
from pathlib import Path
from typing import Annotated, Any

import typer

import rig
from pianorig import workflows
from pianorig.console.options import SELFTESTS, AsJson, Backend, Operator, Rig, Selftests, Yes
from pianorig.console.output import print_json
from pianorig.console.progress import say
from pianorig.console.terminal import type_answer
from pianorig.errors import CommandInputError
from rig.atomic_write import replace_when_complete, write_text

DPI = 120


def command(
    forces: Annotated[list[Path], typer.Argument(help="Recorded forces: CSV, LVM, TDMS, HDF5 or a sealed trial.")],
    out: Annotated[Path, typer.Option("--out", help="Folder to create; one folder per force inside it.")],
    rig_name: Rig = "virtual",
    backend: Backend = "sim://",
    blows: Annotated[int, typer.Option("--blows", help="Blows at most, for each force.")] = 8,  # as rig.learn
    goal: Annotated[
        float, typer.Option("--goal", help="RMS error up to key bottom to reach, as a fraction of the peak there.")
    ] = 0.03,  # as rig.learn
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
    The motor plays each force up to --blows times, every time with an improved command; profile, blows and pictures go
    into a new folder.

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
        load_target(
            path,
            rig_name,
            force_channel=channel,
            time_channel=time,
            scale=scale,
            key_bottom_s=key_bottom,
            separator=separator,
            decimal=decimal,
        )
        for path in forces
    ]
    access = workflows.BenchAccess(rig_name, backend, yes, type_answer, selftest)
    results = []
    for target in targets:
        folder = out if len(targets) == 1 else out / target.name
        learned = learn_profile(
            target,
            folder,
            access,
            blows=blows,
            goal=goal,
            operator=operator,
            progress=lambda blow: say(f"blow {blow.number}: {100 * blow.error:.2f} % RMS of the peak", quiet=as_json),
        )
        results.append({**learning_summary(learned), "profile": folder / "profile.toml"})
    draw_recorded(out / "recorded_forces.png", targets)
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


def draw_recorded(path: Path, targets: Sequence[rig.TargetForce]) -> None:
    """Write a PNG picture to ``path``: recorded forces, N, over time, s, one line a target, a dot where the key reaches
    its bottom (after Fig. 3.6)."""
    # start-up: 0.5 s of NumPy and matplotlib that --help does not need
    import numpy as np
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.5, 3.6), layout="constrained")
    axes = figure.subplots()
    for target in targets:
        (line,) = axes.plot(target.time_s, target.force_n, lw=1.0, label=target.name)
        at = float(np.interp(target.bottom_s, target.time_s, target.force_n))
        axes.plot(target.bottom_s, at, "o", ms=4, color=line.get_color())
    axes.set(xlabel="Time (s)", ylabel="Force at the key front (N)", title="Recorded force (dot: key bottom)")
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8)
    with replace_when_complete(path) as part:
        figure.savefig(part, format="png", dpi=DPI)


def draw_learned(folder: Path, learned: rig.Learned) -> None:
    """Write ``pianist_and_motor.png`` into ``folder``: target, measured force and command of the best blow (after Figs
    3.7, 3.8), and below the error of each blow."""
    from matplotlib.figure import Figure  # start-up: 0.4 s that --help does not need

    from rig.learning.target_force import FADE_S  # start-up: scipy.signal, as above

    target, best = learned.target, learned.best
    figure = Figure(figsize=(7.5, 6.6), layout="constrained")
    top, zoom, steps = figure.subplots(3, 1, height_ratios=(3, 3, 2))
    command = best.profile.force_at(target.time_s)
    for axes in (top, zoom):
        axes.plot(target.time_s, target.force_n, color="0.25", lw=1.6, label="pianist")
        axes.plot(target.time_s, best.measured.force_n, color="C3", lw=1.0, label="motor, measured")
        axes.plot(target.time_s, command, color="C0", lw=0.9, ls="--", label="motor command")
        axes.axvline(target.bottom_s, color="0.6", lw=0.8, ls=":")
        axes.set(xlabel="Time (s)", ylabel="Force (N)")
        axes.grid(alpha=0.3)
    top.legend(fontsize=8)
    top.set_title(f"{target.name}: pianist and motor (blow {best.number}, {100 * best.error:.1f} % of the peak)")
    zoom.set_xlim(target.onset_s - FADE_S, target.bottom_s + FADE_S)
    zoom.set_ylim(-0.25 * target.peak_n, 1.5 * target.peak_n)
    zoom.set_title("before key bottom (dotted), where it is learned", fontsize=9)
    _draw_errors(steps, learned)
    with replace_when_complete(folder / "pianist_and_motor.png") as part:
        figure.savefig(part, format="png", dpi=DPI)


def _draw_errors(axes: Any, learned: rig.Learned) -> None:
    """Draw into matplotlib ``axes`` the RMS error of each blow, percent of the target's peak, over its number, and the
    goal as a line."""
    numbers = [blow.number for blow in learned.blows]
    axes.plot(numbers, [100 * blow.error for blow in learned.blows], "o-", ms=4)
    axes.axhline(100 * learned.goal, color="C2", lw=1.0, label=f"goal, {100 * learned.goal:g} %")
    axes.set(xlabel="Blow", ylabel="RMS error (% of peak)", xticks=numbers)
    axes.set_ylim(bottom=0)
    axes.legend(fontsize=8)
    axes.grid(alpha=0.3)


def load_target(
    source: Path,
    rig_name: str | Path,
    *,
    force_channel: str = "force_n",
    time_channel: str | None = "time_s",
    scale: float = 1.0,
    key_bottom_s: float | None = None,
    separator: str = ",",
    decimal: str = ".",
) -> rig.TargetForce:
    """Read a recorded force (CSV, LVM, TDMS, HDF5, sealed trial) times ``scale``, N per unit, as a target of learning
    at the sample rate of a rig; ``key_bottom_s``: when the key reaches bottom, None: found in the force.

    A file that states its own sample interval needs no time channel; one that states another unit than N needs a
    scale.
    """
    # start-up: 0.4 s of NumPy and h5py
    from rig.foreign.channel_table import known_unit
    from rig.foreign.sample_times import SECONDS

    table = rig.read_channels(source, separator=separator, decimal=decimal)
    unit = known_unit(table.units.get(force_channel, ""))
    if unit not in (None, "N") and scale == 1.0:
        raise CommandInputError(
            f"{source}: {force_channel} is in {unit!r} by the file itself; give --scale, newtons per {unit}"
        )
    if time_channel not in table.channels and force_channel in table.clocks:
        time_channel = None
    time_unit = known_unit(table.units.get(time_channel or "", "")) or "s"
    if time_unit not in SECONDS:
        raise CommandInputError(
            f"{source}: {time_channel} is in {time_unit!r} by the file itself, allowed {', '.join(SECONDS)}"
        )
    interval_s = table.interval([force_channel], time_channel, "--time CHANNEL", unit=time_unit)
    rate_hz = rig.load_rig(rig_name).config.device.sample_rate_hz
    return rig.make_target(
        source.stem, table.channel(force_channel), interval_s, rate_hz, scale=scale, key_bottom_s=key_bottom_s
    )


def learn_profile(
    target: rig.TargetForce,
    out: Path,
    access: workflows.BenchAccess,
    *,
    blows: int,
    goal: float,
    operator: str = "unknown",
    progress: Callable[[rig.Blow], None] | None = None,
) -> rig.Learned:
    """Play up to ``blows`` blows, each with an improved command, until the force follows the target within ``goal``
    (share of the peak); write blows, profile and picture into the new folder ``out``. Return what was learned."""
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise CommandInputError(f"{out}: exists already and is not an empty folder; choose another --out")
    rig_file = rig.load_rig(access.rig)
    predict = workflows.predictor(rig_file)
    with closing(rig.open_backend(access.backend, rig_file.config)) as bench:
        permission = access.permission(rig_file, bench)

        def blow(profile: rig.Profile, number: int) -> rig.TrialData:
            folder = out / f"blow_{number:02d}"
            with workflows.report_interrupt(folder):
                session = rig.record(
                    folder,
                    profile=profile,
                    rig_config=rig_file,
                    backend=bench,
                    trials=1,
                    operator=operator,
                    notes={"learning": f"blow {number} towards {target.name}"},
                    predict=predict,
                    permission=permission,
                )
            return session.trials[0].read()

        learned = rig.learn(target, rig_file.config, blow, blows=blows, goal=goal, progress=progress)
    _write_results(out, learned)
    draw_learned(out, learned)
    return learned


def learning_summary(learned: rig.Learned) -> dict[str, Any]:
    """Facts of a learned profile by name, as ``--json`` prints them: errors in percent of the target's peak, times in
    s, forces in N, whether it follows, else the obstacle."""
    best = learned.best
    return {
        "target": learned.target.name,
        "target_peak_n": round(learned.target.peak_n, 4),
        "rest_subtracted_n": round(learned.target.rest_n, 4),
        "target_key_bottom_s": round(learned.target.bottom_s, 5),
        "best_blow": best.number,
        "rms_percent_of_peak": round(100 * best.error, 3),
        "goal_percent": 100 * learned.goal,
        "follows": learned.follows,
        "obstacle": "" if learned.follows else learned.obstacle(),
        "measured_key_bottom_s": None if best.measured.bottom_s is None else round(best.measured.bottom_s, 5),
        "rms_percent_by_blow": [round(100 * blow.error, 3) for blow in learned.blows],
    }


def _write_results(out: Path, learned: rig.Learned) -> None:
    """Write ``profile.toml`` (profile of the best blow) and ``learning.json`` (`learning_summary`) into the folder
    ``out``, replacing what is there."""
    best = learned.best
    found = f"{100 * best.error:.2f} % RMS of the peak before key bottom in blow {best.number}"
    text = best.profile.text.replace(
        f"blow {best.number} of learning {learned.target.name}", f"learned from {learned.target.name}: {found}", 1
    )
    write_text(out / "profile.toml", text)
    write_text(out / "learning.json", json.dumps(learning_summary(learned), indent=1) + "\n")
