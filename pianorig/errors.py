"""Errors of the command line itself."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


class CommandInputError(ValueError):
    """An argument of a command cannot be used; printed in one line, exit code 2.

    Parameters
    ----------
    message : one line: what, where, found, allowed, what to do
    facts : what was reached all the same, for the JSON object that ``--json`` prints
    """

    exit_code = 2

    def __init__(self, message: str, facts: Mapping[str, Any] | None = None) -> None:
        super().__init__(message)
        self.facts = dict(facts or {})


InputError = CommandInputError
