"""What is there: the contents of a session, the device behind an address."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path
from typing import Any

from pianorig.errors import CommandInputError
from rig import Session, load_rig, open_backend, parse_rig
from rig.atomic_write import write_text
from rig.daq.address import discover
from rig.daq.discovery import FoundDevice, propose_rig
from rig.daq.nidaqmx_backend import NidaqmxBackend


def session_facts(path: Path) -> dict[str, Any]:
    """Name, date, profile and trials of a session; trials as a list of rows, an unreadable one with its problem."""
    session = Session.open(path)
    rows = []
    for trial in session.trials:
        if problem := trial.problem:
            rows.append({"trial": trial.number, "status": trial.status, "problem": problem})
            continue
        data = trial.read()
        rows.append(
            {
                "trial": trial.number,
                "status": trial.status,
                "rejected": trial.rejected or "no",
                "samples": data.n_valid,
                "peak_force_n": round(float(data.force_n.max()), 2)
                if data.n_valid and data.has_force
                else "not recorded",
                "not_recorded": ", ".join(data.absent if data.has_force else ("force", *data.absent)) or "nothing",
                "positions": ", ".join(data.position_names) or "none",
                "film": trial.film.name if trial.film else "none",
            }
        )
    info = session.info
    there = {trial.number for trial in session.trials} | set(session.journals)
    absent = sorted(set(range(1, max(there, default=0))) - there)
    return {
        "session": session.path,
        "operator": info.operator,
        "created": info.created_utc,
        "simulated": info.simulated,
        "action": info.action.name,
        "profile": info.profile.name,
        "trials": rows,
        **({"absent_trials": ", ".join(map(str, absent))} if absent else {}),
    }


def backend_facts(backend: str, rig: str | None) -> dict[str, Any]:
    """What answers at a backend address: devices with serial numbers, versions, and what a rig file makes of them.

    Without a rig file only the devices are listed; ``sim://`` has those of the built-in one.
    """
    if rig is None and not backend.startswith("sim:"):
        driver, devices = discover(backend)
        return {"backend": backend, "driver": f"NI-DAQmx {driver}", "devices": _rows(devices)}
    config = load_rig(rig or "virtual").config
    with closing(open_backend(backend, config)) as bench:
        facts = bench.capabilities
        devices = bench.devices() if isinstance(bench, NidaqmxBackend) else []
    return {
        "backend": facts.name,
        "simulated": facts.simulated,
        "permission": "needed before anything moves" if facts.hardware else "not needed, nothing real moves",
        "watchdog": "yes" if facts.watchdog else "no",
        "rig": config.name,
        "device": config.device.name,
        **{key: value for key, value in facts.description.items() if not key.startswith("slot_")},
        "devices": _rows(devices),
        "sample_rate_hz": config.device.sample_rate_hz,
        "force_group_delay_s": config.force.group_delay(config.device.sample_rate_hz),
        "camera": "none" if config.camera is None else config.camera.mode,
    }


def _rows(devices: list[FoundDevice]) -> list[dict[str, Any]]:
    return [
        {"device": one.name, "product": one.product, "serial_number": one.serial, "slot": one.slot or "-"}
        for device in devices
        for one in device
    ]


def write_proposal(backend: str, path: Path, rig: str | None = None) -> dict[str, Any]:
    """Write a rig file for the devices behind an address; the file is checked before it is written.

    Raises
    ------
    CommandInputError : the file exists
    rig.RigInputError : no device for which a file can be proposed
    """
    if path.exists():
        raise CommandInputError(f"{path}: exists already; choose another name")
    if backend.startswith("sim:"):
        with closing(open_backend(backend, load_rig(rig or "virtual").config)) as bench:
            devices = bench.devices() if isinstance(bench, NidaqmxBackend) else []
    else:
        _, devices = discover(backend)
    text = propose_rig(devices)
    config = parse_rig(text, str(path)).config
    write_text(path, text)
    return {"rig": path, "device": config.device.name, "product": config.device.product}
