"""Where measured meets predicted: signals, events, repeatability, scores, report.

Place in the data flow: sessions of `rig` and predictions of `model` → `ValidationResult` → ``report.html``,
``results.json``. Names are imported when first used, so that importing `validation` costs nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from validation.comparison import compare_session
    from validation.errors import InputError, PredictionError, TrialError, ValidationError
    from validation.event import EVENTS, Event
    from validation.events import find_events
    from validation.report import validate_session, write_report
    from validation.result import ValidationResult
    from validation.signals import correct_force, find_quiet

_HOME = {
    "compare_session": "comparison",
    "validate_session": "report",
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
    "TrialError",
    "ValidationError",
    "ValidationResult",
    "compare_session",
    "correct_force",
    "find_events",
    "find_quiet",
    "validate_session",
    "write_report",
]


def __getattr__(name: str) -> Any:
    """Import the home of a public name when it is first asked for."""
    if name in _HOME:
        return getattr(import_module(f"validation.{_HOME[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
