"""Table *motion_driven*: the force that the model needs for the measured motion of the key, beside the measured one."""

from __future__ import annotations

from typing import Any

from validation.tables.comparison import Comparison
from validation.tables.table import TRIAL, Column, Page, Table

COLUMNS = (
    TRIAL,
    Column("peak_measured_n", "N", "Largest measured force", head="peak, measured"),
    Column("peak_predicted_n", "N", "Largest predicted force", head="peak, predicted"),
    Column("rmse_n", "N", "Root mean square of predicted − measured", head="RMSE"),
    Column("rmse_over_peak", "1", "RMSE divided by the measured peak", head="of the peak", shown=("%", 100.0)),
    Column("bias_n", "N", "Mean of predicted − measured"),
    Column("u_rms_n", "N", "Root mean square of the stated standard uncertainty of the prediction"),
    Column("within_95_share", "1", "Share of samples whose difference lies inside its stated 95 % interval",
           head="inside 95 %", shown=("%", 100.0)),
    Column("left_out_share", "1", "Share of the window left out (key may lift)", head="left out", shown=("%", 100.0)),
    Column("n", "1", "Samples compared", int),
)  # fmt: skip


def rows(comparison: Comparison) -> list[dict[str, Any]]:
    """One row where it was asked for and could be made; else none."""
    return comparison.motion[0]


TABLE = Table(
    "motion_driven",
    "trial: force predicted from the measured motion of the key, in one trial",
    COLUMNS,
    rows,
    (Page("inside", "Force predicted from the motion of the key", order=1),),
)
