"""Curves beside the page: every curve of a result as netCDF, those that the page draws as CSV and JSON by channel.

Conventions: SI and rad on the one time base; CSV and JSON hold at most `MOST_TRIALS` trials, netCDF all of them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from validation.conventions import BODIES, Array
from validation.curves.table import force_on_base, trial_curves
from validation.report.view import SessionView, shown_trials
from validation.side_by_side import SideBySide

MOST_TRIALS = 8
DIGITS = 9  # after the point, in rad and N: far below a count
SPREAD = ("mean_rad", "s_r_rad", "band95_rad", "difference_rad", "difference_u95_rad", "difference_band95_rad")


def netcdf_names(side: SideBySide) -> list[str]:
    """Names of the netCDF files, one for each session and model."""
    if len(side.results) == 1:
        return ["curves.nc"]
    return [f"curves_{i}.nc" for i in range(1, len(side.results) + 1)]


def curve_name(prefix: str, channel: str) -> str:
    """Name of a channel's curves without its ending."""
    return f"curves/{prefix}{channel}"


def curve_files(side: SideBySide) -> Iterator[tuple[str, str | bytes]]:
    """Name and content of every file of curves."""
    for name, result in zip(netcdf_names(side), side.results, strict=True):
        yield name, result.curves_netcdf()
    several = len(side.sessions) > 1
    for i, results in enumerate(side.sessions.values(), start=1):
        view = SessionView(tuple(results), f"s{i}-" if several else "")
        for channel, columns in view_curves(view).items():
            texts = {name: [_text(x) for x in np.round(values, DIGITS).tolist()] for name, values in columns.items()}
            rows = "\n".join(map(",".join, zip(*texts.values(), strict=True)))
            name = curve_name(view.prefix, channel)
            yield f"{name}.csv", f"{','.join(texts)}\n{rows}\n"
            lists = ",\n".join(
                f'"{key}": [{",".join(text or "null" for text in column)}]' for key, column in texts.items()
            )
            yield f"{name}.json", f"{{\n{lists}\n}}\n"


def view_curves(view: SessionView) -> dict[str, dict[str, Array]]:
    """Columns of every channel that has a curve; a second model's columns end in its number."""
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


def _text(value: float) -> str:
    return repr(value) if math.isfinite(value) else ""
