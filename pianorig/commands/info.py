"""``pianorig info``: what a session or recording holds, what answers at a backend, or which versions are installed."""

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
    session: Annotated[
        Path | None, typer.Argument(help="Session folder, or a recording to import; without one: versions.")
    ] = None,
    backend: Annotated[
        str | None, typer.Option("--backend", help="Show what answers at sim://, ni://local or ni-grpc://host:31763.")
    ] = None,
    rig: Annotated[
        str | None, typer.Option("--rig", help="Built-in rig or a TOML file to hold against the backend.")
    ] = None,
    propose: Annotated[
        Path | None,
        typer.Option(
            "--propose",
            help="With --backend: write a rig file for the devices found there; with a recording: a mapping.",
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Show a session, a recording, a backend, or the versions.

    Of a recording (text, LVM, TDMS, HDF5, MATLAB) it lists the channels and proposes a mapping for its import.

    Example:  pianorig info sessions/try
    Example:  pianorig info lab.csv
    Example:  pianorig info --backend sim:// --rig pcie6363
    Example:  pianorig info --backend ni://local --propose found_rig.toml
    """
    is_recording = backend is None and session is not None and workflows.is_recording(session)
    if is_recording and session is not None:
        facts: dict[str, Any] = workflows.recording_facts(session, propose)
    elif propose is not None:
        if backend is None:
            raise CommandInputError("--propose: goes with --backend ADDRESS or with a recording")
        facts = workflows.write_proposal(backend, propose, rig)
    elif backend is not None:
        facts = workflows.backend_facts(backend, rig)
    else:
        facts = _versions() if session is None else workflows.session_facts(session)
    lines = []
    for key, value in facts.items():
        if isinstance(value, list):
            lines += ["  " + "  ".join(f"{k} {v}" for k, v in row.items()) for row in value]
        elif key == "mapping" and "\n" in value:
            lines += [f"# proposed mapping of {session}; look at each line marked CHECK", *value.splitlines()]
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
