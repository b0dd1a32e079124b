"""Writing the report of a comparison into a folder: the page, the results for programs, every table and the curves."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from validation.conventions import BODIES, Array
from validation.curves.table import force_on_base, trial_curves
from validation.events.definitions import EVENTS
from validation.numbers import MOST_DECIMALS
from validation.report.files import check_folder, write_files
from validation.report.page import ANIMATION, render_html
from validation.report.view import SessionView, netcdf_names, shown_trials
from validation.result import ValidationResult
from validation.side_by_side import SideBySide, present_alone
from validation.tables.schema import SCHEMA, SCHEMA_VERSION


def results_json(side: SideBySide) -> str:
    """The results of all sessions and models as JSON text: verdicts, warnings, provenance and all tables, SI; NaN and
    infinities are null. Nothing is written.

    Conventions: radians. One of ``results`` for each session and model; ``tables`` hold the rows of all, led by
    ``session`` and ``model``. Every field, its meaning and unit: `validation.results_schema` (JSON Schema 2020-12), as
    a page ``docs/results.md``.
    """
    content = {
        "schema": SCHEMA,
        "schema_version": SCHEMA_VERSION,
        "verdict_lines": side.verdict_lines,
        "refused": list(side.refused),
        "results": [
            {
                "session": r.session_name,
                "model": r.action_name,
                "outcome": r.outcome,
                "sentence": r.sentence,
                "advice": list(r.advice),
                "verdict_lines": r.verdict_lines,
                "warnings": r.warnings,
                "provenance": _convert_for_json(r.provenance),
            }
            for r in side.results
        ],
        "tables": {name: records(table) for name, table in side.tables.items()},
        "event_definitions": {
            name: {"title": kind.title, "unit": kind.unit, "definition": kind.definition}
            for name, kind in EVENTS.items()
        },
    }
    return json.dumps(content, indent=1, allow_nan=False, ensure_ascii=False) + "\n"


def records(table: pd.DataFrame) -> list[dict[str, Any]]:
    """Rows of a table as plain values, null for what does not exist."""
    names = [str(name) for name in table.columns]
    return [
        {name: _convert_for_json(value) for name, value in zip(names, row, strict=True)}
        for row in table.itertuples(index=False, name=None)
    ]


def table_csv(table: pd.DataFrame) -> str:
    """A table as CSV with a header; empty cells for what does not exist."""
    return table.to_csv(index=False, lineterminator="\n")


def _convert_for_json(value: Any) -> Any:
    """Value that JSON can hold: numbers of NumPy as Python's, numbers that are not finite as None."""
    if isinstance(value, dict):
        return {str(k): _convert_for_json(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_convert_for_json(v) for v in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if value is pd.NA or value is pd.NaT:
        return None
    return value


MOST_TRIALS = 8  # with a section of their own: choice
CURVES = re.compile(rf"curves(_\d+)?\.nc|curves/(s\d+-)?({'|'.join(('force', *BODIES))})\.(csv|json)")
SPREAD = ("mean_rad", "s_r_rad", "band95_rad", "difference_rad", "difference_u95_rad")


def curve_files(side: SideBySide) -> Iterator[tuple[str, str | bytes]]:
    """Yield name and content of every file of curves: netCDF for each result with all trials, and for each session and
    channel a CSV text with at most eight trials; SI, rad."""
    for name, result in zip(netcdf_names(side), side.results, strict=True):
        yield name, result.curves_netcdf()
    several = len(side.sessions) > 1
    for i, results in enumerate(side.sessions.values(), start=1):
        view = SessionView(tuple(results), f"s{i}-" if several else "")
        for channel, columns in view_curves(view).items():
            texts = {name: _texts(np.round(values, MOST_DECIMALS)) for name, values in columns.items()}
            rows = "\n".join(map(",".join, zip(*texts.values(), strict=True)))
            yield f"curves/{view.prefix}{channel}.csv", f"{','.join(texts)}\n{rows}\n"


def view_curves(view: SessionView) -> dict[str, dict[str, Array]]:
    """Columns (n,) by channel (``force`` and bodies) and column name: time, measured and predicted curves of at most
    eight trials, mean and bands, SI and rad; columns of the second model end in ``_m2``, and so on."""
    first = view.first
    base = first.base_s
    out: dict[str, dict[str, Array]] = {channel: {"time_s": base} for channel in ("force", *BODIES)}
    for trial in shown_trials(view, MOST_TRIALS):
        out["force"][f"trial{trial}_n"] = force_on_base(base, first.traces[trial])
        for j, result in enumerate(view.results, start=1):
            if trial not in result.traces:
                continue
            ending = "" if j == 1 else f"_m{j}"
            curves = trial_curves(base, result.traces[trial], result.film_traces.get(trial))
            for channel, values in curves.items():
                if not np.isfinite(values["measured_rad"]).any():
                    continue
                if j == 1:
                    out[channel][f"trial{trial}_measured_rad"] = values["measured_rad"]
                out[channel][f"trial{trial}_predicted_rad{ending}"] = values["predicted_rad"]
    for channel in BODIES:
        for j, result in enumerate(view.results, start=1):
            for name in SPREAD:
                column = f"{channel}_{name}"
                if column in result.spread and len(result.spread) == base.size:
                    values = result.spread[column].to_numpy(dtype=float)
                    if np.isfinite(values).any():
                        out[channel][name if j == 1 else f"{name}_m{j}"] = values
    return {channel: columns for channel, columns in out.items() if len(columns) > 1}


def _texts(values: Array) -> list[str]:
    """Numbers as text, empty where there is none; written in one go, a sixth of the time of one by one."""
    texts = json.dumps(values.tolist())[1:-1].split(", ")
    for i in np.flatnonzero(~np.isfinite(values)):
        texts[i] = ""
    return texts


def write_report(result: ValidationResult | SideBySide, folder: str | Path) -> ValidationResult | SideBySide:
    """Write the report of one result, or of several, into ``folder``, made if need be, replacing the files of an older
    report; returns a copy of it that names the files written.

    Parameters
    ----------
    result : ValidationResult or SideBySide
    folder : path
        Made if it does not exist.

    Returns
    -------
    ValidationResult or SideBySide
        The same with ``files``.

    Raises
    ------
    ValidationInputError
        The folder cannot be written; nothing new is left behind.

    Examples
    --------
    >>> import validation
    >>> result = validation.compare("sessions/example_forte", budget=False, explain=False)
    >>> validation.write_report(result, "written").files["results.json"].exists()
    True
    """
    if isinstance(result, SideBySide):
        return write_side_by_side(result, Path(folder))
    return write_side_by_side(present_alone(result), Path(folder)).results[0]


def write_side_by_side(side: SideBySide, folder: Path) -> SideBySide:
    """Write page, results, tables and curves of a comparison into ``folder``, replacing those of an older report, whose
    further curves are deleted; returns a copy that names the files. Raises an input error where it cannot be written.
    """
    check_folder(folder)
    texts: dict[str, str | bytes] = {f"tables/{name}.csv": table_csv(table) for name, table in side.tables.items()}
    texts.update(curve_files(side))
    texts["results.json"] = results_json(side)
    texts["report.html"] = render_html(
        side, animation=(folder / ANIMATION).is_file()
    )  # last: a page never points at tables that are not there yet
    files = write_files(folder, texts)
    for path in (*folder.glob("curves*.nc"), *folder.glob("curves/*")):
        if CURVES.fullmatch(name := path.relative_to(folder).as_posix()) and name not in texts:
            with suppress(OSError):  # another program reads it
                path.unlink()
    return side.with_files(files)
