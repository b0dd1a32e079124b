"""Learning a profile on a bench: every blow is a session of one trial on the normal record path.

The folder gets ``profile.toml`` (for ``record --profile``), ``learning.json``, figures after thesis Figs 3.6 (recorded
forces) and 3.7, 3.8 (pianist and motor), and the sessions ``blow_01`` … with everything that was recorded on the way.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from pianorig.errors import CommandInputError
from pianorig.workflows.predict_blow import predictor
from pianorig.workflows.recording import BenchAccess, interrupts_told
from rig import (
    Blow,
    Learned,
    Profile,
    TargetForce,
    TrialData,
    learn,
    load_rig,
    make_target,
    open_backend,
    read_channels,
)
from rig import record as record_session
from rig.atomic_write import replace_when_complete, write_text
from rig.foreign.channel_table import known
from rig.foreign.sample_times import SECONDS

DPI = 120


def draw_recorded(path: Path, targets: Sequence[TargetForce]) -> None:
    """Draw the recorded forces over time, one line each, key bottoms marked (after Fig. 3.6)."""
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


def draw_learned(folder: Path, learned: Learned) -> None:
    """Draw pianist and motor (after Figs 3.7, 3.8) and the error of each blow into ``folder``."""
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
    zoom.set_xlim(target.onset_s - 0.01, target.bottom_s + 0.01)
    high = 1.15 * target.peak_n
    zoom.set_ylim(-0.1 * high, high)
    zoom.set_title("before key bottom (dotted), where it is learned", fontsize=9)
    _draw_errors(steps, learned)
    with replace_when_complete(folder / "pianist_and_motor.png") as part:
        figure.savefig(part, format="png", dpi=DPI)


def _draw_errors(axes: Any, learned: Learned) -> None:
    numbers = [blow.number for blow in learned.blows]
    axes.plot(numbers, [100 * blow.error for blow in learned.blows], "o-", ms=4)
    axes.axhline(100 * learned.goal, color="C2", lw=1.0, label=f"goal, {100 * learned.goal:g} %")
    axes.set(xlabel="Blow", ylabel="RMS error (% of peak)", xticks=numbers)
    axes.set_ylim(bottom=0)
    axes.legend(fontsize=8)
    axes.grid(alpha=0.3)


def load_target(
    source: Path,
    rig: str | Path,
    *,
    force_channel: str = "force_n",
    time_channel: str | None = "time_s",
    scale: float = 1.0,
    key_bottom_s: float | None = None,
    separator: str = ",",
    decimal: str = ".",
) -> TargetForce:
    """A recorded force as a target of learning on a rig; CSV, LVM, TDMS, HDF5 or a sealed trial.

    A file that states its own sample interval needs no time channel; one that states another unit than N needs a
    scale.
    """
    table = read_channels(source, separator=separator, decimal=decimal)
    unit = known(table.units.get(force_channel, ""))
    if unit not in (None, "N") and scale == 1.0:
        raise CommandInputError(
            f"{source}: {force_channel} is in {unit!r} by the file itself; give --scale, newtons per {unit}"
        )
    if time_channel not in table.channels and force_channel in table.clocks:
        time_channel = None
    time_unit = known(table.units.get(time_channel or "", "")) or "s"
    if time_unit not in SECONDS:
        raise CommandInputError(
            f"{source}: {time_channel} is in {time_unit!r} by the file itself, allowed {', '.join(SECONDS)}"
        )
    interval_s = table.interval([force_channel], time_channel, "--time CHANNEL", unit=time_unit)
    table.check_rate([force_channel], interval_s, [time_channel] if time_channel else [])
    rate_hz = load_rig(rig).config.device.sample_rate_hz
    return make_target(
        source.stem, table.channel(force_channel), interval_s, rate_hz, scale=scale, key_bottom_s=key_bottom_s
    )


def learn_profile(
    target: TargetForce,
    out: Path,
    access: BenchAccess,
    *,
    blows: int = 8,
    goal: float = 0.03,
    operator: str = "unknown",
    progress: Callable[[Blow], None] | None = None,
) -> Learned:
    """Learn one profile and write the folder ``out``.

    Raises
    ------
    CommandInputError : the folder exists
    rig.errors.RigError : the target, a command or the dry run leaves the limits, or the bench stopped a blow; what was
        recorded is kept
    """
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise CommandInputError(f"{out}: exists already and is not an empty folder; choose another --out")
    rig_file = load_rig(access.rig)
    predict = predictor(rig_file)
    with closing(open_backend(access.backend, rig_file.config)) as bench:
        permission = access.permission(rig_file, bench)

        def blow(profile: Profile, number: int) -> TrialData:
            folder = out / f"blow_{number:02d}"
            with interrupts_told(folder):
                session = record_session(
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

        learned = learn(target, rig_file.config, blow, blows=blows, goal=goal, progress=progress)
    _write(out, learned)
    draw_learned(out, learned)
    return learned


def learning_summary(learned: Learned) -> dict[str, Any]:
    """What was reached, as plain values."""
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


def _write(out: Path, learned: Learned) -> None:
    best = learned.best
    found = f"{100 * best.error:.2f} % RMS of the peak before key bottom in blow {best.number}"
    text = best.profile.text.replace(
        f"blow {best.number} of learning {learned.target.name}", f"learned from {learned.target.name}: {found}", 1
    )
    write_text(out / "profile.toml", text)
    write_text(out / "learning.json", json.dumps(learning_summary(learned), indent=1) + "\n")
