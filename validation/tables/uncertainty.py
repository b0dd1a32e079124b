"""Table *uncertainty*: stated standard uncertainty of one sample of every channel of every trial."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from validation.conventions import ENCODER_CHANNELS, FILM_CHANNELS
from validation.measurement.trial import MeasuredTrial
from validation.tables.comparison import Comparison
from validation.tables.table import CHANNEL, TRIAL, Column, Page, Table

COLUMNS = (
    TRIAL,
    CHANNEL,
    Column("source", "", "Sensor: encoder, position sensor or film", str, head="sensor"),
    Column("quantisation_rad", "rad", "Standard uncertainty by the sensor's step; null for film", head="by its step"),
    Column("u_rad", "rad", "Standard uncertainty of one sample", head="of a sample"),
    Column("scale_relative_u", "1", "Relative standard uncertainty of the scale; null for film", head="of the scale",
           shown=("%", 100.0), digits=2),
)  # fmt: skip


def rows(comparison: Comparison) -> list[dict[str, Any]]:
    """One row a trial and channel; of film the median over frames."""
    return list(uncertainty_rows(comparison.predicted.trials, comparison.scored.traces.film))


def uncertainty_rows(
    measurements: Sequence[MeasuredTrial], film: Mapping[int, pd.DataFrame]
) -> Iterator[dict[str, Any]]:
    """Yield rows by column for each trial and channel: u by the sensor's step and u of a sample, rad, relative u of the
    scale; of films, whose tables are in ``film`` by trial number, the median u over frames alone."""
    names = [column.name for column in COLUMNS]
    for m in measurements:
        steps = m.resolution_rad / np.sqrt(12)
        sensor = "encoder" if m.sensors is None else "position sensor"
        for name, *values in zip(ENCODER_CHANNELS, steps, m.u_rad, m.scale_relative_u, strict=True):
            yield dict(zip(names, (m.number, name, sensor, *map(float, values)), strict=True))
        for name in FILM_CHANNELS if m.number in film else ():
            u = film[m.number][f"{name}_u_rad"].to_numpy()
            u = u[np.isfinite(u)]
            median = float(np.median(u)) if u.size else np.nan
            yield dict(zip(names, (m.number, name, "film", np.nan, median, np.nan), strict=True))


TABLE = Table(
    "uncertainty",
    "trial and channel",
    COLUMNS,
    rows,
    (Page("provenance", "Standard uncertainty of one sample", where=lambda table: table[table["u_rad"].notna()]),),
    of_model=False,
)
