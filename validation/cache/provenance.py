"""What a report was made from: hashes, versions, tolerances, rules.

Place in the data flow: collected by `validation.pipeline.compare_session`, printed at the end of the report and in
`results.json`.
Conventions: SHA-256 in hexadecimal; times in UTC.
Failure: an unknown version is the word ``unknown``.
"""

from __future__ import annotations

import platform
from collections.abc import Callable
from importlib import metadata
from pathlib import Path
from typing import Any

from validation.cache.report_cache import code_sha256
from validation.events.definitions import EVENTS
from validation.events.evaluation_window import Window

SOFTWARE = ("piano-action-rig", "numpy", "scipy", "pandas", "matplotlib", "numba", "h5py")


def model_version(predict: Callable[..., Any]) -> str:
    """Hash of the predictor's source and libraries, so that a changed model never meets an old prediction."""
    if predict.__module__.split(".")[0] == "model":
        return f"model {code_sha256('model')}"
    return f"{predict.__module__}.{getattr(predict, '__qualname__', type(predict).__name__)}"


def versions() -> dict[str, str]:
    """Versions of the interpreter and of the packages that shape the numbers."""
    found = {"python": platform.python_version(), "platform": platform.platform()}
    for name in SOFTWARE:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = "unknown"
    return found


def provenance(
    session: Any,
    action: Any,
    action_hash: str,
    version: str,
    tolerance: float,
    window: Window,
    seals: dict[int, str],
    created_utc: str,
) -> dict[str, Any]:
    """Everything a reader needs to make the same report again, as plain values."""
    info = session.info
    changed = dict(getattr(action, "changed", {}) or {})
    return {
        "created_utc": created_utc,
        "session": {
            "name": getattr(info, "name", "") or session.path.name,
            "operator": getattr(info, "operator", "unknown"),
            "created_utc": getattr(info, "created_utc", ""),
            "simulated": bool(getattr(info, "simulated", False)),
            "rig_sha256": getattr(getattr(info, "rig", None), "sha256", ""),
            "profile": getattr(getattr(info, "profile", None), "name", ""),
            "profile_sha256": getattr(getattr(info, "profile", None), "sha256", ""),
        },
        "trials_sha256": {f"trial_{number:04d}": seal for number, seal in seals.items()},
        "action": {
            "name": getattr(action, "name", "unknown"),
            "origin": Path(str(getattr(action, "origin", ""))).name,
            "values_sha256": action_hash,
            "changed": {k: float(v) for k, v in changed.items()},
        },
        "model": version,
        "tolerance_rad": tolerance,
        "window": {
            "start_s": window.start_s,
            "end_s": window.end_s,
            "start_rule": window.start_rule,
            "end_rule": window.end_rule,
        },
        "force": "offset and mains hum fitted on the quiet baseline and subtracted, declared preload added; channel "
        "delay taken off the time axis; never smoothed",
        "alignment": "none: model and trial share the DAQ clock",
        "event_definitions": {name: kind.definition for name, kind in EVENTS.items()},
        "versions": versions(),
    }
