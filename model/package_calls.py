"""A package that is called like a function says which function was meant."""

from __future__ import annotations

import sys


def refuse_call(package: str, function: str) -> None:
    """Let ``package(...)`` raise ``TypeError`` in one line that names the ``function`` to call."""

    def refuse(*_given: object, **_named: object) -> None:
        raise TypeError(f"{package} is a package, not a function; call {function}")

    module = sys.modules[package]
    module.__class__ = type("CalledPackage", (type(module),), {"__call__": refuse})
