"""Where measured meets predicted: signals, events, repeatability, scores, report.

Place in the data flow: sessions of `rig` and predictions of `model` → `ValidationResult`, several of them `SideBySide`
→ ``report.html``, ``results.json``. Names are imported when first used, so that importing `validation` costs nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from validation.comparison import compare_session
    from validation.errors import InputError, PredictionError, TrialError, ValidationError
    from validation.event import EVENTS, Event
    from validation.events import find_events
    from validation.report import validate_session, validate_sessions, write_report
    from validation.result import ValidationResult
    from validation.side_by_side import SideBySide, compare_sessions
    from validation.signals import correct_force, find_quiet

_HOME = {
    "compare_session": "comparison",
    "compare_sessions": "side_by_side",
    "SideBySide": "side_by_side",
    "validate_session": "report",
    "validate_sessions": "report",
    "write_report": "report",
    "ValidationResult": "result",
    "find_events": "events",
    "Event": "event",
    "EVENTS": "event",
    "correct_force": "signals",
    "find_quiet": "signals",
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
