"""Errors of the command line itself."""


class InputError(ValueError):
    """An argument of a command cannot be used; one line, exit code 2."""

    exit_code = 2
