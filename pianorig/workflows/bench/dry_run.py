"""``record --dry-run`` and ``info --backend``: what would be reserved and played, without moving anything."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from pianorig.console.output import print_json


def rehearse(profile: str, rig: str, backend: str) -> dict[str, Any]:
    """Predict the blow, reserve every task on the bench, give all back; return what was found.

    Raises
    ------
    InputError : profile, rig file or prediction outside the limits
    HardwareFault : the device refuses a channel, route, rate or counter
    """
    from pianorig.workflows.model.predict_blow import predictor
    from rig.backend import open_backend
    from rig.configuration.motor_command import motor_command
    from rig.configuration.profile import load_profile
    from rig.configuration.rig_file import load_rig
    from rig.daq.task_plan import recording_plan
    from rig.safety.dry_run import dry_run

    rig_file, chosen = load_rig(rig), load_profile(profile)
    command = motor_command(chosen, rig_file.config)
    predicted = dry_run(chosen, rig_file.config, predictor(rig_file))
    bench = open_backend(backend, rig_file.config)
    try:
        timing = bench.configure(rig_file.config, command.volts)
        plan = recording_plan(rig_file.config, timing, command.volts.size)
        name = bench.capabilities.name
    finally:
        bench.close()
    return {
        "backend": name,
        "rig": rig_file.config.name,
        "prediction": predicted,
        "tasks": [asdict(row) for row in plan],
    }


def print_rehearsal(profile: str, rig: str, backend: str, *, as_json: bool) -> None:
    """Print what :func:`rehearse` found."""
    found = rehearse(profile, rig, backend)
    if as_json:
        print_json(found)
        return
    print(f"{found['backend']}, rig {found['rig']}: every task was reserved and given back, nothing has moved")
    for row in found["tasks"]:
        print(f"{row['task']:<16} {row['channel']:<24} {row['purpose']}")
        print(f"{'':<16}   clock   {row['clock']}")
        print(f"{'':<16}   trigger {row['trigger']}")
        for route in row["routes"]:
            print(f"{'':<16}   route   {route}")
    print("predicted:")
    for key, value in found["prediction"].items():
        print(f"  {key:<28} {value}")


def backend_facts(backend: str, rig: str) -> dict[str, Any]:
    """What answers at a backend address: device, versions, and what it was asked for by the rig file."""
    from rig.backend import open_backend
    from rig.configuration.rig_file import load_rig

    config = load_rig(rig).config
    bench = open_backend(backend, config)
    try:
        facts = bench.capabilities
    finally:
        bench.close()
    return {
        "backend": facts.name,
        "simulated": facts.simulated,
        "permission": "needed before anything moves" if facts.hardware else "not needed, nothing real moves",
        "watchdog": "yes" if facts.watchdog else "no",
        "rig": config.name,
        "device": config.device.name,
        **facts.description,
        "sample_rate_hz": config.device.sample_rate_hz,
        "force_group_delay_s": config.force.group_delay(config.device.sample_rate_hz),
        "camera": "none" if config.camera is None else config.camera.mode,
    }
