"""What is there: versions of the software, contents of a session."""

from __future__ import annotations

import platform
from importlib import metadata
from pathlib import Path
from typing import Any

_PACKAGES = (
    "piano-action-rig", "numpy", "scipy", "pandas", "h5py", "matplotlib", "opencv-python-headless", "nidaqmx", "numba",
)  # fmt: skip


def versions() -> dict[str, Any]:
    """Versions of Python, the platform and the packages this tool rests on."""
    out: dict[str, Any] = {"python": platform.python_version(), "platform": platform.platform()}
    for package in _PACKAGES:
        try:
            out[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            out[package] = "not installed"
    return out


def session_facts(path: Path) -> dict[str, Any]:
    """Name, date, profile and trials of a session; trials as a list of rows."""
    from rig.session import Session

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
