"""The local table: how much each event and curve of a blow changes with each parameter, ranked and drawn."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from model.arrays import ArrayRecord
from model.files.figure_sheet import new_sheet
from model.sensitivity.result import Sensitivities

Array = NDArray[np.float64]

MOST_ROWS = 20  # that fit on a page
LEAST = 5e-4  # a smaller entry is shown as 0
TITLES = {
    "onset_s": "onset", "key_bottom_s": "key bottom", "let_off_s": "let-off time", "let_off_m": "let-off distance",
    "strike_s": "strike time", "strike_m_per_s": "hammer speed", "rebound_s": "rebound time",
    "rebound_m_per_s": "rebound speed", "check_s": "check time", "check_m": "check height", "drop_s": "drop time",
}  # fmt: skip


@dataclass(frozen=True)
class LocalTable(ArrayRecord):
    """Change of quantities of one blow with P parameters, the most influential first.

    An event's time is counted from the key's onset, the onset from the start of the table; a curve is an angle's turn
    from its first value, and its change the root mean square over that of the turn.

    Attributes
    ----------
    parameters : (P,) names, ranked by their largest ``percent``
    quantities : (Q,) events that happen, then curves (``hammer curve``)
    units : (Q,) s, m, m/s or rad
    values : (Q,) the quantity; of a curve its root mean square turn
    percent : (P, Q) percent of the quantity per percent of the parameter; a curve's is its size, without a sign
    change : (P, Q) change of the quantity, in its unit, for one percent of the parameter
    per_u : (P, Q) the same for one declared standard uncertainty; NaN where none is declared
    """

    parameters: tuple[str, ...]
    quantities: tuple[str, ...]
    units: tuple[str, ...]
    values: Array
    percent: Array
    change: Array
    per_u: Array

    def rows(self) -> list[dict[str, Any]]:
        """Rows for a file, one a parameter and quantity: rank, names, unit, value, change by one percent of the
        parameter (in percent, in the unit) and by its standard uncertainty."""
        return [
            {
                "rank": i + 1,
                "parameter": parameter,
                "quantity": quantity,
                "unit": self.units[q],
                "value": float(self.values[q]),
                "percent_per_percent": float(self.percent[i, q]),
                "change_per_percent": float(self.change[i, q]),
                "change_per_u": float(self.per_u[i, q]),
            }
            for i, parameter in enumerate(self.parameters)
            for q, quantity in enumerate(self.quantities)
        ]


def local_table(found: Sensitivities) -> LocalTable:
    """Rank parameters by the effect of one percent of each on a blow's events and body curves (rms turn), from its
    sensitivities; times of events count from the onset.

    Parameters
    ----------
    found : from `model.sensitivities`

    Returns
    -------
    LocalTable

    Examples
    --------
    >>> import model
    >>> found = model.sensitivities("hirschkorn2004", model.force_table("forte"), ["hammer.mass", "friction"])
    >>> table = model.sensitivity.local_table(found)
    >>> table.parameters[0]
    'hammer.mass'
    """
    events = {name: value for name, value in found.events.items() if not np.isnan(value)}
    slopes = [found.d_events[name] for name in events]
    values = list(events.values())
    if "onset_s" in events:
        onset, d_onset = events["onset_s"], found.d_events["onset_s"]
        start = float(found.time_s[0])
        for k, name in enumerate(events):
            if name == "onset_s":
                values[k] -= start
            elif name.endswith("_s") and not name.endswith("_per_s"):
                values[k], slopes[k] = values[k] - onset, slopes[k] - d_onset
    names, units = list(events), [unit_of(name) for name in events]
    for i, body in enumerate(found.angle_names):
        turn = found.angles_rad[:, i] - found.angles_rad[0, i]
        change = found.d_angles[:, i] - found.d_angles[0, i]
        names.append(f"{body} curve")
        units.append("m" if body == "key_lift" else "rad")
        values.append(float(np.sqrt(np.mean(turn**2))))
        slopes.append(np.sqrt(np.mean(change**2, axis=0)))
    value, slope = np.array(values), np.array(slopes).T  # slope: (P, Q), per SI unit of each parameter
    whole = slope * found.values[:, None]  # per 100 % of it
    whole[:, len(events) :] = np.abs(whole[:, len(events) :])
    percent = np.divide(whole, value, out=np.zeros_like(whole), where=value != 0.0)
    order = np.argsort(-np.max(np.abs(percent), axis=1, initial=0.0), kind="stable")
    return LocalTable(
        tuple(found.parameters[i] for i in order),
        tuple(names),
        tuple(units),
        value,
        percent[order],
        whole[order] / 100,
        (slope * found.uncertainties[:, None])[order],
    )


def unit_of(event: str) -> str:
    return "m/s" if event.endswith("_per_s") else event.rpartition("_")[2]


def lines(table: LocalTable, quantities: Mapping[str, str], max_rows: int) -> list[str]:
    """The table as text: a line a parameter, a column for each of ``quantities`` (name -> heading) that it has."""
    shown = [
        (table.quantities.index(name), heading) for name, heading in quantities.items() if name in table.quantities
    ]
    width = max([len("parameter"), *(len(name) for name in table.parameters[:max_rows])])
    out = [f"{'parameter':<{width}}" + "".join(f" {heading:>11}" for _, heading in shown)]
    for i, name in enumerate(table.parameters[:max_rows]):
        out.append(f"{name:<{width}}" + "".join(f" {table.percent[i, q]:>z11.4f}" for q, _ in shown))
    return out


def draw_local(table: LocalTable, path: str | Path, name: str = "") -> None:
    """Write a map of percent per percent to ``path`` (.svg, .pdf or .png), in place of a file there: parameters, the
    most influential on top, by events and curves; ``name``: of the action.

    Parameters
    ----------
    table : from `local_table`
    path : file to write, .svg, .pdf or .png
    name : of the action, for the title

    Examples
    --------
    >>> import model
    >>> found = model.sensitivities("hirschkorn2004", model.force_table("forte"), ["hammer.mass", "friction"])
    >>> model.sensitivity.draw_local(model.sensitivity.local_table(found), "local.svg")
    """
    shown = table.percent[:MOST_ROWS]
    with new_sheet(path, 2.5 + 0.62 * len(table.quantities), 2.4 + 0.28 * len(shown)) as figure:
        axes = figure.subplots()
        # one strong parameter would leave the others without a colour
        limit = max(float(np.quantile(np.abs(shown), 0.9)), 1e-12)
        image = axes.imshow(shown, cmap="PuOr", vmin=-limit, vmax=limit, aspect="auto")
        for i, q in np.ndindex(*shown.shape):
            value = float(shown[i, q])
            axes.text(
                q, i, f"{value:.2g}" if abs(value) >= LEAST else "0",
                ha="center", va="center", fontsize=6, color="white" if abs(value) > limit / 2 else "black",
            )  # fmt: skip
        axes.set_xticks(
            range(len(table.quantities)), [TITLES.get(n, n) for n in table.quantities], rotation=50, ha="right"
        )
        axes.set_yticks(range(len(shown)), table.parameters[:MOST_ROWS])
        axes.tick_params(labelsize=8)
        title = "percent of a quantity per percent of a parameter"
        axes.set_title(f"{name}: {title}" if name else title, fontsize=9)
        figure.colorbar(image, ax=axes, shrink=0.6, extend="both")
