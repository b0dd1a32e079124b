"""``pianorig export``: trials as files of other programs, and their force as ``simulate`` and ``study`` take it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import rig
from pianorig import workflows
from pianorig.console.column_file import make_folder, write_columns
from pianorig.console.options import AsJson
from pianorig.console.output import file_lines, tell
from pianorig.errors import CommandInputError

FORCE = "force"


def command(
    session: Annotated[Path, typer.Argument(help="Session folder, or one trial_NNNN.h5.")],
    to: Annotated[
        str, typer.Option("--to", help="csv, mat, tdms, parquet; or force: the corrected force as time_s,force_n.")
    ] = "csv",
    trial: Annotated[
        list[int] | None, typer.Option("--trial", help="Number of a trial; may be repeated; default: all.")
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", help="Folder to write to; default: SESSION/export.")] = None,
    as_json: AsJson = False,
) -> None:
    """Write trials as CSV, MATLAB, TDMS or Parquet.
    Values are those of the sealed trial, each column with its unit; a file that is there is not written over. TDMS and
    Parquet need the extras  tdms  and  parquet.

    Example:  pianorig export sessions/try --to csv --trial 1 --out exported
    """
    files = export_session(session, to, trials=trial, out=out)
    tell(as_json, {"session": session, "files": files}, file_lines(files))


def export_session(path: Path, form: str, *, trials: list[int] | None = None, out: Path | None = None) -> list[Path]:
    """Write trials of a session (by number; None: all readable), or the trial file ``path``, as ``form`` (csv, mat,
    tdms, parquet, or force) into ``out`` (None: ``export`` in the session); return the files. No file is overwritten.
    """
    from rig.session.trial_export import FORMATS, export_trial  # start-up: 0.5 s of h5py and pandas

    if form not in (*FORMATS, FORCE):
        raise CommandInputError(f"--to {form}: allowed {', '.join((*FORMATS, FORCE))}")
    chosen = _choose_trials(path, trials)
    folder = out if out is not None else chosen[0].path.parent / "export"
    make_folder(folder, parents=True)
    files: list[Path] = []
    for trial in chosen:
        if form == FORCE:
            name = f"force_{trial.number:04d}.csv" if len(chosen) > 1 else "force.csv"
            files.append(_write_force(trial, folder / name))
        else:
            files += export_trial(trial.read(), folder / f"{trial.path.stem}.{form}")
    return files


def _choose_trials(path: Path, numbers: list[int] | None) -> list[rig.Trial]:
    """Trials of the session folder ``path`` with these numbers (None or none: all that can be read, also rejected
    ones), or the one trial of the file ``path``, which takes no numbers."""
    if path.suffix == ".h5":
        found = [trial for trial in rig.Session.open(path.parent).trials if trial.path.name == path.name]
        if not found or numbers:
            raise CommandInputError(
                f"{path}: {'--trial goes with a session folder' if found else 'is no trial of a session'}"
            )
        return found
    session = rig.Session.open(path)
    return list(session.readable_trials) if not numbers else [session.trial(number) for number in sorted(set(numbers))]


def _write_force(trial: rig.Trial, file: Path) -> Path:
    if file.exists():
        raise CommandInputError(f"{file}: exists already; delete it, or choose another --out")
    force = workflows.read_driving_force(trial.path)
    write_columns(file, {"time_s": force.time_s, "force_n": force.force_n})
    return file
