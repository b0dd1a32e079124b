"""Table *rivals*: RMSE of the model and of each of its rivals, by trial and channel."""

from __future__ import annotations

import pandas as pd

from validation.tables.comparison import Comparison
from validation.tables.table import TRIAL, Column, Page, Row, Table


def _nearest_head(row: Row) -> str:
    """The heading of the column with the smallest error."""
    return next((c.head for c in COLUMNS if c.name == f"{row['nearest']}_rmse_rad"), str(row["nearest"]))


COLUMNS = (
    TRIAL,
    Column("channel", "", "Channel", str, head="channel"),
    Column("rmse_rad", "rad", "RMSE of the model", head="model"),
    Column("null_rmse_rad", "rad", "RMSE of the null model", head="null model"),
    Column("unfitted_rmse_rad", "rad", "RMSE with the values before the identification", head="unfitted values"),
    Column("polynomial_rmse_rad", "rad", "RMSE of the black box: polynomial of the force", head="polynomial"),
    Column("fir_rmse_rad", "rad", "RMSE of the black box: nonlinear FIR filter of the force", head="FIR filter"),
    Column("fir_lags_rmse_rad", "rad", "RMSE of the black box: nonlinear FIR filter of six lags of the force",
           head="FIR, six lags"),
    Column("nearest", "", "model, null, unfitted, polynomial, fir or fir_lags", str, head="nearest",
           text=_nearest_head),
)  # fmt: skip


def rows(comparison: Comparison) -> pd.DataFrame:
    """What `validation.statistics.rivals` scored."""
    return comparison.rivals.errors


NOTES = (
    "RMSE in degrees. Polynomial and FIR filters are black boxes fitted to force and angles of other trials: they know "
    "no other regulation, no inner forces and no touch.",
)
TABLE = Table(
    "rivals",
    "trial and channel: the model beside its rivals",
    COLUMNS,
    rows,
    (Page("scores", "The model beside its rivals", NOTES, order=4),),
)
