"""``pianorig import``: make a session of recordings by other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def command(
    files: Annotated[
        list[Path], typer.Argument(help="Recordings (TDMS, LVM, CSV, HDF5): trial 1, 2, … in this order.")
    ],
    mapping: Annotated[Path, typer.Option("--mapping", help="TOML file: which channel is what.")],
    out: Annotated[Path, typer.Option("--out", help="Session folder to create.")],
    as_json: Annotated[bool, typer.Option("--json", help="Print a JSON summary.")] = False,
) -> None:
    """Import recordings into a session; docs/import.md has a mapping file to start from.

    Example:  pianorig import run1.tdms run2.tdms --mapping lab.toml --out sessions/lab_2025
    """
    from pianorig.console.output import print_json
    from rig.foreign.mapping import load_mapping
    from rig.foreign.session_import import import_session

    session = import_session(out, files, load_mapping(mapping))
    rows = []
    for trial in session.trials:
        data = trial.read()
        rows.append(
            {
                "trial": trial.number,
                "samples": data.n_valid,
                "sample_rate_hz": data.sample_rate_hz,
                "peak_force_n": float(data.force_n.max()),
                "blow_start_s": data.blow_start_s,
                "turned_rad": {e.name: float(v) for e, v in zip(data.encoders, _turned(data), strict=True)},
            }
        )
    if as_json:
        print_json({"session": session.path, "trials": rows})
        return
    for row in rows:
        source = session.info.notes[f"trial {row['trial']}"].partition(" sha256 ")[0]
        print(
            f"trial {row['trial']}: {source}, {row['samples']} samples at {row['sample_rate_hz']:g} Hz, "
            f"peak {row['peak_force_n']:.2f} N, blow from {row['blow_start_s']:.3f} s"
        )
    print(f"session: {session.path}")


def _turned(data: object) -> list[float]:
    import numpy as np

    angle = data.angle_rad()  # type: ignore[attr-defined]
    return [float(v) for v in angle[np.argmax(np.abs(angle), axis=0), range(angle.shape[1])]]
