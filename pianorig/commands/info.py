"""``pianorig info``: what a session or recording holds, what answers at a backend, or which versions are installed."""

from __future__ import annotations

import math
import platform
from contextlib import closing
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import rig
from pianorig import workflows
from pianorig.console.column_file import FIGURE_ENDINGS, check_writable
from pianorig.console.options import AsJson, Figure
from pianorig.console.output import tell
from pianorig.errors import CommandInputError

if TYPE_CHECKING:
    from rig.daq.discovery import FoundDevice

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
    rig_name: Annotated[
        str | None, typer.Option("--rig", help="Built-in rig or a TOML file to hold against the backend.")
    ] = None,
    propose: Annotated[
        Path | None,
        typer.Option(
            "--propose",
            help="With --backend: write a rig file for the devices found there; with a recording: a mapping.",
        ),
    ] = None,
    figure: Figure = None,
    as_json: AsJson = False,
) -> None:
    """Show a session, a recording, a backend or the versions; propose a rig file.
    Of a recording (text, LVM, TDMS, HDF5, MATLAB) it lists the channels and proposes a mapping for its import. What is
    proposed is written with --propose only, never over a file.

    Example:  pianorig info sessions/try
    Example:  pianorig info lab.csv
    Example:  pianorig info --backend sim:// --rig pcie6363
    Example:  pianorig info --backend ni://local --propose found_rig.toml
    """
    check_writable(figure, *FIGURE_ENDINGS)
    is_recording = backend is None and session is not None and workflows.is_recording(session)
    if is_recording and session is not None:
        facts: dict[str, Any] = workflows.recording_facts(session, propose)
    elif propose is not None:
        if backend is None:
            raise CommandInputError("--propose: goes with --backend ADDRESS or with a recording")
        facts = write_proposal(backend, propose, rig_name)
    elif backend is not None:
        facts = backend_facts(backend, rig_name)
    else:
        facts = _versions() if session is None else session_facts(session)
    if figure is not None:
        if is_recording or backend is not None or session is None:
            raise CommandInputError("--figure: draws a session; give its folder, without --backend")
        workflows.draw_session(rig.Session.open(session), figure)
        facts["figure"] = figure
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
    """Versions by name of Python, the platform and the packages this tool rests on, ``not installed`` where one is
    absent."""
    found = {"python": platform.python_version(), "platform": platform.platform()}
    for package in PACKAGES:
        try:
            found[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            found[package] = "not installed"
    return found


def session_facts(path: Path) -> dict[str, Any]:
    """Facts of a session by name: folder, operator, date, action, profile; ``trials``: a dict each of number, status,
    peak force (N), film, …, of an unreadable one with its problem."""
    session = rig.Session.open(path)
    rows = []
    for trial in session.trials:
        if problem := trial.problem:
            rows.append({"trial": trial.number, "status": trial.status, "problem": problem})
            continue
        data = trial.read()
        rows.append(
            {
                "trial": trial.number,
                "status": trial.status,
                "rejected": trial.rejected or "no",
                "samples": data.n_valid,
                "peak_force_n": _peak_force(data),
                "not_recorded": ", ".join(data.absent if data.has_force else ("force", *data.absent)) or "nothing",
                "positions": ", ".join(data.position_names) or "none",
                "film": trial.film.name if trial.film else "none",
            }
        )
    info = session.info
    there = {trial.number for trial in session.trials} | set(session.journals)
    absent = sorted(set(range(1, max(there, default=0))) - there)
    return {
        "session": session.path,
        "operator": info.operator,
        "created": info.created_utc,
        "simulated": info.simulated,
        "action": info.action.name,
        "profile": info.profile.name,
        "trials": rows,
        **({"absent_trials": ", ".join(map(str, absent))} if absent else {}),
    }


def _peak_force(data: rig.TrialData) -> float | str:
    if not (data.n_valid and data.has_force):
        return "not recorded"
    peak_n = data.peak_force_n
    return "not known" if math.isnan(peak_n) else round(peak_n, 2)


def backend_facts(backend: str, rig_name: str | None) -> dict[str, Any]:
    """Facts by name of what answers at a backend address: driver, devices with serial numbers, and, given a rig file
    (name or path), whether hardware moves, watchdog, sample rate, force delay (s). Nothing moves.

    Without a rig file only the devices are listed; ``sim://`` has those of the built-in one.
    """
    # start-up: 0.2 s of nidaqmx, which --help does not need
    from rig.daq.address import discover
    from rig.daq.nidaqmx_backend import NidaqmxBackend

    if rig_name is None and not backend.startswith("sim:"):
        driver, devices = discover(backend)
        return {"backend": backend, "driver": f"NI-DAQmx {driver}", "devices": _rows(devices)}
    config = rig.load_rig(rig_name or "virtual").config
    with closing(rig.open_backend(backend, config)) as bench:
        facts = bench.capabilities
        devices = bench.devices() if isinstance(bench, NidaqmxBackend) else []
    return {
        "backend": facts.name,
        "simulated": facts.simulated,
        "permission": "needed before anything moves" if facts.hardware else "not needed, nothing real moves",
        "watchdog": "yes" if facts.watchdog else "no",
        "rig": config.name,
        "device": config.device.name,
        **{key: value for key, value in facts.description.items() if not key.startswith("slot_")},
        "devices": _rows(devices),
        "sample_rate_hz": config.device.sample_rate_hz,
        "force_group_delay_s": config.force.group_delay(config.device.sample_rate_hz),
        "camera": "none" if config.camera is None else config.camera.mode,
    }


def _rows(devices: list[FoundDevice]) -> list[dict[str, Any]]:
    return [
        {"device": one.name, "product": one.product, "serial_number": one.serial, "slot": one.slot or "-"}
        for device in devices
        for one in device
    ]


def write_proposal(backend: str, path: Path, rig_name: str | None = None) -> dict[str, Any]:
    """Write a rig file proposed for the devices behind a backend address to ``path``, where no file may be, once it
    passes the check of rig files; return its path, device and product by name."""
    # start-up: 0.2 s of nidaqmx, which --help does not need
    from rig.atomic_write import write_text
    from rig.daq.address import discover
    from rig.daq.nidaqmx_backend import NidaqmxBackend
    from rig.daq.rig_proposal import propose_rig

    if path.exists():
        raise CommandInputError(f"{path}: exists already; choose another name")
    if backend.startswith("sim:"):
        with closing(rig.open_backend(backend, rig.load_rig(rig_name or "virtual").config)) as bench:
            devices = bench.devices() if isinstance(bench, NidaqmxBackend) else []
    else:
        _, devices = discover(backend)
    text = propose_rig(devices)
    config = rig.parse_rig(text, str(path)).config
    write_text(path, text)
    return {"rig": path, "device": config.device.name, "product": config.device.product}
