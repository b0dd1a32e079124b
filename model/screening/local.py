"""The local table: how much each event and curve of a blow changes with each parameter, ranked."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from model.arrays import ArrayRecord
from model.sensitivity.result import Sensitivities

Array = NDArray[np.float64]


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
        """One row a parameter and quantity, as written to a file."""
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
    """Rank parameters by what a percent of each does to a blow.

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
    >>> table = model.screening.local_table(found)
    >>> table.parameters[0]
    'hammer.mass'
    """
    events = {name: value for name, value in found.events.items() if not np.isnan(value)}
    slopes = [found.d_events[name] * found.values for name in events]
    values = list(events.values())
    if "onset_s" in events:
        onset, d_onset = events["onset_s"], found.d_events["onset_s"] * found.values
        start = float(found.time_s[0])
        for k, name in enumerate(events):
            if name == "onset_s":
                values[k] -= start
            elif name.endswith("_s") and not name.endswith("_per_s"):
                values[k], slopes[k] = values[k] - onset, slopes[k] - d_onset
    names, units = list(events), [_unit(name) for name in events]
    for i, body in enumerate(found.angle_names):
        turn = found.angles_rad[:, i] - found.angles_rad[0, i]
        change = (found.d_angles[:, i] - found.d_angles[0, i]) * found.values
        names.append(f"{body} curve")
        units.append("m" if body == "key_lift" else "rad")
        values.append(float(np.sqrt(np.mean(turn**2))))
        slopes.append(np.sqrt(np.mean(change**2, axis=0)))
    value, slope = np.array(values), np.array(slopes).T  # slope: (P, Q), per 100 % of each parameter
    percent = np.divide(slope, value, out=np.zeros_like(slope), where=value != 0.0)
    order = np.argsort(-np.max(np.abs(percent), axis=1, initial=0.0), kind="stable")
    relative = np.divide(
        found.uncertainties, np.abs(found.values), out=np.full(len(found.values), np.nan), where=found.values != 0.0
    )
    return LocalTable(
        tuple(found.parameters[i] for i in order),
        tuple(names),
        tuple(units),
        value,
        percent[order],
        0.01 * slope[order],
        (slope * relative[:, None])[order],
    )


def _unit(event: str) -> str:
    return "m/s" if event.endswith("_per_s") else event.rpartition("_")[2]


def lines(table: LocalTable, quantities: Mapping[str, str], most: int) -> list[str]:
    """The table as text: a line a parameter, a column for each of ``quantities`` (name -> heading) that it has."""
    shown = [
        (table.quantities.index(name), heading) for name, heading in quantities.items() if name in table.quantities
    ]
    width = max([len("parameter"), *(len(name) for name in table.parameters[:most])])
    out = [f"{'parameter':<{width}}" + "".join(f" {heading:>11}" for _, heading in shown)]
    for i, name in enumerate(table.parameters[:most]):
        out.append(f"{name:<{width}}" + "".join(f" {table.percent[i, q]:>11.4f}" for q, _ in shown))
    return out
