"""Errors of the command line itself."""


class CommandInputError(ValueError):
    """An argument of a command cannot be used; printed in one line, exit code 2."""

    exit_code = 2


InputError = CommandInputError
