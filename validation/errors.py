"""Errors of the `validation` package."""

from __future__ import annotations

from typing import ClassVar


class ValidationError(Exception):
    """Base class of everything `validation` raises on purpose; a defect unless a subclass says otherwise."""

    exit_code: ClassVar[int] = 1


class ValidationInputError(ValidationError, ValueError):
    """The session, the action or the output path cannot be used as given."""

    exit_code: ClassVar[int] = 2


InputError = ValidationInputError


class TrialError(ValidationInputError):
    """One trial cannot be used; the others still can, and the report states the reason."""


class PredictionError(ValidationError):
    """The model did not return a prediction of the promised shape."""
