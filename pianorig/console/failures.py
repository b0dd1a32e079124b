"""What a user reads when a command fails: one line on standard error, with ``--json`` also an object on the output.

Exit codes: 2 bad input, 3 hardware or safety fault, 1 defect, 130 stopped by Ctrl-C.
"""

from __future__ import annotations

import sys
from typing import Any

from pianorig.console.output import name_options, print_json
from pianorig.console.terminal import LIVE

KINDS = {1: "defect", 2: "bad input", 3: "hardware or safety", 130: "interrupted"}
INTERRUPTED = 130


class Interrupted(Exception):
    """Ctrl-C or a request to end stopped a command; the message says what that did."""

    exit_code = INTERRUPTED


def how_stopped(interrupt: BaseException) -> str:
    """``stopped by Ctrl-C``, or by the signal that was sent."""
    return str(interrupt) or "stopped by Ctrl-C"


def tell_failure(problem: BaseException, as_json: bool) -> int:
    """Print why a command ended as one line on standard error and, ``as_json``, as an object on standard output; return
    the exit code, 1 for a defect, else the error's own."""
    code = getattr(problem, "exit_code", None)
    if hasattr(problem, "format_message"):  # a usage error of typer's
        message = _usage(problem)
    elif code is None:
        message = f"defect: {type(problem).__name__}: {problem} (run again with --debug before the command)"
    else:
        message = str(problem)
    message, code = name_options(" ".join(message.split())), 1 if code is None else int(code)
    LIVE.clear()
    if as_json:
        error = {"message": message, "kind": KINDS.get(code, "defect"), "exit_code": code}
        print_json({**getattr(problem, "facts", {}), "error": error})
    print(f"pianorig: {message}", file=sys.stderr, flush=True)
    return code


def _usage(problem: Any) -> str:
    message = problem.format_message().strip()
    path = getattr(getattr(problem, "ctx", None), "command_path", "pianorig")
    return f"{message}{'' if message.endswith(('.', '?', '!')) else '.'} See  {path} --help"
