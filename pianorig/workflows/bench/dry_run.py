"""``record --dry-run``: what would be reserved and played, without moving anything."""

from __future__ import annotations

from contextlib import closing
from dataclasses import asdict
from typing import Any

from pianorig.workflows.model.predict_blow import predictor
from rig import dry_run, load_profile, load_rig, motor_command, open_backend
from rig.daq.task_plan import recording_plan


def rehearse(profile: str, rig: str, backend: str) -> dict[str, Any]:
    """Predict the blow, reserve every task on the bench, release them again; return what was found.

    Raises
    ------
    rig.errors.InputError : profile, rig file or prediction outside the limits
    rig.errors.HardwareFault : the device refuses a channel, route, rate or counter
    """
    rig_file, chosen = load_rig(rig), load_profile(profile)
    command = motor_command(chosen, rig_file.config)
    predicted = dry_run(chosen, rig_file.config, predictor(rig_file))
    with closing(open_backend(backend, rig_file.config)) as bench:
        timing = bench.configure(rig_file.config, command.volts)
        tasks = recording_plan(rig_file.config, timing, command.volts.size)
        name = bench.capabilities.name
    return {
        "backend": name,
        "rig": rig_file.config.name,
        "prediction": predicted,
        "tasks": [asdict(row) for row in tasks],
    }


def rehearsal_lines(found: dict[str, Any]) -> list[str]:
    """What `rehearse` found, as lines of text."""
    lines = [f"{found['backend']}, rig {found['rig']}: every task was reserved and released, nothing has moved"]
    for row in found["tasks"]:
        lines.append(f"{row['task']:<16} {row['channel']:<24} {row['purpose']}")
        details = [("clock", row["clock"]), ("trigger", row["trigger"]), *(("route", route) for route in row["routes"])]
        lines += [f"{'':<16}   {label:<7} {text}" for label, text in details]
    return [*lines, "predicted:", *(f"  {key:<28} {value}" for key, value in found["prediction"].items())]
