"""Where measured meets predicted: signals, events, repeatability, scores, report.

Place in the data flow: sessions of `rig` and predictions of `model` → `ValidationResult`, several of them `SideBySide`
→ ``report.html``, ``results.json``. Names are imported when first used, so that importing `validation` costs nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from validation.errors import InputError, PredictionError, TrialError, ValidationError
    from validation.events.definitions import EVENTS, Event
    from validation.events.detect import find_events
    from validation.measurement.force_correction import correct_force, find_quiet
    from validation.pipeline.compare_session import compare_session
    from validation.pipeline.compare_sessions import SideBySide, compare_sessions
    from validation.report import validate_session, validate_sessions, write_report
    from validation.result import ValidationResult

_HOME = {
    "compare_session": "pipeline.compare_session",
    "compare_sessions": "pipeline.compare_sessions",
    "SideBySide": "pipeline.compare_sessions",
    "validate_session": "report",
    "validate_sessions": "report",
    "write_report": "report",
    "ValidationResult": "result",
    "find_events": "events.detect",
    "Event": "events.definitions",
    "EVENTS": "events.definitions",
    "correct_force": "measurement.force_correction",
    "find_quiet": "measurement.force_correction",
    "ValidationError": "errors",
    "InputError": "errors",
    "TrialError": "errors",
    "PredictionError": "errors",
}

__all__ = [
    "EVENTS",
    "Event",
    "InputError",
    "PredictionError",
    "SideBySide",
    "TrialError",
    "ValidationError",
    "ValidationResult",
    "compare_session",
    "compare_sessions",
    "correct_force",
    "find_events",
    "find_quiet",
    "validate_session",
    "validate_sessions",
    "write_report",
]


def __getattr__(name: str) -> Any:
    """Import the home of a public name when it is first asked for."""
    if name in _HOME:
        return getattr(import_module(f"validation.{_HOME[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
