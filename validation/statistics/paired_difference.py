"""The difference of model and trials, judged: one test for the headline, the bands and the channel table.

Conventions: difference = model − trial of the same trial, mean over the trials of `DifferenceDraws`, rad. Its standard
uncertainty is that of the draws: force, parameters as declared, encoders and film, and the scatter of the trials where
it is larger than these explain. What was not judged is NaN, and ``why`` says so.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from validation.conventions import Array
from validation.prediction.joint_draws import CHANNELS
from validation.statistics.difference_draws import DifferenceDraws
from validation.statistics.simultaneous_test import LEVEL, SimultaneousTest, simultaneous_test

POINTWISE = 2.0  # standard uncertainties
MOST_FAILED = 0.2  # of the draws: beyond, those that could be run are a selection
SHOWN, NOT_SHOWN, NOT_JUDGED = "model error shown", "within the stated uncertainty", "not judged"


@dataclass(frozen=True)
class ChannelDifference:
    """Mean difference of a channel on the base asked for, and what it amounts to.

    Attributes
    ----------
    mean, u, band : (n,) rad; ``band`` is the half width of the simultaneous 95 % band
    row : values of the channel table
    """

    mean: Array
    u: Array
    band: Array
    row: dict[str, object]


@dataclass(frozen=True)
class Judgement:
    """Draws and test of a session, or why there are none."""

    draws: DifferenceDraws | None = None
    test: SimultaneousTest | None = None
    why: str = "the uncertainty budget was not made"

    def facts(self) -> dict[str, Any]:
        """The test in plain values, for the provenance."""
        if self.draws is None or self.test is None:
            return {"judged": False, "reason": self.why}
        t = self.test
        return {
            "judged": True,
            "level": LEVEL,
            "rejected": t.rejected,
            "p": t.p,
            "factor": t.factor,
            "draws": t.draws,
            "failed_draws": self.draws.failed,
            "trials": list(self.draws.trials),
            "scatter_of_trials_added": t.excess_scatter,
        }

    def channel(self, name: str, base_s: Array) -> ChannelDifference:
        """The judged difference of one channel at times ``base_s``."""
        nan = float("nan")
        nothing = np.full(base_s.size, nan)
        i = CHANNELS.index(name)
        if self.draws is None or self.test is None or not np.isfinite(self.test.reached[i]):
            row: dict[str, object] = dict.fromkeys(COLUMNS, nan)
            return ChannelDifference(nothing, nothing, nothing, row | {"judgement": NOT_JUDGED})
        t, time = self.test, self.draws.time_s
        size, u, scale = np.abs(t.difference[:, i]), t.u[:, i], t.scale[:, i]
        known = np.isfinite(size)
        right = np.sort(np.sqrt(np.nanmean(self.draws.draws[..., i] ** 2, axis=(1, 2))))
        row = {
            "mean_difference_rad": float(np.sqrt(np.mean(size[known] ** 2))),
            "u_difference_rad": float(np.sqrt(np.mean(u[known] ** 2))),
            "largest_ratio": float(t.reached[i]),
            "largest_ratio_difference_rad": float(t.difference[t.largest_at[i], i]),
            "largest_ratio_at_s": float(time[t.largest_at[i]]),
            "ratio_limit": t.factor,
            "resolved_share": float(np.mean(size[known] > t.factor * scale[known])),
            "resolved_pointwise_share": float(np.mean(size[known] > POINTWISE * u[known])),
            "rmse_right_rad": float(np.median(right)),
            "rmse_right_95_rad": float(right[min(int(np.ceil((1 - LEVEL) * (right.size + 1) - 1e-9)), right.size) - 1]),
            "judgement": SHOWN if t.reached[i] > t.factor else NOT_SHOWN,
        }
        mean, u_base, unit = (np.interp(base_s, time[known], v[known]) for v in (t.difference[:, i], u, scale))
        return ChannelDifference(mean, u_base, t.factor * unit, row)


COLUMNS = (
    "mean_difference_rad",
    "u_difference_rad",
    "largest_ratio",
    "largest_ratio_difference_rad",
    "largest_ratio_at_s",
    "ratio_limit",
    "resolved_share",
    "resolved_pointwise_share",
    "rmse_right_rad",
    "rmse_right_95_rad",
)


def judge(draws: DifferenceDraws) -> Judgement:
    """Test a session's difference, unless too many draws failed."""
    n = len(draws.draws) + draws.failed
    if draws.failed > MOST_FAILED * n:
        return Judgement(draws, None, f"{draws.failed} of {n} draws of the declared uncertainties cannot be simulated")
    test = simultaneous_test(draws.found, draws.draws, draws.floor)
    return Judgement(draws, test, "" if test is not None else "no sample is known in model and trials")
