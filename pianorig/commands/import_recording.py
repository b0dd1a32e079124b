"""``pianorig import``: make a session of recordings by other programs."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import model
import rig
from pianorig.console.options import AsJson
from pianorig.console.output import tell

if TYPE_CHECKING:
    from rig.session.ruler import Position


def _position_facts(position: Position) -> dict[str, Any]:
    return {
        "largest_m": float(position.displacement_m.max()),
        "u_mean_m": float(position.u_m.mean()),
        "beyond_ruler_share": float((position.flag != 0).mean()),
        "judgement": position.judgement,
    }


def _describe_doubts(row: dict[str, Any]) -> str:
    """Text to append to the line of an imported trial (``row``: its facts by name): condition, rejection, status,
    limits exceeded, encoders absent, each after a semicolon; empty for none."""
    found = [row["condition"]] if row["condition"] else []
    found += [f"rejected: {row['rejected']}"] if row["rejected"] else []
    found += [f"{row['status']}: {row['reason']}"] if row["status"] != "complete" else []
    found += [f"beyond the limits: {row['beyond_limits']}"] if row["beyond_limits"] else []
    found += [row["cannot_be_a_blow"]] if row["cannot_be_a_blow"] else []
    if row["absent"]:
        found.append(f"no encoder of {' and '.join(row['absent'])}: validate needs key, whippen and hammer")
    for name, facts in row["positions"].items():
        if facts["beyond_ruler_share"] > 0:
            found.append(f"{name} {100 * facts['beyond_ruler_share']:.1f} % beyond its ruler, flagged")
    return "".join(f"; {text}" for text in found)


def _implausibility(data: rig.TrialData) -> str:
    """Sentence on why the raw force of a trial cannot be that of a blow on a key; empty where it can, or where no force
    was recorded."""
    import numpy as np  # start-up: --help needs none of it

    known = np.isfinite(data.raw_force_n)
    if not data.has_force or known.sum() < 2:
        return ""
    return model.blow_implausibility(data.time_s[known], data.raw_force_n[known], "force")


def command(
    files: Annotated[
        list[Path], typer.Argument(help="Recordings (text, LVM, TDMS, HDF5, MATLAB): trial 1, 2, … in this order.")
    ],
    mapping: Annotated[Path, typer.Option("--mapping", help="TOML file: which channel is what.")],
    out: Annotated[Path, typer.Option("--out", help="Session folder to create.")],
    as_json: AsJson = False,
) -> None:
    """Make a session of recordings by other programs.
    The session is a new folder; nothing is made where one of the files cannot be used.

    docs/import.md has a mapping file to start from.

    Example:  pianorig import lab.csv --mapping lab.toml --out sessions/lab
    """
    session = rig.import_session(out, files, rig.load_mapping(mapping))
    rows: list[dict[str, Any]] = [
        {
            "trial": trial.number,
            "samples": (data := trial.read()).n_valid,
            "sample_rate_hz": data.sample_rate_hz,
            "status": data.status,
            "reason": data.reason,
            "beyond_limits": session.info.notes.get(f"limits of trial {trial.number}", ""),
            "cannot_be_a_blow": _implausibility(data),
            "rejected": trial.rejected,
            "absent": list(data.absent) if data.has_force else [],
            "condition": data.condition,
            "peak_force_n": None if math.isnan(peak_n := data.peak_force_n) else peak_n,
            "raw_peak_force_n": float(data.raw_force_n.max()) if data.has_force else None,
            "blow_start_s": data.blow_start_s,
            "turned_rad": {
                encoder.name: max(angle, key=abs)
                for encoder, angle in zip(data.encoders, data.angle_rad.T.tolist(), strict=True)
            },
            "positions": {name: _position_facts(data.position(name)) for name in data.position_names},
        }
        for trial in session.trials
    ]
    lines = []
    for row in rows:
        source = session.info.notes[f"trial {row['trial']}"].partition(" sha256 ")[0]
        raw_n, peak_n = row["raw_peak_force_n"], row["peak_force_n"]
        peak = "no force" if raw_n is None else f"raw peak {raw_n:.2f} N" if peak_n is None else f"peak {peak_n:.2f} N"
        lines.append(
            f"trial {row['trial']}: {source}, {row['samples']} samples at {row['sample_rate_hz']:g} Hz, "
            f"{peak}, blow from {row['blow_start_s']:.3f} s{_describe_doubts(row)}"
        )
    lines += [f"{name}: {facts['judgement']}" for name, facts in rows[0]["positions"].items()]
    tell(as_json, {"session": out, "trials": rows}, [*lines, f"session: {out}"])
