"""What is there: the contents of a session, the device behind an address."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path
from typing import Any

from rig import Session, load_rig, open_backend


def session_facts(path: Path) -> dict[str, Any]:
    """Name, date, profile and trials of a session; trials as a list of rows."""
    session = Session.open(path)
    rows = []
    for trial in session.trials:
        data = trial.read()
        rows.append(
            {
                "trial": trial.number,
                "status": trial.status,
                "rejected": trial.rejected or "no",
                "samples": data.n_valid,
                "peak_force_n": round(float(data.force_n.max()), 2) if data.n_valid else "unknown",
                "not_recorded": ", ".join(data.absent) or "nothing",
                "film": trial.film.name if trial.film else "none",
            }
        )
    info = session.info
    return {
        "session": session.path,
        "operator": info.operator,
        "created": info.created_utc,
        "simulated": info.simulated,
        "action": info.action.name,
        "profile": info.profile.name,
        "trials": rows,
    }


def backend_facts(backend: str, rig: str) -> dict[str, Any]:
    """What answers at a backend address: device, versions, and the settings of the rig file."""
    config = load_rig(rig).config
    with closing(open_backend(backend, config)) as bench:
        facts = bench.capabilities
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
