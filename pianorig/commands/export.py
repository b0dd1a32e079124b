"""``pianorig export``: trials as files of other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pianorig import workflows
from pianorig.console.options import AsJson
from pianorig.console.output import file_lines, tell


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

    Values are those of the sealed trial, each column with its unit. TDMS and Parquet need the extras  tdms  and
    parquet.

    Example:  pianorig export sessions/try --to csv --trial 1 --out exported
    """
    files = workflows.export_session(session, to, trials=trial, out=out)
    tell(as_json, {"session": session, "files": files}, file_lines(files))
