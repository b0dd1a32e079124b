"""What a report was made from: hashes, versions, tolerances, rules.

Conventions: SHA-256 in hexadecimal; times in UTC; a version that cannot be found is the word ``unknown``.
"""

from __future__ import annotations

import platform
from collections.abc import Sequence
from datetime import datetime
from importlib import metadata
from pathlib import Path
from typing import Any

from rig.session import Session
from validation.events.definitions import EVENTS
from validation.events.evaluation_window import Window
from validation.measurement.trial import MeasuredTrial
from validation.pipeline.fitted_before import fitted_trials
from validation.prediction.model_under_test import ModelUnderTest

SOFTWARE = ("piano-action-rig", "numpy", "scipy", "pandas", "matplotlib", "numba", "h5py")


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
    session: Session, tested: ModelUnderTest, trials: Sequence[MeasuredTrial], window: Window, now: datetime
) -> dict[str, Any]:
    """Everything a reader needs to make the same report again, as plain values."""
    info, action = session.info, tested.action
    return {
        "created_utc": now.strftime("%Y-%m-%dT%H:%M:%SZ"),
        "session": {
            "name": info.name or session.path.name,
            "operator": info.operator,
            "created_utc": info.created_utc,
            "simulated": info.simulated,
            "rig_sha256": info.rig.sha256,
            "profile": info.profile.name,
            "profile_sha256": info.profile.sha256,
        },
        "trials_sha256": {f"trial_{m.number:04d}": m.seal for m in trials},
        "action": {
            "name": action.name,
            "origin": Path(action.origin).name,
            "values_sha256": tested.action_hash,
            "changed": {k: float(v) for k, v in action.changed.items()},
            "fitted_to": [f"trial_{number:04d}" for number in fitted_trials(action, trials)],
        },
        "model": tested.version,
        "tolerance_rad": tested.tolerance,
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
        "reused": tested.store.summary(),
    }
