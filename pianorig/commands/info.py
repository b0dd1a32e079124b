"""``pianorig info``: what a session holds, what answers at a backend, or which versions are installed."""

from __future__ import annotations

import platform
from importlib import metadata
from pathlib import Path
from typing import Annotated, Any

import typer

from pianorig import workflows
from pianorig.console.options import AsJson
from pianorig.console.output import tell
from pianorig.errors import CommandInputError

PACKAGES = (
    "piano-action-rig", "numpy", "scipy", "pandas", "h5py", "matplotlib", "opencv-python-headless", "nidaqmx", "numba",
)  # fmt: skip


def command(
    session: Annotated[Path | None, typer.Argument(help="Session folder; without one: versions.")] = None,
    backend: Annotated[
        str | None, typer.Option("--backend", help="Show what answers at sim://, ni://local or ni-grpc://host:31763.")
    ] = None,
    rig: Annotated[
        str | None, typer.Option("--rig", help="Built-in rig or a TOML file to hold against the backend.")
    ] = None,
    propose: Annotated[
        Path | None, typer.Option("--propose", help="With --backend: write a rig file for the devices found there.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Show a session, a backend, or the installed versions.

    Example:  pianorig info sessions/try
    Example:  pianorig info --backend sim:// --rig pcie6363
    Example:  pianorig info --backend ni://local --propose found_rig.toml
    """
    if propose is not None:
        if backend is None:
            raise CommandInputError("--propose: goes with --backend ADDRESS")
        facts: dict[str, Any] = workflows.write_proposal(backend, propose, rig)
    elif backend is not None:
        facts = workflows.backend_facts(backend, rig)
    else:
        facts = _versions() if session is None else workflows.session_facts(session)
    lines = []
    for key, value in facts.items():
        if isinstance(value, list):
            lines += ["  " + "  ".join(f"{k} {v}" for k, v in row.items()) for row in value]
        else:
            lines.append(f"{key:<16} {value}")
    tell(as_json, facts, lines)


def _versions() -> dict[str, str]:
    """Versions of Python, the platform and the packages this tool rests on."""
    found = {"python": platform.python_version(), "platform": platform.platform()}
    for package in PACKAGES:
        try:
            found[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            found[package] = "not installed"
    return found
