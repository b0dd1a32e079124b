"""``pianorig import``: make a session of recordings by other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import rig
from pianorig.console.options import AsJson
from pianorig.console.output import print_json


def command(
    files: Annotated[
        list[Path], typer.Argument(help="Recordings (TDMS, LVM, CSV, HDF5): trial 1, 2, … in this order.")
    ],
    mapping: Annotated[Path, typer.Option("--mapping", help="TOML file: which channel is what.")],
    out: Annotated[Path, typer.Option("--out", help="Session folder to create.")],
    as_json: AsJson = False,
) -> None:
    """Make a session of recordings by other programs.

    docs/import.md has a mapping file to start from.

    Example:  pianorig import lab.csv --mapping lab.toml --out sessions/lab
    """
    session = rig.import_session(out, files, rig.load_mapping(mapping))
    rows = [
        {
            "trial": trial.number,
            "samples": (data := trial.read()).n_valid,
            "sample_rate_hz": data.sample_rate_hz,
            "peak_force_n": float(data.force_n.max()),
            "blow_start_s": data.blow_start_s,
            "turned_rad": {
                encoder.name: max(angle, key=abs)
                for encoder, angle in zip(data.encoders, data.angle_rad().T.tolist(), strict=True)
            },
        }
        for trial in session.trials
    ]
    if as_json:
        print_json({"session": out, "trials": rows})
        return
    for row in rows:
        source = session.info.notes[f"trial {row['trial']}"].partition(" sha256 ")[0]
        print(
            f"trial {row['trial']}: {source}, {row['samples']} samples at {row['sample_rate_hz']:g} Hz, "
            f"peak {row['peak_force_n']:.2f} N, blow from {row['blow_start_s']:.3f} s"
        )
    print(f"session: {out}")
