"""Run the example of every public function, in a folder with the files of ``pianorig examples``.

Run:  PYTHONPATH=. python docs/run_docstrings.py [NAME ...]
"""

from __future__ import annotations

import contextlib
import doctest
import functools
import os
import shutil
import sys
import tempfile
from pathlib import Path
from typing import Any

import validation
from tests.command_line import run
from tests.public_functions import ROOT, public_functions


def kept(function: Any) -> Any:
    """The same function, made once for the same arguments: nine examples begin with one fit."""
    made: dict[str, Any] = {}

    @functools.wraps(function)
    def call(*arguments: Any, **named: Any) -> Any:
        asked = repr((arguments, named))
        if asked not in made:
            made[asked] = function(*arguments, **named)
        return made[asked]

    return call


def wrong(name: str, function: Any) -> str:
    """What is wrong with the example of a function; empty where it says what it prints."""
    (found,) = doctest.DocTestFinder(recurse=False).find(function, name, module=False, globs={})
    if any(doctest.SKIP in example.options for example in found.examples):
        return f"{name}: a skipped example\n"
    said: list[str] = []
    failed, tried = doctest.DocTestRunner(verbose=False).run(found, out=said.append)
    return "".join(said) if failed else "" if tried else f"{name}: no example\n"


def main(names: list[str]) -> int:
    """Run the examples of the named functions, of all without names; the exit code."""
    functions = public_functions()
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        assert run("examples", Path(folder)) == 0
        shutil.copytree(ROOT / "sessions" / "example_forte", Path(folder) / "sessions" / "example_forte")
        setattr(validation, "identify", kept(validation.identify))  # noqa: B010
        said = [text for name in names or functions if (text := wrong(name, functions[name]))]
        os.chdir(ROOT)
    print("".join(said) or f"{len(names or functions)} examples print what they say")
    return int(bool(said))


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
