"""Table *scores*: every curve of every trial, scored inside the evaluation window."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd

from validation.curves.display_signs import SIGN
from validation.findings.finding import LeftOut
from validation.numbers import degrees
from validation.tables.channels import summary
from validation.tables.comparison import Comparison
from validation.tables.table import CHANNEL, TRIAL, Column, Page, Row, Table


def _bias(row: Row) -> str:
    return degrees(SIGN[row["channel"]] * float(row["bias_rad"]))


def _baseline(column: Column, name: str, words: str) -> Column:
    return replace(column, name=f"{name}_{column.name}", meaning=f"{column.meaning}; {words}", head="")


BASELINES = (("null", "of the null model"), ("raw_force", "of the model driven by the force as recorded"))
COMPARED = (
    Column("rmse_rad", "rad", "Root mean square of model − trial inside the window", head="RMSE"),
    Column("before_impact_rmse_rad", "rad", "The same over the samples before the string impact of the trial",
           head="before impact"),
    Column("rmse_over_range", "1", "RMSE divided by the range of the trial's angle"),
    Column("iso_overall", "1", "Overall score in the style of ISO/TS 18571, from 0 to 1 (1 is best)", head="ISO-style"),
    Column("iso_corridor", "1", "Its corridor part"),
    Column("iso_phase", "1", "Its phase part"),
    Column("iso_magnitude", "1", "Its magnitude part"),
    Column("iso_slope", "1", "Its slope part"),
    Column("sg_magnitude", "1", "Sprague–Geers magnitude error, signed; 0 is best"),
    Column("sg_phase", "1", "Sprague–Geers phase error, from 0 to 1; 0 is best"),
    Column("sg_combined", "1", "Sprague–Geers combined error; 0 is best"),
)  # fmt: skip
COLUMNS = (
    TRIAL,
    CHANNEL,
    Column("source", "", "Sensor: encoder or film", str),
    Column("pooled", "", "Whether figures of several trials count this row; not where the encoder is wired wrong",
           bool),
    Column("rmse_over_s_r", "1", "RMSE divided by the repeatability standard deviation"),
    *COMPARED,
    Column("iso_shift_s", "s", "Shift at which the ISO-style phase part found the best correlation"),
    Column("bias_rad", "rad", "Mean of model − trial", head="mean", text=_bias),
    Column("scatter_rad", "rad", "Standard deviation of model − trial about its mean"),
    Column("largest_rad", "rad", "Largest magnitude of model − trial", head="largest"),
    Column("largest_at_s", "s", "Time of it", head="at"),
    Column("n", "1", "Samples scored", int),
    Column("n_lost", "1", "Samples left out: lost frames and marked lifts", int, head="lost"),
    Column("iso_guards", "", "What makes the ISO-style score doubtful; empty when nothing does", str),
    *(_baseline(c, name, words) for name, words in BASELINES for c in COMPARED),
    Column("u_rms_rad", "rad", "Standard uncertainty of one measured sample", head="uncertainty of a sample"),
)  # fmt: skip


def rows(comparison: Comparison) -> pd.DataFrame:
    """Scores of every curve with the RMSE over the channel's s_r."""
    return add_repeatability(comparison.scored.scores, summary(comparison)[0], comparison.without)


def add_repeatability(scores: pd.DataFrame, channels: pd.DataFrame, without: LeftOut = ()) -> pd.DataFrame:
    """Copy of the table ``scores`` with ``rmse_over_s_r``, by the ``s_r_rad`` of the table ``channels``, and
    ``pooled``: whether figures of several trials count the row, which pairs (trial, channel) ``without`` do not.

    The column ``pooled`` is the one place where that is decided: every figure of several trials reads it.
    """
    s_r = dict(zip(channels["channel"], channels["s_r_rad"], strict=True))
    known = scores["channel"].map(s_r).astype(float)
    return scores.assign(
        pooled=[pair not in without for pair in zip(scores["trial"], scores["channel"], strict=True)],
        rmse_over_s_r=np.where(known > 0, scores["rmse_rad"] / known.where(known > 0), np.nan),
    )


NOTES = (
    "Model − trial in degrees inside the evaluation window: root mean square (RMSE), the same before the string "
    "impact, mean, and largest magnitude with its time; standard uncertainty of one measured sample; lost: "
    "samples left out. ISO-style: score in the style of ISO/TS 18571, 1 is best.",
)
TABLE = Table(
    "scores",
    "trial and channel: scores inside the evaluation window",
    COLUMNS,
    rows,
    (Page("trials", "Differences of every trial and channel", NOTES, order=2),),
)
